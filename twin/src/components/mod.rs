//! Models of the board's components around the microcontroller.

pub mod bridge;
pub mod eeprom;
pub mod encoder;
pub mod i2c_bus;
pub mod mpu6050;
pub mod rangefinder;
pub mod servo;
pub mod spi_master;
pub mod uart_receiver;

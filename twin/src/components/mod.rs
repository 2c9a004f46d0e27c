//! The parts of the board around the microcontroller, each a model of its own.

pub mod bridge;
pub mod eeprom;
pub mod encoder;
pub mod i2c_bus;
pub mod mpu6050;
pub mod rangefinder;
pub mod servo;
pub mod spi_master;
pub mod uart_receiver;

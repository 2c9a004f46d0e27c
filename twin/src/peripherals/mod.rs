//! The peripherals of the STM32F411 that the emulator does not model, or too slowly: PWM, captures of the crystal's
//! clock, external interrupts, their multiplexer, the SPI slave, additions to the I2C model, and the connection
//! to the board.

pub mod board_port;
pub mod capture_timer;
pub mod exti;
pub mod i2c_master;
pub mod pwm_timer;
pub mod spi_slave;
pub mod syscfg;

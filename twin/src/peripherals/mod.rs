//! The devices of the STM32F411 that the emulator does not bring: external interrupts, their
//! multiplexer, the SPI slave, what the I2C model leaves out, and the door to the board.

pub mod board_port;
pub mod exti;
pub mod i2c_master;
pub mod spi_slave;
pub mod syscfg;

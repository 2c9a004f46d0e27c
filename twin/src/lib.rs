//! The virtual robot: the firmware's ELF, unchanged, on an emulated STM32F411 with the components of
//! the board around it and a room to drive in.
//!
//! ```
//! use embedded_hal::spi::SpiDevice;
//! use twin::{Board, Options};
//!
//! // The release ELF, where `cargo xtask firmware` has built it; else a program that only sleeps.
//! let elf = std::env::var_os("ROBOT_ELF").map_or_else(|| Ok(Vec::new()), std::fs::read)?;
//! let board = Board::new(&elf, Options::default())?;
//! board.run_us(20_000);
//! assert!(!board.is_ready(), "a blank EEPROM is no configuration");
//! println!("{}", String::from_utf8_lossy(&board.uart()));
//!
//! let mut frame = [0x96; 19];
//! board.spi().transfer_in_place(&mut frame)?;
//! assert_eq!(board.unmodelled(), Vec::<String>::new());
//! assert_eq!(board.truth().path_mm, 0.0);
//! # Ok::<(), Box<dyn std::error::Error>>(())
//! ```
//!
//! Virtual time passes only inside transfers, delays and the `run` methods, and everything that
//! happens depends on it and on the seed: a run can be repeated bit for bit. A thread with a board
//! runs it faster after [`processor::keep_to_one`].
//!
//! # What is modelled
//! Register by register, by `rigless`: RCC, PWR, FLASH, GPIO, DMA, USART, I2C (controller), ADC1
//! with its temperature sensor and voltage reference, TIM1 to TIM3, TIM5, IWDG, NVIC, `SysTick`, DWT. By
//! this crate: TIM4 as a PWM generator, TIM11's captures of the crystal's clock, EXTI, the multiplexer in SYSCFG,
//! SPI1 as a slave, the I2C's START and STOP with their time and the NACK that ends a reception by DMA, a bus held
//! low, a crystal that does not start. On
//! the board: the EEPROM with its write cycle, page wrap and write protection, the I2C switch, the MPU6050's
//! vertical gyroscope, the RESET line, quadrature edges, the bridge, battery taps behind their dividers, three
//! rangefinders with trigger, echo and crosstalk, the front one's servo, the log's UART at its bit rate.
//!
//! # What is not
//! - The core retires instructions at one rate at any clock, [`Options::mips`]: an estimate
//!   ([`trace::cycles`]) with the flash's wait states, loads and branches. An exception takes 220 ns on top,
//!   before its handler; in firmware that a debugger loads, none.
//! - DMA moves a word at the instant it is requested.
//! - The converter goes on without `DDS`; a peripheral answers at once after its clock is enabled; the LSI, and the
//!   watchdog with it, runs at exactly 32 kHz.
//! - A peripheral of the part without a model (SPI2 to SPI5, TIM9, TIM10, CRC, WWDG, SDIO, OTG)
//!   answers from its registers alone, and [`Board::unmodelled`] reports every access.
//! - The brown-out reset: the supply falls for the detector, the flash and the converter alone.
//! - The MPU6050's accelerometers, other axes, temperature and FIFO.
#![forbid(unsafe_code)]
#![cfg_attr(not(test), warn(clippy::disallowed_methods))]

pub mod board;
pub mod board_model;
pub mod components;
pub mod emulator;
pub mod fault_injection;
#[cfg(test)]
mod fixture;
pub mod hal;
pub mod measurement;
mod options;
pub mod peripherals;
pub mod pin;
pub mod pinout;
pub mod processor;
pub mod soc;
pub mod trace;
mod unmodelled;
pub mod virtual_board;

pub use board::{Board, ResetSource, Truth};
pub use components::i2c_bus::I2cController;
pub use components::mpu6050::Mpu6050Fault;
pub use components::spi_master::SpiStep;
pub use emulator::{Debugger, EmulationEnded};
pub use options::Options;
pub use plant;

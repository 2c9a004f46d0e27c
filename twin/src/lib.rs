//! The virtual robot: the firmware's ELF, unchanged, on an emulated STM32F411 with the parts of the
//! board around it and a room to drive in.
//!
//! ```no_run
//! use embedded_hal::spi::SpiDevice;
//! use twin::{Board, Options};
//!
//! let elf = std::fs::read("fw-pac.elf")?;
//! let board = Board::new(&elf, Options::default())?;
//! assert!(board.run_until(100_000, 100, Board::is_ready), "no READY within 100 ms");
//! board.spi().transfer_in_place(&mut [0x96; 19])?;
//! board.run_us(25_000);
//! println!("{}", String::from_utf8_lossy(&board.uart()));
//! assert!(board.unmodelled().is_empty());
//! # Ok::<(), Box<dyn std::error::Error>>(())
//! ```
//!
//! Virtual time passes inside transfers, delays and the `run` methods alone, and everything that
//! happens depends on it and on the seed: a run can be repeated bit for bit.
//!
//! # How it is made
//! | module | what |
//! |---|---|
//! | [`board`] | the handle: boot, let time pass, look |
//! | [`hal`] | the Pi's SPI, I2C, GPIO and delay as embedded-hal 1.0 |
//! | [`fault_injection`] | what can go wrong |
//! | [`trace`] | instructions and times of functions and wires |
//! | [`unmodelled`] | what no model covers |
//! | [`emulator`] | the emulator on its thread |
//! | [`virtual_board`], [`soc`], [`peripherals`] | the STM32F411: `rigless`'s models, and ours for what it has none |
//! | [`board_model`], [`components`], [`pinout`] | the board |
//!
//! # What is modelled
//! Register by register, by `rigless`: RCC, PWR, FLASH, GPIO, DMA, USART, I2C (controller), ADC1
//! with its temperature sensor and voltage reference, TIM1 to TIM5, IWDG, NVIC, `SysTick`, DWT. By this crate: EXTI, the
//! multiplexer in SYSCFG, SPI1 as a slave, the NACK that ends an I2C reception by DMA, a bus held
//! low, a crystal that does not start. On the board: the EEPROM with its write cycle, page wrap
//! and write protection, the I2C switch, the MPU6050's gyroscope about the vertical, the RESET line, quadrature edges at the instants the
//! wheels pass them, the bridge, battery taps behind their dividers, three rangefinders with
//! trigger and echo times that hear each other's echoes, the servo under the front one, the log's wire at
//! its bit rate.
//!
//! # What is not
//! - The core retires one instruction per 10 ns of virtual time whatever the clock tree says, and
//!   entering or leaving an exception takes none: wait states, the flash accelerator's misses and
//!   the twelve cycles of an exception entry are missing.
//! - DMA moves a word at the instant it is requested.
//! - A peripheral of the part without a model (SPI2 to SPI5, TIM9 to TIM11, CRC, WWDG, SDIO, OTG)
//!   answers from its registers alone, and every access is reported by [`Board::unmodelled`].
//! - Voltage dips: the supervisor and the brown-out reset see a steady 3.3 V.
//! - The MPU6050's accelerometers, other axes, temperature and FIFO ([`components::mpu6050`]).
#![forbid(unsafe_code)]

pub mod board;
pub mod board_model;
pub mod components;
pub mod emulator;
pub mod fault_injection;
pub mod hal;
pub mod peripherals;
pub mod pinout;
pub mod soc;
pub mod trace;
pub mod unmodelled;
pub mod virtual_board;

pub use board::{Board, Options, Reset, ResetBy, Truth};
pub use components::mpu6050::{Mpu6050Fault, Mpu6050Params};
pub use components::spi_master::Step;
pub use emulator::{Debugger, Ended};
pub use fault_injection::{Disturbance, Faults};
pub use plant;

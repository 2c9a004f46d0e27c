//! The Pi's end of the lines and buses to the robot: EEPROM, SPI link and UART log, over
//! embedded-hal 1.0.
//!
//! A frame over any [`SpiDevice`](embedded_hal::spi::SpiDevice), here one with a canned reply:
//!
//! ```
//! use embedded_hal::spi::{ErrorType, Operation, SpiDevice};
//! use fw_core::eeprom::fields;
//! use fw_core::wire::{Command, Mode};
//! use host_link::board_io::spi;
//! use host_link::link::Link;
//! use host_link::pose::Pose;
//! use host_link::settings::Settings;
//!
//! struct FakeStm;
//!
//! impl ErrorType for FakeStm {
//!     type Error = std::convert::Infallible;
//! }
//!
//! impl SpiDevice for FakeStm {
//!     fn transaction(&mut self, operations: &mut [Operation<'_, u8>]) -> Result<(), Self::Error> {
//!         for operation in operations {
//!             if let Operation::Transfer(reply, command) = operation {
//!                 assert_eq!(command[..5], [0x96, 0x00, 0x0F, 0x42, 0x40]); // key, x = 1000 mm
//!                 reply.copy_from_slice(&[
//!                     0x5A, // key
//!                     0x00, 0x07, 0xA1, 0x20, 0x00, 0x00, 0x00, 0x00, 0x20, 0x00, // x, y, rotation
//!                     0x03, 0x0C, // cell 0
//!                     0xFF, 0xFF, 0x66, 0x66, 0xFF, 0xFF, // front, right, left
//!                 ]);
//!             }
//!         }
//!         Ok(())
//!     }
//! }
//!
//! # fn main() -> Result<(), Box<dyn std::error::Error>> {
//! let normal = (fields::MODE, u64::from(Mode::Normal.code()));
//! let settings = Settings::load("config/first-board.toml".as_ref())?.with(&[normal])?;
//! let mut link = Link::new(settings.config());
//! let target = Pose { x_mm: 1000.0, ..Pose::default() };
//! let command = Command { expected: target.code(), apply: true, ..Command::default() };
//! let report = link.exchange(&mut *spi(FakeStm), &mut || 0, &command)?;
//! let pose = Pose::from_code(report.expect("an accepted reply").pose);
//! assert_eq!((pose.x_mm, pose.rotation_deg), (500.0, 90.0));
//! # Ok(())
//! # }
//! ```
//!
//! The configuration in an EEPROM image, as [`eeprom::read`] returns it:
//!
//! ```
//! use host_link::settings::{render, Settings};
//!
//! # fn main() -> Result<(), host_link::error::Error> {
//! let image = fw_core::eeprom::Image::FIRST_BOARD;
//! let settings = Settings::from_image(&image)?;
//! println!("{}", render(&settings));
//! # Ok(())
//! # }
//! ```
//!
//! | feature | brings |
//! |---|---|
//! | `linux` | [`board_io::BoardIo`] on spidev, i2c-dev and gpiochip of a Raspberry Pi |
//! | `mock` | [`board_io::BoardIo`] in memory, with faults at any call, for tests |
#![forbid(unsafe_code)]

pub mod board_io;
pub mod eeprom;
pub mod error;
pub mod file;
pub mod file_fault;
pub mod link;
#[cfg(feature = "linux")]
pub mod linux;
pub mod log;
#[cfg(any(test, feature = "mock"))]
pub mod mock_board;
mod mode_check;
pub mod pose;
pub mod reset;
pub mod session;
pub mod settings;
pub mod snapshot;
pub mod statistics;
pub mod uart;

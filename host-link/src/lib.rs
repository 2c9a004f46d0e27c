//! The Raspberry Pi side of the robot: EEPROM, SPI link, log and drive, over embedded-hal 1.0.
//!
//! Everything here works on a [`board_io::BoardIo`]: the handles of the wires between the Pi and the
//! board. Where they come from is a feature:
//!
//! | feature | brings |
//! |---|---|
//! | `linux` | [`board_io::BoardIo`] on spidev, i2c-dev and gpiochip of a Raspberry Pi |
//! | `mock` | [`board_io::BoardIo`] in memory, with faults at any call, for tests |
//!
//! | module | idea |
//! |---|---|
//! | [`board_io`] | the wires, as handles; Ctrl-C as a flag |
//! | [`reset`] | RESET and `STM_READY` |
//! | [`eeprom`] | the EEPROM and its bus, taken and always given back |
//! | [`settings`] | the configuration file |
//! | [`link`] | one frame out, one frame back, counted |
//! | [`statistics`] | what each end counts |
//! | [`session`] | paced frames, the latest of everything, silence noticed |
//! | [`drive`] | to a pose, along a tour; stopped whatever happens |
//! | [`pose`] | millimetres and degrees ↔ the wire |
//! | [`snapshot`] | what `monitor` shows |
//! | [`uart`] | the STM's log, as bytes |
//! | [`log`] | and line by line, whatever arrives |
//! | [`error`] | every failure as one sentence, with its exit code |
#![forbid(unsafe_code)]

pub mod board_io;
pub mod drive;
pub mod eeprom;
pub mod error;
pub mod link;
#[cfg(feature = "linux")]
pub mod linux;
pub mod log;
#[cfg(any(test, feature = "mock"))]
pub mod mock_board;
mod mode_check;
pub mod pose;
pub mod reset;
pub mod samples;
pub mod session;
pub mod settings;
pub mod snapshot;
pub mod statistics;
pub mod uart;

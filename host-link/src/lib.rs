//! The Raspberry Pi side of the robot: EEPROM, SPI link, drive and map, over embedded-hal 1.0.
//!
//! Everything here works on a [`machine::Machine`]: the handles of the wires between the Pi and the
//! board. Where they come from is a feature:
//!
//! | feature | [`machine::Machine`] from | needs |
//! |---|---|---|
//! | `linux` | `linux`: spidev, i2c-dev, gpiochip of a Raspberry Pi | Linux |
//! | `virtual` | `virtual_board`: the firmware's ELF on the virtual board | the packages `twin` and `rigless` |
//!
//! Without either, which is what a plain `cargo build` gives, the program can do what needs no
//! robot: check, convert and compare configuration files and EEPROM images, and draw maps from
//! recordings.
//!
//! | module | idea |
//! |---|---|
//! | [`machine`] | the wires, as handles; Ctrl-C as a flag |
//! | [`reset`] | RESET and `STM_READY` |
//! | [`eeprom`] | the EEPROM and its bus, taken and always given back |
//! | [`settings`] | the configuration file |
//! | [`mode`] | another mode on both ends |
//! | [`link`] | one frame out, one frame back, counted |
//! | [`statistics`] | what each end counts |
//! | [`session`] | paced frames, the latest of everything, silence noticed |
//! | [`drive`] | to a pose, along a tour; stopped whatever happens |
//! | [`tour`] | way-point files |
//! | [`pose`] | millimetres and degrees ↔ the wire |
//! | [`snapshot`] | what `monitor` shows |
//! | [`uart`] | the STM's log, as bytes |
//! | [`log`] | and line by line, whatever arrives |
//! | [`hints`] | what counters and faults mean, in sentences |
//! | [`tune`] | steps, model, gains, dividers |
//! | [`calibrate`] | wheel diameters and track from measured runs |
//! | [`survey`] | mapping while driving; recordings |
//! | [`error`] | every failure as one sentence, with its exit code |
#![forbid(unsafe_code)]

mod acquaintance;
pub mod calibrate;
#[cfg(test)]
mod doubles;
pub mod drive;
pub mod eeprom;
pub mod error;
pub mod hints;
pub mod link;
#[cfg(feature = "linux")]
pub mod linux;
pub mod log;
pub mod machine;
pub mod mode;
pub mod pose;
pub mod reset;
pub mod session;
pub mod settings;
pub mod snapshot;
pub mod statistics;
pub mod survey;
pub mod tour;
pub mod tune;
pub mod uart;
#[cfg(feature = "virtual")]
pub mod virtual_board;

//! Every decision of the robot, as pure functions: `(state, event) → outputs`.
//!
//! The same code runs in the firmware, on the Pi and under the proofs. It allocates nothing, never
//! panics, uses no floating-point arithmetic and no `unsafe`.
//!
//! | module | what it decides |
//! |---|---|
//! | [`wire`] | SPI frames: one file per strategy, the chains, the modes, both ends |
//! | [`eeprom`] | the register map: image → [`eeprom::Config`] and back |
//! | [`motion`] | heading and position, PID, pose controller, stop deadline |
//! | [`sensing`] | battery, rangefinders, gyroscope |
//! | [`robot`] | one value, one method per event |
//! | [`log`] | the UART log's lines and their queue |
//! | [`types`] | units, pose, faults, motor commands, rangefinder ids |
#![no_std]
#![forbid(unsafe_code)]

#[cfg(test)]
extern crate std;

pub mod binary64;
pub mod divide;
pub mod eeprom;
pub mod log;
pub mod motion;
pub mod robot;
pub mod sensing;
pub mod types;
pub mod wire;

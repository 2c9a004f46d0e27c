//! Every decision of the robot, as pure functions: `(state, event) → outputs`.
//!
//! ```
//! use fw_core::eeprom::{Config, Image};
//! use fw_core::log::Log;
//! use fw_core::robot::{ReceivedFrame, Robot, TickInput};
//! use fw_core::types::{Micros, MotorCommand};
//! use fw_core::wire::{Command, PiLink, PoseCode, MAX_FRAME};
//!
//! // The configuration as the STM reads it from the EEPROM.
//! let config = Config::decode(&Image::FIRST_BOARD).expect("accepted");
//!
//! // The robot as it is reset: the first reply is armed before the first frame.
//! let mut input = TickInput::default();
//! let mut robot = Robot::new(&config, input);
//! let (mut log, mut reply) = (Log::new(), [0; MAX_FRAME]);
//! let len = robot.encode_reply(1, &mut reply);
//!
//! // The Pi sends it half a metre ahead and reads the reply of the same chip-select.
//! let mut pi = PiLink::new(config.link_setup());
//! let command = Command {
//!     expected: PoseCode { x: 500_000, ..PoseCode::default() },
//!     apply: true,
//!     ..Command::default()
//! };
//! let mut bytes = [0; MAX_FRAME];
//! let sent = pi.send(&command, &mut bytes);
//! let report = pi.receive(&reply[..len]).expect("accepted");
//! assert_eq!(report.pose, PoseCode::default());
//!
//! // The frame reaches the robot; the next tick drives.
//! let frame = ReceivedFrame { bytes: &bytes[..sent], overflow_len: 0, at: input.now, reply: 2 };
//! let received = robot.receive(&frame).expect("accepted");
//! robot.execute(&received, frame.at, &mut log);
//! input.now = Micros(10_000);
//! let output = robot.on_tick(input, &[3428, 3574], &mut log);
//! assert!(matches!(output.left, MotorCommand::Run(_)));
//! assert_eq!(log.pending(), b"I00000: moving\n");
//! ```
//!
//! The same code runs in the firmware, on the Pi and under the proofs. It allocates nothing, never
//! panics, uses no floating-point arithmetic and no `unsafe`.
#![no_std]
#![forbid(unsafe_code)]
#![cfg_attr(
    not(test),
    deny(
        clippy::indexing_slicing,
        clippy::panic,
        clippy::unwrap_used,
        clippy::expect_used,
        clippy::float_arithmetic
    )
)]

#[cfg(test)]
extern crate std;

pub mod binary64;
pub mod captured;
pub mod divide;
pub mod eeprom;
pub mod log;
pub mod motion;
pub mod robot;
pub mod sensing;
pub mod transmitter;
pub mod types;
pub mod wire;

//! SPI frames: what the Pi and the STM exchange, and the codes of its values.
//!
//! Both ends send the frame of the mode's chain at the same time, one frame per chip-select.
//! Each strategy takes its bytes from the front and hands on the rest; the first failure stops the
//! chain, names the strategy, and nothing of the frame takes effect (document, 5.1).
//!
//! A new strategy is a new file and a word in `strategies!`; a new mode is a line of `modes!`.

#![allow(
    clippy::inline_always,
    reason = "a strategy in a chain is a few loads and comparisons"
)]

pub mod all_data_used;
pub mod battery;
pub mod bearing;
mod chain;
pub mod code;
pub mod crc;
pub mod distance;
pub mod double;
pub mod error;
pub mod gyro;
pub mod handover;
pub mod key;
pub mod link;
pub mod position;
pub mod sequence;
pub mod status;
pub mod strategy;
pub mod test_frame;
pub mod velocity;

pub use chain::{
    Field, Mode, chain, frame_len, parse_command, parse_report, write_command, write_report,
};
pub use error::{Cause, FieldError, FrameError, Reason};
pub use link::{LinkCounters, PiLink, Setup, StmLink};

use crate::binary64::Binary64;
use crate::types::{Faults, Velocity};

/// The longest frame of any mode, in bytes.
pub const MAX_FRAME: usize = 32;

/// A pose as the wire carries it.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub struct PoseCode {
    /// Micrometres (millimetres × 1000).
    pub x: i32,
    /// Micrometres (millimetres × 1000).
    pub y: i32,
    /// Turn × 0x8000, 0 ..= 0x7FFF.
    pub rotation: u16,
}

/// A cell's voltage as the wire carries it.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub struct CellCode {
    /// 0 ..= 7.
    pub cell: u8,
    /// Volts × 200, 0 ..= 0x1FFF (40.955 V and above).
    pub voltage: u16,
}

/// A rangefinder's reading as the wire carries it: mm × 65535 / 2500, 0xFFFF = nothing valid.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct DistanceCode(pub u16);

impl DistanceCode {
    /// Out of range, no echo, or not yet measured.
    pub const NONE: Self = Self(0xFFFF);
}

impl Default for DistanceCode {
    fn default() -> Self {
        Self::NONE
    }
}

/// The gyroscope's angle as the wire carries it: 2⁻²⁴ turns, counter-clockwise positive, wrapping.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct GyroCode(pub i32);

impl GyroCode {
    /// No gyroscope, or no bias yet.
    pub const NONE: Self = Self(i32::MIN);
}

impl Default for GyroCode {
    fn default() -> Self {
        Self::NONE
    }
}

/// Frame counters of the guarded modes, one byte each on the wire.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub struct Sequence {
    /// The sender's own counter, wrapping.
    pub own: u8,
    /// The last counter the sender accepted from the other end.
    pub seen: u8,
}

/// What the robot is doing; the code of the status strategy and the pattern of the LEDs.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq, Hash)]
#[repr(u8)]
pub enum State {
    /// Reading its configuration.
    #[default]
    Booting = 0,
    /// Configured, standing, nothing asked of it.
    Ready = 1,
    /// On its way.
    Moving = 2,
    /// Stopped by the deadline or by command; needs to be resumed.
    Stopped = 3,
    /// Something is broken; the motors stay off.
    Faulted = 4,
}

/// What the Pi orders beside the pose, in guarded modes.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
#[repr(u8)]
pub enum Order {
    /// Nothing.
    #[default]
    None = 0,
    /// Brake now and stay so.
    Stop = 1,
    /// Leave [`State::Stopped`].
    Resume = 2,
}

/// What the Pi sends. Fields that the mode's chain does not carry keep their default.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub struct Command {
    /// Where the robot should be.
    pub expected: PoseCode,
    /// Whether `expected` is to be driven to from now on.
    pub apply: bool,
    /// Tuning modes: percent to set on the engines, −100 ..= 100.
    pub percent: Binary64,
    /// Velocity mode.
    pub velocity: Velocity,
    /// Velocity mode: half the width of the front rangefinder's sweep around straight ahead, turn × 0x10000.
    pub sweep: u16,
    /// Reference voltage of a cell being tuned; voltage 0 = no tuning.
    pub tune: CellCode,
    /// Guarded modes.
    pub sequence: Sequence,
    /// Guarded modes: latched fault bits to clear.
    pub clear_faults: Faults,
    /// Guarded modes.
    pub order: Order,
}

/// What the STM sends. Fields that the mode's chain does not carry keep their default.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub struct Report {
    /// The estimated pose.
    pub pose: PoseCode,
    /// Tuning modes: rotation in degrees or displacement in millimetres.
    pub measurement: Binary64,
    /// One cell a frame, in turn.
    pub cell: CellCode,
    /// Front, right, left; in the sweep mode the first is the swept one.
    pub ranges: [DistanceCode; 3],
    /// Sweep and velocity mode: bearing of the first reading, turn × 0x10000.
    pub bearing: u16,
    /// Velocity mode: the gyroscope's angle since reset.
    pub gyro: GyroCode,
    /// Guarded modes.
    pub sequence: Sequence,
    /// Guarded modes: latched faults, see [`Faults::TABLE`].
    pub faults: Faults,
    /// Guarded modes.
    pub state: State,
    /// Guarded modes: the obstacle stop limits the speed.
    pub obstacle_limited: bool,
    /// Guarded modes: the commanded velocity was beyond a limit.
    pub clipped: bool,
}

#[cfg(test)]
mod tests;

//! The types that every other module shares: units, pose, faults, motor commands, rangefinder ids.
//!
//! Imports no other module of the crate.

mod faults;
mod movement;
mod units;

pub use faults::{Fault, Faults};
pub use movement::{Delta, HeadingCorrection, MotorCommand, MotorCommands, Pose, Velocity};
pub use units::{Duty, Micrometres, Micros, Millimetres, Milliseconds, Ohms, Turns, Volts};

/// A rangefinder, in the order of the frame.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum RangefinderId {
    /// Trig3, Echo3.
    Front = 0,
    /// Trig2, Echo2.
    Right = 1,
    /// Trig1, Echo1.
    Left = 2,
}

impl RangefinderId {
    /// All of them, in the order of the frame.
    pub const ALL: [Self; 3] = [Self::Front, Self::Right, Self::Left];

    /// One lower-case word, as in the log.
    #[must_use]
    pub const fn name(self) -> &'static str {
        match self {
            Self::Front => "front",
            Self::Right => "right",
            Self::Left => "left",
        }
    }
}

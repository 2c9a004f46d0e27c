//! What odometry, controllers and gyroscope exchange, and what the bridges are driven with.

use super::{Duty, Millimetres, Turns};
use fixed::types::I16F16;

/// Position and heading: x ahead of and y to the left of where the robot was at reset.
#[derive(Clone, Copy, Debug, Default, Eq)]
pub struct Pose {
    /// Along the axis the robot faced at reset.
    pub x: Millimetres,
    /// To the left of that axis.
    pub y: Millimetres,
    /// Counter-clockwise from that axis.
    pub heading: Turns,
}

#[allow(
    clippy::needless_bitwise_bool,
    reason = "the compiler would merge lazy comparisons into a call of `memcmp`"
)]
impl PartialEq for Pose {
    fn eq(&self, other: &Self) -> bool {
        (self.x == other.x) & (self.y == other.y) & (self.heading == other.heading)
    }
}

/// Wheel and robot motion of one 10 ms tick.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub struct Delta {
    /// Counts the left wheel rolled, forward positive.
    pub left: i32,
    /// Counts the right wheel rolled, forward positive, −32 768 ..= 32 768.
    pub right: i32,
    /// Millimetres the axle's centre moved along its path, saturating; error at most 0.001 mm.
    pub travel: I16F16,
    /// Turn of the robot, 2⁻³² turns, counter-clockwise positive.
    pub turn: i32,
}

impl Delta {
    /// A tick in which the wheels rolled by these counts, forward positive, and nothing else is known.
    pub const fn rolled(left: i32, right: i32) -> Self {
        Self {
            left,
            right,
            travel: I16F16::ZERO,
            turn: 0,
        }
    }
}

/// A commanded motion.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub struct Velocity {
    /// µm/s, forward positive.
    pub forward: i32,
    /// 2⁻³² turns/s, counter-clockwise positive.
    pub yaw_rate: i32,
}

/// What the gyroscope adds to the heading of the encoders, 2⁻³² turns, counter-clockwise positive.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub struct HeadingCorrection {
    /// To the heading: this tick's share and the ticks before the slip was detected.
    pub heading: i32,
    /// This tick's share alone.
    pub tick: i32,
}

/// What one motor's bridge is driven with.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub enum MotorCommand {
    /// Enable low: the wheel turns freely. The state after a reset and after every failure.
    #[default]
    Coast,
    /// Both inputs alike, enable high: the motor is shorted.
    Brake,
    /// Duty and direction.
    Run(Duty),
}

/// What both bridges are driven with.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub struct MotorCommands {
    /// The left motor.
    pub left: MotorCommand,
    /// The right motor.
    pub right: MotorCommand,
}

impl MotorCommands {
    /// Both motors shorted.
    pub const BRAKE: Self = Self {
        left: MotorCommand::Brake,
        right: MotorCommand::Brake,
    };
}

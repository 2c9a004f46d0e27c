//! The parts of a configuration, in units: gains, dividers, wheels, servo, limits.

use crate::types::{Duty, Micrometres, Milliseconds, Ohms, Turns};
use fixed::types::I32F32;

/// A PID's factor, 0 ..= 10 000, resolution 2⁻³².
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq, PartialOrd, Ord)]
pub struct Gain(pub(super) I32F32);

impl Gain {
    /// The largest.
    pub const MAX: Self = Self(I32F32::lit("10000"));

    /// `None` beyond 0 ..= 10 000.
    pub fn new(value: I32F32) -> Option<Self> {
        (I32F32::ZERO..=Self::MAX.0)
            .contains(&value)
            .then_some(Self(value))
    }

    /// Its value.
    #[must_use]
    pub const fn value(self) -> I32F32 {
        self.0
    }
}

/// A PID's gains, per 10 ms sample; its output is percent of duty.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub struct Gains {
    /// Proportional.
    pub p: Gain,
    /// Integral, per sample.
    pub i: Gain,
    /// Derivative, per sample.
    pub d: Gain,
    /// Back-calculation factor.
    pub anti_windup: Gain,
}

/// A tap's voltage divider.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub struct Divider {
    /// Between the tap and the ADC pin: at most 10 MΩ and 99 times the lower one.
    pub upper: Ohms,
    /// Between the ADC pin and ground: 1 Ω to 10 MΩ.
    pub lower: Ohms,
}

/// One side's wheel, encoder and motor.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct Wheel {
    /// 10 mm to 1 m.
    pub diameter: Micrometres,
    /// The encoder counts down when the wheel rolls forward.
    pub encoder_reversed: bool,
    /// A positive duty turns the wheel backward.
    pub motor_reversed: bool,
    /// Duty below which the motor does not turn, 0 to below `limit`.
    pub dead_zone: Duty,
    /// Largest duty, 0.01 % to 100 %.
    pub limit: Duty,
    /// Speed at full duty without load, 1 ..= 5000 mm/s.
    pub full_speed_mm_s: u16,
}

/// The servo that swings the front rangefinder.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct Servo {
    /// What it turns from a pulse of 1.0 ms to one of 2.0 ms, more than 0 and at most half a turn.
    pub travel: Turns,
    /// A longer pulse turns it clockwise.
    pub reversed: bool,
}

/// Limits of the velocity in mode 0x30, Guarded Velocity.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct VelocityLimits {
    /// Largest forward speed, 10 ..= 2000 mm/s.
    pub speed_mm_s: u16,
    /// Largest yaw rate either way, 2⁻³² turns/s, 2²⁴ ..= 2³¹.
    pub yaw_rate: u32,
    /// Change of the forward speed, 50 ..= 10 000 mm/s².
    pub acceleration_mm_s2: u16,
    /// Change of the yaw rate, 2⁻³² turns/s², at least 2²⁴.
    pub yaw_acceleration: u32,
}

/// Figures of the obstacle stop and of driving backward.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct ObstacleStop {
    /// Kept free ahead of the robot's front edge, 0 ..= 2000 mm.
    pub stop_distance_mm: u16,
    /// From the front rangefinder's face to the robot's front edge, 0 ..= 1000 mm.
    pub overhang_mm: u16,
    /// From an echo to slower wheels, 0 ..= 1000 ms.
    pub reaction_time: Milliseconds,
    /// 50 ..= 10 000 mm/s².
    pub deceleration_mm_s2: u16,
    /// Largest forward speed without a front distance, 0 ..= 2000 mm/s.
    pub blind_speed_mm_s: u16,
    /// Largest backward speed, 0 ..= 2000 mm/s.
    pub reverse_speed_mm_s: u16,
    /// Driven by velocity: longest way back before the next way forward, 0 ..= 10 000 mm.
    pub reverse_distance_mm: u16,
}

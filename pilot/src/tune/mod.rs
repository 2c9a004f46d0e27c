//! Tuning (document, 5.2.2 and 5.2.3): a measured step, a model of the drive, gains for its PID, and
//! the battery's dividers.

pub mod battery;
pub mod drive_model;
pub mod export;
pub mod gains;
pub mod samples;
pub mod step_response;
pub mod temporary_mode;

#[cfg(test)]
mod tests;

use fw_core::eeprom::Field;
use fw_core::eeprom::fields::{
    FORWARD_ANTI_WINDUP, FORWARD_D, FORWARD_I, FORWARD_P, ROTATION_ANTI_WINDUP, ROTATION_D,
    ROTATION_I, ROTATION_P,
};
use fw_core::wire::Mode;
use serde::Serialize;

/// What is tuned.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Serialize)]
#[serde(rename_all = "lowercase")]
pub enum Axis {
    /// Rotation on the spot, degrees.
    Rotate,
    /// Forward and backward, the angle held; millimetres.
    Move,
}

impl Axis {
    /// The mode that measures it.
    #[must_use]
    pub const fn mode(self) -> Mode {
        match self {
            Self::Rotate => Mode::TuneRotate,
            Self::Move => Mode::TuneMove,
        }
    }

    /// Its unit.
    #[must_use]
    pub const fn unit(self) -> &'static str {
        match self {
            Self::Rotate => "deg",
            Self::Move => "mm",
        }
    }

    /// Default travel of one step, in its unit.
    #[must_use]
    pub const fn default_travel(self) -> f64 {
        match self {
            Self::Rotate => 360.0,
            Self::Move => 300.0,
        }
    }

    /// What the robot is about to do.
    #[must_use]
    pub fn announce(self, plan: &step_response::StepPlan) -> String {
        let (steps, travel) = (2 * plan.levels.len(), plan.travel);
        let motion = match self {
            Self::Rotate => format!("turn on the spot {steps} times, up to {travel}° each"),
            Self::Move => format!("drive ahead and back {steps} times, up to {travel} mm each"),
        };
        format!("The robot will {motion}.")
    }

    /// The fields of its gains: P, I, D, anti wind-up.
    #[must_use]
    pub const fn fields(self) -> [&'static Field; 4] {
        match self {
            Self::Rotate => [ROTATION_P, ROTATION_I, ROTATION_D, ROTATION_ANTI_WINDUP],
            Self::Move => [FORWARD_P, FORWARD_I, FORWARD_D, FORWARD_ANTI_WINDUP],
        }
    }
}

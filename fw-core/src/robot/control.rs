//! The mode's controller and quantity, and what the Pi asks of the motors.

use super::Robot;
use crate::binary64::Binary64;
use crate::eeprom::Config;
use crate::log::Log;
use crate::motion::{PoseController, VelocityController};
use crate::types::{Duty, Faults, MotorCommand, Velocity};
use crate::wire::Mode;

/// What the Pi asks of the motors.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(super) enum DriveRequest {
    /// Nothing since the reset.
    None,
    /// Drive to the controller's target.
    Target,
    /// Drive with this velocity.
    Velocity(Velocity),
    /// Tuning: a constant duty.
    Duty(Duty),
}

/// The mode's controller.
#[derive(Clone, Debug)]
pub(super) enum Control {
    Pose(PoseController),
    Velocity(VelocityController),
}

/// What a mode measures.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(super) enum MeasuredQuantity {
    /// Drive to a pose, report the pose.
    Pose,
    /// Constant duty, report the rotation.
    Rotation,
    /// Constant duty with the angle held, report the displacement.
    Displacement,
}

impl MeasuredQuantity {
    pub(super) const fn of(mode: Mode) -> Self {
        match mode {
            Mode::Normal | Mode::GuardedNormal | Mode::GuardedSweep | Mode::GuardedVelocity => {
                Self::Pose
            }
            Mode::TuneRotate | Mode::GuardedTuneRotate => Self::Rotation,
            Mode::TuneMove | Mode::GuardedTuneMove => Self::Displacement,
        }
    }
}

impl Control {
    #[allow(clippy::inline_always)] // built in place, without a copy on the stack
    #[inline(always)]
    pub(super) fn new(config: &Config) -> Self {
        match config.mode() {
            Mode::GuardedVelocity => Self::Velocity(VelocityController::new(config)),
            _ => Self::Pose(PoseController::new(config)),
        }
    }

    /// Stopped: from rest next time.
    pub(super) fn halt(&mut self) {
        match self {
            Self::Pose(controller) => controller.halt(),
            Self::Velocity(controller) => controller.stand(),
        }
    }

    /// Whether it is on the way to a target.
    pub(super) fn moving(&self) -> bool {
        matches!(self, Self::Pose(controller) if controller.moving())
    }

    /// Whether a limit of the velocity, and whether the obstacle stop reduced the last command.
    pub(super) const fn reduced(&self) -> (bool, bool) {
        match self {
            Self::Pose(controller) => (false, controller.held_back()),
            Self::Velocity(controller) => (controller.clipped(), controller.held_back()),
        }
    }
}

impl Robot {
    /// Once a tick: whether the motors are busy with what the Pi asks. Gives up a target that is not
    /// reached in time.
    #[allow(clippy::inline_always, reason = "every tick calls it")]
    #[inline(always)]
    pub(super) fn busy(&mut self, log: &mut Log) -> bool {
        match self.request {
            DriveRequest::None => false,
            // Requirement: WIRE-fault-15
            DriveRequest::Target => {
                let moving = self.control.moving();
                let (from, to) = (&self.report.pose, &self.target);
                let way = || [to.x.abs_diff(from.x), to.y.abs_diff(from.y)];
                let held_back = self.report.obstacle_limited
                    && self.obstacle.max_forward() < self.arrival.speed;
                if self.arrival.step(moving, held_back, way) {
                    self.latch(Faults::NOT_ARRIVED, log);
                }
                moving
            }
            // Until the wheels are held.
            DriveRequest::Velocity(velocity) => {
                velocity != Velocity::default() || matches!(self.applied.left, MotorCommand::Run(_))
            }
            DriveRequest::Duty(duty) => duty != Duty::ZERO,
        }
    }
}

/// The Pi's percent as a duty: the wire accepts nothing beyond ±100.
#[inline(never)]
pub(super) fn percent(percent: Binary64) -> Duty {
    // 2⁻³² %, and hundredths of a percent, to the nearest.
    let bits = percent
        .to_scaled(32)
        .unwrap_or(0)
        .clamp(-PERCENT_100, PERCENT_100);
    let hundredths = (bits * 100 + (1 << 31)) >> 32;
    Duty::saturating(i32::try_from(hundredths).unwrap_or(0))
}

/// 100 %, 2⁻³².
const PERCENT_100: i64 = 100 << 32;

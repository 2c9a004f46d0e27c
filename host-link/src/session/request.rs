//! What a frame asks of the robot, in units of the user.

use crate::pose::Pose;
use fw_core::types::{Faults, Velocity};
use fw_core::wire::{CellCode, Order};

/// The command of one frame; [`Session`](super::Session) adds the battery's cell and the sequence.
#[derive(Clone, Copy, Debug, Default, PartialEq)]
pub struct CommandRequest {
    /// Where to drive, if anywhere.
    pub target: Option<Pose>,
    /// Guarded modes.
    pub order: Order,
    /// Guarded modes: latched faults to clear.
    pub clear_faults: Faults,
    /// Tuning modes: duty, percent, −100 to 100.
    pub percent: f64,
    /// A cell and the reference voltage it is tuned to, instead of the cycle over the cells.
    pub tune: Option<CellCode>,
    /// Velocity mode: how to drive; none stands.
    pub velocity: Option<VelocityRequest>,
}

/// A velocity to drive at, and what the front rangefinder looks at meanwhile.
#[derive(Clone, Copy, Debug, Default, PartialEq)]
pub struct VelocityRequest {
    /// Forward speed, millimetres a second; negative drives back.
    pub forward_mm_s: f64,
    /// Yaw rate, degrees a second, counter-clockwise; saturates at half a turn a second.
    pub yaw_rate_deg_s: f64,
    /// Half the width of the front rangefinder's sweep around straight ahead, degrees, up to 180; 0: none.
    pub sweep_half_width_deg: f64,
}

impl VelocityRequest {
    /// The nearest codes of the velocity and of the sweep.
    #[allow(clippy::cast_possible_truncation, clippy::cast_sign_loss)] // `as` saturates
    pub(super) fn code(self) -> (Velocity, u16) {
        let turns = |degrees: f64, per_turn: f64| (degrees / 360.0 * per_turn).round();
        let velocity = Velocity {
            forward: (self.forward_mm_s * 1000.0).round() as i32,
            yaw_rate: turns(self.yaw_rate_deg_s, 4_294_967_296.0) as i32,
        };
        let sweep = turns(self.sweep_half_width_deg, 65_536.0).min(32_768.0);
        (velocity, sweep as u16)
    }
}

//! What the pose controller remembers.

use super::stiction::{LowPass, RateProfile, StictionBoost};
use crate::types::Turns;

/// What it is doing: see the module.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub enum Phase {
    /// Without a target: braked.
    #[default]
    Idle,
    /// Far from the target.
    Approach {
        /// Tail first.
        reverse: bool,
    },
    /// On the last 40 mm.
    FinalApproach {
        /// Held meanwhile.
        heading: Turns,
    },
    /// At the target's position.
    FinalRotation,
    /// Arrived.
    Hold,
}

/// What a tick leaves to the next one, besides the target, the PIDs and the mixer.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub struct PoseState {
    /// Of the motion.
    pub phase: Phase,
    /// An attempt ended outside the tolerances.
    pub widened: bool,
    /// At rest and aligned, up to 5; 5 only while holding or idle.
    pub settled_ticks: u8,
    /// Forward, millimetres a tick.
    pub speed: LowPass,
    /// Degrees a tick.
    pub turn_rate: LowPass,
    /// Degrees a tick.
    pub planned_turn: RateProfile,
    /// Of the forward PID.
    pub forward_boost: StictionBoost,
    /// Of the rotation PID.
    pub rotation_boost: StictionBoost,
}

//! Stiction compensation and rate filtering around the PIDs.

use fixed::types::I16F16;

/// Ticks at rest before the boost begins.
const REST_TICKS: u8 = 3;
/// Growth a tick and largest boost, 2⁻¹⁶ %.
const BOOST_STEP: i32 = (1 << 16) / 4;
const MAX_BOOST: i32 = 15 << 16;

/// Output that grows while the robot rests outside its tolerance, and ends as soon as a wheel moves.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub struct StictionBoost {
    /// At rest, up to 3.
    pub rest_ticks: u8,
    /// 2⁻¹⁶ %, up to 15 %.
    pub boost: i32,
}

impl StictionBoost {
    /// Percent to add to the output, in the direction of `error`; 0 unless `enabled` and at rest.
    pub fn step(&mut self, error: I16F16, enabled: bool, moved: bool) -> I16F16 {
        if !enabled || moved {
            *self = Self::default();
        } else if self.rest_ticks < REST_TICKS {
            self.rest_ticks += 1;
        } else {
            self.boost = (self.boost + BOOST_STEP).min(MAX_BOOST);
        }
        I16F16::from_bits(self.boost * error.to_bits().signum())
    }
}

/// First-order low pass of 40 ms for the derivatives: at low speed single counts are no speed.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub struct LowPass(pub i32);

impl LowPass {
    /// The filtered rate.
    // One copy in flash.
    #[inline(never)]
    pub fn step(&mut self, rate: I16F16) -> I16F16 {
        // Cut so that the sum below fits: 4 m or 10 turns in a tick are no motion.
        let rate = rate.to_bits().clamp(-(1 << 28), 1 << 28);
        self.0 += (rate - self.0) >> 2;
        I16F16::from_bits(self.0)
    }
}

/// Planned turn rate: each tick a thirtieth of the remaining angle, at most 2° a tick (200°/s), reached
/// at 1000°/s². It starts at rest, so a new target never kicks the derivative.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub struct RateProfile(pub i32);

/// 0.1° a tick and tick, 2⁻¹⁶°.
const MAX_ACCELERATION: i32 = (1 << 16) / 10;

impl RateProfile {
    /// Degrees of this tick; `remaining` degrees are left.
    pub fn step(&mut self, remaining: I16F16) -> I16F16 {
        let rate = (remaining.to_bits() / 30).clamp(-(2 << 16), 2 << 16);
        self.0 += (rate - self.0).clamp(-MAX_ACCELERATION, MAX_ACCELERATION);
        I16F16::from_bits(self.0)
    }
}

//! What friction and single counts make necessary around the PIDs.

use fixed::types::I16F16;

/// Ticks at rest until the nudge begins.
const STUCK: u8 = 3;
/// What it grows by each tick and its most, 2⁻¹⁶ %.
const NUDGE: i32 = (1 << 16) / 4;
const NUDGE_LIMIT: i32 = 15 << 16;

/// What gets a wheel going that sticks: grows while the robot rests outside its tolerance, gone as
/// soon as something moves.
#[derive(Clone, Copy, Debug, Default)]
pub(super) struct Nudge {
    resting: u8,
    /// 2⁻¹⁶ %.
    push: i32,
}

impl Nudge {
    /// To be added to the output, in the error's direction; nothing without an error.
    pub fn step(&mut self, error: I16F16, wanted: bool, moved: bool) -> I16F16 {
        if moved || !wanted {
            *self = Self::default();
        } else if self.resting < STUCK {
            self.resting += 1;
        } else {
            self.push = (self.push + NUDGE).min(NUDGE_LIMIT);
        }
        I16F16::from_bits(self.push * error.to_bits().signum())
    }
}

/// The derivative's filter: one count more or less at a crawl is not a speed. First order, 40 ms.
#[derive(Clone, Copy, Debug, Default)]
pub(super) struct Rate(i32);

impl Rate {
    pub fn step(&mut self, rate: I16F16) -> I16F16 {
        // Cut so that the sum below fits; nothing moves 4 m or turns 10 times in a tick.
        let rate = rate.to_bits().clamp(-(1 << 28), 1 << 28);
        self.0 += (rate - self.0) >> 2;
        I16F16::from_bits(self.0)
    }
}

/// Planned turn: each tick a thirtieth of the angle left, 2° a tick (200°/s) at most, reached at
/// 1000°/s². It begins at rest, so a new target never kicks the derivative.
#[derive(Clone, Copy, Debug, Default)]
pub(super) struct Plan(i32);

impl Plan {
    /// Degrees of this tick, `left` to go.
    pub fn step(&mut self, left: I16F16) -> I16F16 {
        let wanted = (left.to_bits() / 30).clamp(-(2 << 16), 2 << 16);
        self.0 += (wanted - self.0).clamp(-SLEW, SLEW);
        I16F16::from_bits(self.0)
    }
}

/// 0.1° a tick and tick, 2⁻¹⁶°.
const SLEW: i32 = (1 << 16) / 10;

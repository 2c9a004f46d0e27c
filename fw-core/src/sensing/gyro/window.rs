//! How far the gyroscope and the encoders have come apart lately.

/// Ticks looked back on: 0.32 s.
pub(super) const TICKS: usize = 32;

/// The last ticks' differences and turns, and their sums.
#[derive(Clone, Copy, Debug)]
pub(super) struct Window {
    /// Gyroscope less encoders, and what the encoders turned either way, 2⁻³² turns.
    ticks: [(i32, u32); TICKS],
    at: usize,
    apart: i64,
    turned: u64,
}

impl Window {
    pub const fn new() -> Self {
        Self {
            ticks: [(0, 0); TICKS],
            at: 0,
            apart: 0,
            turned: 0,
        }
    }

    /// A tick in which they came `apart` while the encoders turned by `turn`.
    pub fn push(&mut self, apart: i32, turn: i32) {
        let new = (apart, turn.unsigned_abs());
        self.at = (self.at + 1) % TICKS;
        let Some(slot) = self.ticks.get_mut(self.at) else {
            return;
        };
        let old = core::mem::replace(slot, new);
        self.apart += i64::from(new.0) - i64::from(old.0);
        self.turned = self.turned + u64::from(new.1) - u64::from(old.1);
    }

    /// Gyroscope less encoders, 2⁻³² turns; at most 2³⁶ either way.
    pub const fn apart(&self) -> i64 {
        self.apart
    }

    /// What the encoders turned, either way, 2⁻³² turns; at most 2³⁶.
    pub const fn turned(&self) -> u64 {
        self.turned
    }
}

//! Sliding window over the difference between gyroscope and encoders.

/// Length: 0.32 s.
pub(super) const TICKS: usize = 32;

/// The last ticks and their sums.
#[derive(Clone, Copy, Debug)]
pub(super) struct Window {
    /// Gyroscope less encoders, and the encoders' turn in either direction, 2⁻³² turns.
    ticks: [(i32, u32); TICKS],
    at: usize,
    difference: i64,
    turned: u64,
}

impl Window {
    pub const fn new() -> Self {
        Self {
            ticks: [(0, 0); TICKS],
            at: 0,
            difference: 0,
            turned: 0,
        }
    }

    /// Adds a tick: gyroscope less encoders, and the encoders' turn.
    pub fn push(&mut self, difference: i32, turn: i32) {
        let new = (difference, turn.unsigned_abs());
        self.at = (self.at + 1) % TICKS;
        let Some(slot) = self.ticks.get_mut(self.at) else {
            return;
        };
        let old = core::mem::replace(slot, new);
        self.difference += i64::from(new.0) - i64::from(old.0);
        self.turned = self.turned + u64::from(new.1) - u64::from(old.1);
    }

    /// Gyroscope less encoders, 2⁻³² turns, within ±2³⁶.
    pub const fn difference(&self) -> i64 {
        self.difference
    }

    /// Turn of the encoders in either direction, 2⁻³² turns, at most 2³⁶.
    pub const fn turned(&self) -> u64 {
        self.turned
    }
}

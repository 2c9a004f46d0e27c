//! The stop deadline: no fresh valid frame for the configured time, no motion.

use crate::units::Micros;

/// Watches how long the last fresh valid frame is ago. Once run out it stays so until a fresh
/// frame, however long that takes: the clock's wrap after 71.6 minutes never makes silence fresh.
///
/// [`Self::expired`] must be asked at least every 35 minutes; the control tick does every 10 ms.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct StopDeadline {
    /// Microseconds, below 2³¹.
    allowed: u32,
    last: Micros,
    expired: bool,
}

impl StopDeadline {
    /// Run out from the start: nothing moves before the first frame. `milliseconds` up to 65 535.
    #[must_use]
    pub const fn new(milliseconds: u16) -> Self {
        Self {
            allowed: milliseconds as u32 * 1000,
            last: Micros(0),
            expired: true,
        }
    }

    /// A fresh valid frame arrived.
    pub fn fresh(&mut self, now: Micros) {
        self.last = now;
        self.expired = false;
    }

    /// Whether the time has run out by `now`, or had before.
    ///
    /// `now` may lie before the last frame by as much as half the clock's range: an interrupt that
    /// read its clock first and ran later.
    #[must_use]
    pub fn expired(&mut self, now: Micros) -> bool {
        let silence = now.since(self.last) as i32;
        // A negative silence is a frame from just after `now`, not one from an hour ago.
        if silence >= 0 && silence as u32 >= self.allowed {
            self.expired = true;
        }
        self.expired
    }
}

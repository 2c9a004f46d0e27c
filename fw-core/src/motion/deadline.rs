//! The stop deadline: no fresh valid frame for the configured time, no motion.

use crate::types::{Micros, Milliseconds};
/// Time since the last fresh valid frame, limited. Expired, it stays so until a fresh frame: the
/// clock's wrap after 71.6 minutes never makes silence fresh.
///
/// [`Self::expired`] must be called at least every 35 minutes; the control tick does every 10 ms.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Hash)]
pub struct StopDeadline {
    /// Microseconds, below 2³¹.
    allowed: u32,
    last: Micros,
    expired: bool,
}

impl StopDeadline {
    /// Expired until the first frame.
    pub const fn new(allowed: Milliseconds) -> Self {
        Self {
            allowed: allowed.0 as u32 * 1000,
            last: Micros(0),
            expired: true,
        }
    }

    /// A fresh valid frame arrived.
    pub fn fresh(&mut self, now: Micros) {
        self.last = now;
        self.expired = false;
    }

    /// Whether the deadline has expired, by `now` or earlier.
    ///
    /// `now` may lie before the last frame by up to half the clock's range: an interrupt that reads
    /// its clock first may run later.
    // Requirement: WIRE-deadline-1, WIRE-deadline-3
    #[allow(clippy::inline_always, reason = "every frame calls it")]
    #[inline(always)]
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

#[cfg(test)]
mod tests {
    use super::*;

    /// `expired` every `period` µs after one frame: false up to the deadline, true ever after.
    fn assert_silence(start: u32, period: u32, ticks: u32) {
        let mut deadline = StopDeadline::new(Milliseconds(250));
        deadline.fresh(Micros(start));
        for k in 0..ticks {
            let now = Micros(start).after(k.wrapping_mul(period));
            let due = u64::from(k) * u64::from(period) >= 250_000;
            assert_eq!(deadline.expired(now), due, "tick {k} from {start}");
        }
    }

    #[test]
    fn deadline_silence_expires_for_good_across_clock_wrap() {
        for start in [0, 1, u32::MAX, u32::MAX - 100_000, 1 << 31] {
            assert_silence(start, 10_000, 1_500_000);
        }
        assert_silence((1 << 31) - 125_000, 10_000, 1_500_000);
        assert_silence(7, 30 * 60 * 1_000_000, 100);
    }

    #[test]
    fn deadline_frame_from_just_after_the_tick_is_fresh() {
        let mut deadline = StopDeadline::new(Milliseconds(250));
        for frame in [0, 5, 1 << 31] {
            deadline.fresh(Micros(frame));
            assert!(!deadline.expired(Micros(frame).after(u32::MAX)));
        }
    }

    // Requirement: WIRE-deadline-3
    #[test]
    fn deadline_before_first_frame_is_expired() {
        for now in [0, 1, 250_000, u32::MAX, 1 << 31] {
            assert!(StopDeadline::new(Milliseconds(250)).expired(Micros(now)));
        }
    }
}

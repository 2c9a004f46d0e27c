//! The stop deadline: no fresh valid frame for the configured time, no motion.

use crate::types::Micros;
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
    // Requirement: WIRE-deadline-1
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

    /// Silence from `start` on, asked every `every` µs: never fresh again once run out.
    fn silence(start: u32, every: u32, asks: u32) {
        let mut deadline = StopDeadline::new(250);
        deadline.fresh(Micros(start));
        let mut expired = false;
        for k in 0..asks {
            let now = Micros(start).after(k.wrapping_mul(every));
            let is = deadline.expired(now);
            assert!(is || !expired, "silence became fresh at {k}");
            if u64::from(k) * u64::from(every) >= 250_000 {
                assert!(is, "not run out at {k}");
            } else {
                assert!(!is, "ran out early at {k}");
            }
            expired = is;
        }
    }

    #[test]
    fn it_runs_out_after_its_time_and_stays_so_for_hours_across_the_clocks_wrap() {
        for start in [
            0,
            1,
            u32::MAX,
            u32::MAX - 100_000,
            1 << 31,
            (1 << 31) - 125_000,
        ] {
            silence(start, 10_000, 1_500_000);
        }
        silence(7, 30 * 60 * 1_000_000, 100);
    }

    // Requirement: WIRE-deadline-3
    #[test]
    fn nothing_moves_before_the_first_frame() {
        for now in [0, 1, 250_000, u32::MAX, 1 << 31] {
            assert!(StopDeadline::new(250).expired(Micros(now)));
        }
    }

    #[test]
    fn fresh_frames_keep_it_alive_and_one_revives_it() {
        let mut deadline = StopDeadline::new(100);
        let mut now = Micros(u32::MAX - 1_000_000);
        for _ in 0..1000 {
            deadline.fresh(now);
            now = now.after(99_999);
            assert!(!deadline.expired(now));
        }
        now = now.after(1);
        assert!(deadline.expired(now));
        deadline.fresh(now);
        assert!(!deadline.expired(now));
    }

    #[test]
    fn a_tick_whose_clock_was_read_before_the_frames_does_not_stop_the_robot() {
        for at in [0u32, 3, 1 << 31, u32::MAX] {
            let mut deadline = StopDeadline::new(20);
            deadline.fresh(Micros(at));
            assert!(!deadline.expired(Micros(at.wrapping_sub(50))));
        }
    }
}

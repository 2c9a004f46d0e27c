//! Virtual time at a chosen speed.

use std::time::{Duration, Instant};

/// Behind by more than this, a pacer begins again instead of hurrying after.
const BEHIND: Duration = Duration::from_millis(100);

/// Makes the board's clock pass a number of times faster than this computer's.
pub struct Pacer {
    speed: Option<f64>,
    origin: Option<(Instant, u64)>,
}

impl Pacer {
    /// None: as fast as it goes.
    pub const fn new(speed: Option<f64>) -> Self {
        let origin = None;
        Self { speed, origin }
    }

    /// Waits until this time on the board's clock, microseconds, is due.
    pub fn wait(&mut self, now_us: u64) {
        std::thread::sleep(self.left(Instant::now(), now_us));
    }

    /// The time from `now` until `now_us` is due.
    fn left(&mut self, now: Instant, now_us: u64) -> Duration {
        let Some(speed) = self.speed else {
            return Duration::ZERO;
        };
        let (host, board) = *self.origin.get_or_insert((now, now_us));
        let passed = Duration::from_micros(now_us.saturating_sub(board)).div_f64(speed);
        let due = host + passed;
        if now > due + BEHIND {
            self.origin = None;
        }
        due.saturating_duration_since(now)
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn pacer_keeps_speed_and_skips_a_pause() {
        let (mut pacer, begun) = (Pacer::new(Some(4.0)), Instant::now());
        let ms = Duration::from_millis;
        let mut left = |host_ms, board_ms: u64| pacer.left(begun + ms(host_ms), 1000 * board_ms);
        // Time on this computer, on the board, and what is left of the quarter.
        for (host, board, wait) in [(0, 1000, 0), (0, 1200, 50), (60, 1400, 40), (110, 1400, 0)] {
            assert_eq!(left(host, board), ms(wait), "{board}");
        }
        // It catches up with a short delay, and begins again after a long one.
        for (host, board, wait) in [
            (150, 1800, 50),
            (400, 1900, 0),
            (400, 2000, 0),
            (400, 2200, 50),
        ] {
            assert_eq!(left(host, board), ms(wait), "{board}");
        }
        assert_eq!(Pacer::new(None).left(begun, 5), Duration::ZERO);
    }
}

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
        let Some(speed) = self.speed else {
            return;
        };
        let (host, board) = *self.origin.get_or_insert_with(|| (Instant::now(), now_us));
        let passed = Duration::from_micros(now_us.saturating_sub(board)).div_f64(speed);
        let (due, now) = (host + passed, Instant::now());
        if now > due + BEHIND {
            self.origin = None;
        }
        std::thread::sleep(due.saturating_duration_since(now));
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn pacer_keeps_speed_and_skips_a_pause() {
        let (mut pacer, begun) = (Pacer::new(Some(4.0)), Instant::now());
        for ms in (0..=200).step_by(25) {
            pacer.wait(1_000_000 + 1000 * ms);
        }
        let passed = begun.elapsed().as_millis();
        assert!((50..90).contains(&passed), "{passed} ms");
        std::thread::sleep(2 * BEHIND);
        pacer.wait(1_225_000);
        let begun = Instant::now();
        pacer.wait(1_250_000);
        pacer.wait(1_350_000);
        assert!(begun.elapsed() >= Duration::from_millis(25));
    }
}

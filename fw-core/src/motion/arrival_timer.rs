//! The time that a motion to a target may take: a robot that cannot reach it would else try for ever.

use crate::eeprom::Config;

/// Ticks that every motion has: for stiction, settling and a second attempt.
const BASE_TICKS: u64 = 1000;
/// Ticks per micrometre at a quarter of 1 mm/s: 0.4, 2⁻²⁶.
const PACE: u32 = 26_843_545;

/// Counts the ticks of a motion. It has 10 s, and the time in which the slower wheel rolls, at a quarter
/// of its full speed or at the speed allowed in reverse, the way along x, along y and four tracks for its
/// turns: on the first board 25 s and 30 s a metre. The time does not run while the obstacle stop holds
/// it below that speed.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct ArrivalTimer {
    /// A quarter of the slower wheel's full speed, or the reverse speed, µm/s.
    pub speed: i32,
    /// Ticks per micrometre, 2⁻²⁶.
    pub pace: u32,
    /// Way of the turns before and after the drive, µm.
    pub turns: u32,
    /// Ticks left and 1; 0 without a motion.
    pub left: u32,
}

impl ArrivalTimer {
    /// Without a motion.
    pub fn new(config: &Config) -> Self {
        let speed = config.left().full_speed_mm_s;
        let slower = speed.min(config.right().full_speed_mm_s);
        // Without one nothing is driven in reverse.
        let slower = match config.obstacle_stop().reverse_speed_mm_s {
            0 => slower,
            reverse => slower.min(reverse * 4),
        };
        let slower = slower.max(1);
        Self {
            speed: i32::from(slower) * 250,
            pace: PACE / u32::from(slower),
            turns: config.track().0 * 4,
            left: 0,
        }
    }

    /// The next tick of a motion is its first.
    pub fn restart(&mut self) {
        self.left = 0;
    }

    /// One tick, in which the robot is `moving` to a target `way` micrometres away along x and y, or
    /// not, `held_back` by the obstacle stop or not; whether the time of the motion is over.
    // Requirement: WIRE-fault-15
    #[must_use]
    pub fn step(&mut self, moving: bool, held_back: bool, way: impl FnOnce() -> [u32; 2]) -> bool {
        let left = match (moving, self.left) {
            (false, _) => 0,
            (true, 0) => self.allowance(way),
            (true, left) if left > 1 && !held_back => left - 1,
            (true, left) => left,
        };
        self.left = left;
        left == 1
    }

    /// 10 s to 398 days.
    // Requirement: WIRE-fault-15
    #[cold]
    #[inline(never)]
    fn allowance(&self, way: impl FnOnce() -> [u32; 2]) -> u32 {
        let [x, y] = way();
        // At most 2³³ and 8 m, times 0.4.
        let way = u64::from(x) + u64::from(y) + u64::from(self.turns);
        (BASE_TICKS + ((way * u64::from(self.pace)) >> 26)) as u32
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::eeprom::{config_with, fields, first_board};

    /// Ticks of a motion of so many micrometres, of which every third is held back, until its time is over.
    fn ticks(timer: &mut ArrivalTimer, way: [u32; 2]) -> u32 {
        let (mut ticks, mut measured) = (0, way);
        while !timer.step(true, ticks % 3 == 1, || measured) {
            // What is measured after the first tick has no effect.
            measured = [9; 2];
            ticks += 1;
            assert!(ticks < 100_000, "never over");
        }
        assert!(timer.step(true, false, || way) && timer.step(true, true, || way));
        ticks - (ticks + 1) / 3
    }

    // Requirement: WIRE-fault-15
    #[test]
    fn timer_allows_quarter_speed_on_way_and_turns() {
        let timer = |left, right, track_um, reverse| {
            ArrivalTimer::new(&config_with(&[
                (fields::FULL_SPEED_LEFT, left),
                (fields::FULL_SPEED_RIGHT, right),
                (fields::TRACK, track_um),
                (fields::REVERSE_SPEED, reverse),
            ]))
        };
        for (mut timer, way, seconds) in [
            // 500 mm and 2000 mm at 33.5 mm/s.
            (ArrivalTimer::new(&first_board()), [0, 0], 24.93),
            (
                ArrivalTimer::new(&first_board()),
                [1_500_000, 500_000],
                84.63,
            ),
            (timer(500, 400, 100_000, 0), [250_000, 350_000], 20.0),
            (timer(400, 500, 100_000, 2000), [600_000, 0], 20.0),
            // The speed in reverse is less.
            (timer(5_000, 5_000, 1_000_000, 50), [0, 1_000_000], 110.0),
        ] {
            let found = f64::from(ticks(&mut timer, way)) / 100.0;
            assert!((found - seconds).abs() < 0.02, "{way:?}: {found} s");
        }
        let mut slowest = timer(1, 1, 2_000_000, 50);
        assert!(!slowest.step(true, false, || [u32::MAX; 2]));
        assert_eq!(slowest.left, 3_439_174_759);
    }

    #[test]
    fn timer_restarts_with_each_motion() {
        let mut timer = ArrivalTimer::new(&first_board());
        let first = ticks(&mut timer, [0, 0]);
        assert!(!timer.step(false, false, || [0; 2]));
        assert_eq!(ticks(&mut timer, [0, 0]), first);
        timer.restart();
        assert_eq!(ticks(&mut timer, [0, 0]), first);
    }
}

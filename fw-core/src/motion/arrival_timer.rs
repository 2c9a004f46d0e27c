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

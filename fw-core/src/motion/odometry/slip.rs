//! Correction of heading and position for a slipping wheel.

use super::{Odometry, Position, ROUNDING, saturated};
use crate::motion::trig::sin_cos;
use crate::types::{Delta, HeadingCorrection, Turns};

impl Odometry {
    /// Corrects the last tick, whose counters gave `delta`.
    ///
    /// The heading takes the whole correction. The position loses the travel that the slipping wheel
    /// did not roll: a wheel can only move the robot less than it turned, so the correction's sign names
    /// the wheel; where it may be either, both losses cancel. The loss is at most π·track per turn of
    /// correction and at most half of the wheel's own travel.
    pub fn apply_slip(&mut self, correction: HeadingCorrection, delta: &Delta) {
        self.heading = self
            .heading
            .wrapping_add(i64::from(correction.heading) << 32);

        let most = scale(self.half_travel_per_turn, correction.tick.saturating_abs());
        // Further counter-clockwise than the counters: the left wheel rolled less forward, or the right
        // one less backward.
        let left_forward = correction.tick > 0;
        let left = delta.left.clamp(-0x8000, 0x8000);
        let left = self.left.half.times(left, 0) >> 2;
        let right = self.right.half.times(delta.right, 0) >> 2;
        let lost = lost_travel(left, left_forward, most) + lost_travel(right, !left_forward, most);
        if lost == 0 {
            return;
        }
        let heading = Turns((self.heading.wrapping_sub(ROUNDING) >> 32) as u32);
        self.position.take_back(lost, heading);
    }
}

impl Position {
    /// Takes back a path `lost` in the direction `heading`, 2⁻⁴⁰ mm, at most 2⁶⁰.
    pub fn take_back(&mut self, lost: i64, heading: Turns) {
        let (sine, cosine) = sin_cos(heading);
        self.x = saturated(self.x - scale(lost << 1, cosine));
        self.y = saturated(self.y - scale(lost << 1, sine));
    }
}

/// Part of half a wheel's travel, 2⁻⁴⁰ mm, that it did not roll: at most `most`, and 0 unless it turned
/// `forward`, or backward.
fn lost_travel(half_travel: i64, forward: bool, most: i64) -> i64 {
    if (half_travel > 0) == forward {
        half_travel.min(most).max(-most)
    } else {
        0
    }
}

/// `a·b / 2³²`, floor.
const fn scale(a: i64, b: i32) -> i64 {
    (a >> 32) * b as i64 + (((a & 0xFFFF_FFFF) * b as i64) >> 32)
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn lost_travel_is_bounded_and_of_the_slipping_wheel() {
        for (travel, forward, most, expected) in [
            (1000, true, 300, 300),
            (1000, true, 5000, 1000),
            (1000, false, 300, 0),
            (-1000, false, 300, -300),
            (-1000, false, 5000, -1000),
            (-1000, true, 300, 0),
            (0, true, 300, 0),
            (0, false, 300, 0),
        ] {
            assert_eq!(lost_travel(travel, forward, most), expected);
        }
    }

    #[test]
    fn scale_is_the_product_rounded_down() {
        for a in [0, 1, -1, (7 << 32) + 5, 1 << 40, -(1 << 40), (1 << 62) + 3] {
            for b in [i32::MIN, -1, 0, 1, 3, 1 << 30, i32::MAX] {
                let exact = (i128::from(a) * i128::from(b)) >> 32;
                assert_eq!(i128::from(scale(a, b)), exact, "{a} {b}");
            }
        }
    }

    #[test]
    fn slip_beyond_the_travel_takes_the_whole_travel() {
        let platform = crate::eeprom::first_board();
        let start = Odometry::new(&platform, 0, 0);
        // Both wheels rolled 100 counts forward; half of the robot's travel is each one's.
        let rolled = Delta {
            left: 100,
            right: 100,
            ..Delta::default()
        };
        let half = start.left.half.times(100, 0) >> 2;
        // Along the corrected heading: x, or y after 90°.
        for (heading, tick, [x, y]) in [
            (0, i32::MAX, [half, 0]),
            (0, i32::MIN, [half, 0]),
            (0, 0, [0, 0]),
            (1 << 30, i32::MAX, [0, half]),
        ] {
            let mut odometry = start.clone();
            odometry.apply_slip(HeadingCorrection { heading, tick }, &rolled);
            let back_x = start.position.x - odometry.position.x;
            let back_y = start.position.y - odometry.position.y;
            assert!((back_x - x).abs() <= x / 1000, "{back_x} {x}");
            assert!((back_y - y).abs() <= y / 1000, "{back_y} {y}");
        }
    }

    #[test]
    fn slipping_wheel_is_that_of_the_last_tick() {
        let start = Odometry::new(&crate::eeprom::first_board(), 0, 0);
        let rolled = Delta::rolled(100, 0);
        // The ticks before the slip was detected may have differed the other way.
        for (tick, loses) in [(1 << 24, true), (-(1 << 24), false)] {
            for heading in [-(1 << 20), 0, 1 << 20] {
                let mut odometry = start.clone();
                odometry.apply_slip(HeadingCorrection { heading, tick }, &rolled);
                let lost = odometry.position.x < start.position.x;
                assert_eq!(lost, loses, "{heading} {tick}");
            }
        }
    }
}

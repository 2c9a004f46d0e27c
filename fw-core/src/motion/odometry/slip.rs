//! Correction of heading and position for a slipping wheel.

use super::{saturated, Odometry, ROUNDING};
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

        let most = scale(self.half_travel_per_turn, correction.tick.unsigned_abs());
        // Further counter-clockwise than the counters: the left wheel rolled less forward, or the right
        // one less backward.
        let left_forward = correction.tick > 0;
        let left = delta.left.clamp(-0x8000, 0x8000);
        let lost = lost_travel(self.left.half.times(left, 0) >> 2, left_forward, most)
            + lost_travel(
                self.right.half.times(delta.right, 0) >> 2,
                !left_forward,
                most,
            );
        if lost == 0 {
            return;
        }
        let heading = Turns((self.heading.wrapping_sub(ROUNDING) >> 32) as u32);
        let (sine, cosine) = sin_cos(heading);
        self.x = saturated(self.x - project(lost, cosine));
        self.y = saturated(self.y - project(lost, sine));
    }
}

/// Part of half a wheel's travel, 2⁻⁴⁰ mm, that it did not roll: at most `most`, and 0 unless it turned
/// `forward`, or backward.
fn lost_travel(half_travel: i64, forward: bool, most: u64) -> i64 {
    if half_travel == 0 || (half_travel > 0) != forward {
        return 0;
    }
    with_sign(half_travel.unsigned_abs().min(most), half_travel >> 63)
}

/// `travel`, below 2⁶¹, times a sine or cosine, Q31.
fn project(travel: i64, factor: i32) -> i64 {
    let size = scale(travel.unsigned_abs() << 1, factor.unsigned_abs());
    with_sign(size, (travel >> 63) ^ i64::from(factor >> 31))
}

/// `a·b / 2³²`, floor; `a` below 2⁶³.
const fn scale(a: u64, b: u32) -> u64 {
    (a >> 32) * b as u64 + (((a & 0xFFFF_FFFF) * b as u64) >> 32)
}

/// `a`, negated if `sign` is −1.
const fn with_sign(a: u64, sign: i64) -> i64 {
    (a as i64 ^ sign) - sign
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
            assert_eq!(
                lost_travel(travel, forward, most),
                expected,
                "{travel} {forward}"
            );
        }
    }

    #[test]
    fn projection_is_the_product_rounded_towards_zero() {
        for travel in [0, 1, -1, (7 << 32) + 5, 1 << 40, -(1 << 40), (1 << 60) + 3] {
            for factor in [i32::MIN, -1, 0, 1, 3, 1 << 30, i32::MAX] {
                let exact = i128::from(travel) * i128::from(factor) / (1 << 31);
                assert_eq!(i128::from(project(travel, factor)), exact);
                let scaled = scale(travel.unsigned_abs(), factor.unsigned_abs());
                let exact = u128::from(travel.unsigned_abs()) * u128::from(factor.unsigned_abs());
                assert_eq!(u128::from(scaled), exact >> 32, "{travel} {factor}");
            }
        }
    }

    #[test]
    fn slip_beyond_the_travel_takes_the_whole_travel() {
        let platform = crate::eeprom::first_board().platform;
        let start = Odometry::new(&platform, 0, 0);
        // Both wheels rolled 100 counts forward; half of the robot's travel is each one's.
        let rolled = Delta {
            left: 100,
            right: 100,
            ..Delta::default()
        };
        let half = start.left.half.times(100, 0) >> 2;
        for (tick, lost) in [(i32::MAX, half), (i32::MIN, half), (0, 0)] {
            let mut odometry = start.clone();
            odometry.apply_slip(HeadingCorrection { tick, heading: 0 }, &rolled);
            assert_eq!(odometry.y, start.y);
            let back = start.x - odometry.x;
            assert!((back - lost).abs() <= lost / 1000, "{back} {lost}");
        }
    }
}

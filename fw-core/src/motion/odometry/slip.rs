//! What the counters got wrong because a wheel slipped.

use super::{within, Odometry, NEAREST};
use crate::motion::trig::sin_cos;
use crate::types::{Delta, HeadingCorrection, Turns};

impl Odometry {
    /// The robot turned otherwise than the last tick's counters say, which were `delta`.
    ///
    /// The heading takes the whole of it. The way of that tick loses what the slipping wheel did not
    /// roll: a wheel can only have moved the robot less than it turned, so the sign of the difference
    /// names the wheel that slipped; where it may be either, what both lost cancels. Half the
    /// difference of the wheels' ways is π·track for a turn, and half of a wheel's own way is the most
    /// that its slip can take.
    pub fn apply_slip(&mut self, correction: HeadingCorrection, delta: &Delta) {
        self.heading = self
            .heading
            .wrapping_add(i64::from(correction.heading) << 32);

        let apart = correction.tick;
        let most = scale(self.turning, apart.unsigned_abs());
        // Further counter-clockwise than the wheels say: the left one rolled less forward, or the right
        // one less backward.
        let left = delta.left.clamp(-0x8000, 0x8000);
        let left = lost(self.left.half.times(left, 0) >> 2, apart > 0, most);
        let right = lost(self.right.half.times(delta.right, 0) >> 2, apart <= 0, most);
        let way = left + right;
        if way == 0 {
            return;
        }
        let heading = Turns((self.heading.wrapping_sub(NEAREST) >> 32) as u32);
        let (sine, cosine) = sin_cos(heading);
        self.x = within(self.x - along(way, cosine));
        self.y = within(self.y - along(way, sine));
    }
}

/// What of half a wheel's way, 2⁻⁴⁰ mm, it did not roll: at most `most`, if it slipped going forward
/// or backward as said.
fn lost(half_way: i64, forward: bool, most: u64) -> i64 {
    if half_way == 0 || (half_way > 0) != forward {
        return 0;
    }
    signed(half_way.unsigned_abs().min(most), half_way >> 63)
}

/// `way`, below 2⁶¹, times a sine or cosine, Q31.
fn along(way: i64, factor: i32) -> i64 {
    let size = scale(way.unsigned_abs() << 1, factor.unsigned_abs());
    signed(size, (way >> 63) ^ i64::from(factor >> 31))
}

/// `a·b / 2³²`, floor; `a` below 2⁶³.
const fn scale(a: u64, b: u32) -> u64 {
    (a >> 32) * b as u64 + (((a & 0xFFFF_FFFF) * b as u64) >> 32)
}

/// `a` or, where `sign` is −1, `−a`.
const fn signed(a: u64, sign: i64) -> i64 {
    (a as i64 ^ sign) - sign
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn no_more_is_lost_than_was_rolled_and_only_by_the_wheel_that_slipped() {
        for (way, forward, most, lost_way) in [
            (1000, true, 300, 300),
            (1000, true, 5000, 1000),
            (1000, false, 300, 0),
            (-1000, false, 300, -300),
            (-1000, false, 5000, -1000),
            (-1000, true, 300, 0),
            (0, true, 300, 0),
            (0, false, 300, 0),
        ] {
            assert_eq!(lost(way, forward, most), lost_way, "{way} {forward} {most}");
        }
    }

    #[test]
    fn a_product_is_scaled_to_its_floor() {
        for a in [0, 1, 0xFFFF_FFFF, 1 << 32, (7 << 32) + 5, (1 << 63) - 1] {
            for b in [0, 1, 3, 1 << 31, u32::MAX] {
                let exact = (u128::from(a) * u128::from(b)) >> 32;
                assert_eq!(u128::from(scale(a, b)), exact, "{a} {b}");
            }
        }
    }

    #[test]
    fn a_way_along_an_axis_has_the_sign_of_the_product() {
        for way in [0, 1, -1, 1 << 40, -(1 << 40), (1 << 60) + 3] {
            for factor in [i32::MIN, -1, 0, 1, 1 << 30, i32::MAX] {
                let exact = (i128::from(way) * i128::from(factor)).abs() >> 31;
                let sign = if (way < 0) == (factor < 0) { 1 } else { -1 };
                assert_eq!(
                    i128::from(along(way, factor)),
                    sign * exact,
                    "{way} {factor}"
                );
            }
        }
    }

    #[test]
    fn a_slip_further_than_the_wheel_rolled_takes_its_whole_way_and_no_more() {
        let platform = crate::eeprom::first_board().platform;
        let straight = Odometry::new(&platform, 0, 0);
        // Both wheels rolled 100 counts forward; half of the robot's way is each one's.
        let rolled = Delta {
            left: 100,
            right: 100,
            ..Delta::default()
        };
        let half = straight.left.half.times(100, 0) >> 2;
        let correction = |tick| HeadingCorrection {
            tick,
            ..HeadingCorrection::default()
        };
        for tick in [i32::MAX, i32::MIN] {
            let mut odometry = straight.clone();
            odometry.apply_slip(correction(tick), &rolled);
            assert_eq!(odometry.y, straight.y);
            let back = straight.x - odometry.x;
            assert!((back - half).abs() < half / 1000, "{back} {half}");
        }
        let mut odometry = straight.clone();
        odometry.apply_slip(correction(0), &rolled);
        assert_eq!(odometry.x, straight.x);
    }
}

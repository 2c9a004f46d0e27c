//! What the counters got wrong because a wheel slipped.

use super::{within, Delta, Odometry, NEAREST};
use crate::motion::trig::sin_cos;
use crate::sensing::gyro::Correction;
use crate::units::Turns;

impl Odometry {
    /// The robot turned otherwise than the last tick's counters say, which were `delta`.
    ///
    /// The heading takes the whole of it. The way of that tick loses what the slipping wheel did not
    /// roll: a wheel can only have moved the robot less than it turned, so the sign of the difference
    /// names the wheel that slipped; where it may be either, what both lost cancels. Half the
    /// difference of the wheels' ways is π·track for a turn, and half of a wheel's own way is the most
    /// that its slip can take.
    pub fn slipped(&mut self, correction: Correction, delta: &Delta) {
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

//! The target in the robot's frame.

use super::BRAKING_TICKS;
use crate::motion::trig::{direction, sin_cos};
use crate::types::{Delta, Pose};

/// Fractional bits of a tracking error's lengths in millimetres: resolution 8 µm, range 8 km.
pub(super) const FRACTION_BITS: u32 = 7;

/// Target pose less actual pose, in the robot's frame.
#[derive(Clone, Copy, Debug)]
pub(super) struct TrackingError {
    /// Ahead, 2⁻⁷ mm.
    pub longitudinal: i32,
    /// To the left, 2⁻⁷ mm.
    pub lateral: i32,
    /// Counter-clockwise, 2⁻³² turns.
    pub heading: i32,
}

/// Difference along one axis, both 2⁻³² mm, in 2⁻⁷ mm and cut to ±2³⁰ of these.
fn difference(target: i64, pose: i64) -> i32 {
    // Of halves, so that it does not overflow.
    let half = (target >> 1) - (pose >> 1);
    let whole = ((half >> 32) as i32).clamp(-(1 << 22), (1 << 22) - 1);
    whole << (FRACTION_BITS + 1) | (half as u32 >> (31 - FRACTION_BITS)) as i32
}

impl TrackingError {
    /// Total: the poses may lie anywhere.
    pub fn new(pose: &Pose, target: &Pose) -> Self {
        let x = i64::from(difference(target.x.0.to_bits(), pose.x.0.to_bits()));
        let y = i64::from(difference(target.y.0.to_bits(), pose.y.0.to_bits()));
        let (sine, cosine) = sin_cos(pose.heading);
        let (sine, cosine) = (i64::from(sine), i64::from(cosine));
        // A rotated vector of ±2³⁰ is within ±2³¹, and its square below 2⁶².
        Self {
            longitudinal: ((x * cosine + y * sine) >> 31) as i32,
            lateral: ((y * cosine - x * sine) >> 31) as i32,
            heading: target.heading.from_nearest(pose.heading),
        }
    }

    /// Whether the target is at most `distance`, 2⁻⁷ mm, away.
    // One copy in flash.
    #[inline(never)]
    pub fn within(&self, distance: i32) -> bool {
        let square = |side: i32| i64::from(side) * i64::from(side);
        square(self.longitudinal) + square(self.lateral) <= square(distance)
    }

    /// Longitudinal error that remains if both motors brake now, 2⁻⁷ mm.
    pub fn after_braking(&self, delta: &Delta) -> i32 {
        let rolls = delta.travel.to_bits().saturating_mul(BRAKING_TICKS) >> (16 - FRACTION_BITS);
        self.longitudinal.saturating_sub(rolls)
    }

    /// Whether the robot, braked now, comes to rest within `distance`, 2⁻⁷ mm, and `angle`,
    /// 2⁻³² turns, of the target.
    pub fn stops_within(&self, delta: &Delta, distance: i32, angle: i32) -> bool {
        let heading = self
            .heading
            .saturating_sub(delta.turn.saturating_mul(BRAKING_TICKS));
        self.within(distance)
            && self.after_braking(delta).saturating_abs() <= distance
            && heading.saturating_abs() <= angle
    }

    /// Turn that points the nose, or in `reverse` the tail, at the target, 2⁻³² turns.
    pub fn bearing(&self, reverse: bool) -> i32 {
        let (x, y) = (i64::from(self.longitudinal), i64::from(self.lateral));
        let bearing = if reverse {
            direction(-x, -y)
        } else {
            direction(x, y)
        };
        bearing.0 as i32
    }
}

#[cfg(test)]
mod tests;

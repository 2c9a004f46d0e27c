//! The target in the robot's own frame.

use super::BRAKING;
use crate::motion::trig::{direction, sin_cos};
use crate::types::{Delta, Pose};

/// Where the target lies as the robot sees it.
#[derive(Clone, Copy, Debug)]
pub(super) struct View {
    /// [`UNIT`]s ahead.
    pub along: i32,
    /// [`UNIT`]s to the left.
    pub across: i32,
    /// 2⁻³² turns to the final rotation.
    pub rotation: i32,
}

/// Fractional bits of a view's lengths in millimetres: 8 µm, an eighth of what a count of the first
/// board's encoders is worth, up to 8 km.
pub(super) const UNIT: u32 = 7;

/// From `pose` to `target` along one axis, 2⁻³² mm each, cut to ±2³⁰ [`UNIT`]s.
#[inline]
fn way(target: i64, pose: i64) -> i32 {
    // Of halves, so that no difference overflows.
    let way = (target >> 1) - (pose >> 1);
    let whole = ((way >> 32) as i32).clamp(-(1 << 22), (1 << 22) - 1);
    whole << (UNIT + 1) | (way as u32 >> (31 - UNIT)) as i32
}

impl View {
    /// Total: poses may lie anywhere.
    pub fn new(pose: &Pose, target: &Pose) -> Self {
        let x = i64::from(way(target.x.0.to_bits(), pose.x.0.to_bits()));
        let y = i64::from(way(target.y.0.to_bits(), pose.y.0.to_bits()));
        let (sine, cosine) = sin_cos(pose.heading);
        let (sine, cosine) = (i64::from(sine), i64::from(cosine));
        // Turned by any angle, a vector of ±2³⁰ is within ±2³¹, and its square below 2⁶².
        Self {
            along: ((x * cosine + y * sine) >> 31) as i32,
            across: ((y * cosine - x * sine) >> 31) as i32,
            rotation: target.heading.from_nearest(pose.heading),
        }
    }

    /// Not farther than `distance`, [`UNIT`]s.
    pub fn within(&self, distance: i32) -> bool {
        let square = |side: i32| i64::from(side) * i64::from(side);
        square(self.along) + square(self.across) <= square(distance)
    }

    /// What would be left ahead if both motors braked now, [`UNIT`]s.
    pub fn left_ahead(&self, delta: &Delta) -> i32 {
        let rolls = delta.travel.to_bits().saturating_mul(BRAKING) >> (16 - UNIT);
        self.along.saturating_sub(rolls)
    }

    /// Whether the robot, braked now, would come to rest within `near`, [`UNIT`]s, and `straight`,
    /// 2⁻³² turns, of the target.
    pub fn stops(&self, delta: &Delta, near: i32, straight: i32) -> bool {
        let left = self
            .rotation
            .saturating_sub(delta.turn.saturating_mul(BRAKING));
        self.within(near)
            && self.left_ahead(delta).saturating_abs() <= near
            && left.saturating_abs() <= straight
    }

    /// What the nose, or the tail, must turn by to point there, 2⁻³² turns.
    pub fn bearing(&self, backwards: bool) -> i32 {
        let (along, across) = (i64::from(self.along), i64::from(self.across));
        let nose = if backwards {
            direction(-along, -across)
        } else {
            direction(along, across)
        };
        nose.0 as i32
    }
}

#[cfg(test)]
mod tests;

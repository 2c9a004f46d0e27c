//! The target in the robot's own frame.

use super::BRAKING;
use crate::motion::odometry::Delta;
use crate::motion::trig::{direction, sin_cos};
use crate::units::Pose;

/// Where the target lies as the robot sees it.
#[derive(Clone, Copy, Debug)]
pub(super) struct View {
    /// 2⁻¹⁶ mm ahead.
    pub along: i64,
    /// 2⁻¹⁶ mm to the left.
    pub across: i64,
    /// 2⁻³² turns to the final rotation.
    pub rotation: i32,
}

impl View {
    /// Total: poses may lie anywhere.
    pub fn new(pose: &Pose, target: &Pose) -> Self {
        // ±2³¹ mm each, cut to ±2¹⁴ m so that the sums below fit.
        let far = 1 << 40;
        let x = target.x.0.to_bits().saturating_sub(pose.x.0.to_bits()) >> 16;
        let y = target.y.0.to_bits().saturating_sub(pose.y.0.to_bits()) >> 16;
        let (x, y) = (x.clamp(-far, far) >> 4, y.clamp(-far, far) >> 4);
        let (sine, cosine) = sin_cos(pose.heading);
        let (sine, cosine) = (i64::from(sine) >> 6, i64::from(cosine) >> 6);
        Self {
            along: (x * cosine + y * sine) >> 21,
            across: (y * cosine - x * sine) >> 21,
            rotation: target.heading.from_nearest(pose.heading),
        }
    }

    /// Not farther than `distance`, 2⁻¹⁶ mm.
    pub fn within(&self, distance: i64) -> bool {
        let (a, b) = (self.along.abs(), self.across.abs());
        a <= distance && b <= distance && a * a + b * b <= distance * distance
    }

    /// What would be left ahead if both motors braked now, 2⁻¹⁶ mm.
    pub fn left_ahead(&self, delta: &Delta) -> i64 {
        self.along - i64::from(delta.travel.to_bits()) * i64::from(BRAKING)
    }

    /// Whether the robot, braked now, would come to rest within `near`, 2⁻¹⁶ mm, and `straight`,
    /// 2⁻³² turns, of the target.
    pub fn stops(&self, delta: &Delta, near: i64, straight: i32) -> bool {
        let left = self
            .rotation
            .saturating_sub(delta.turn.saturating_mul(BRAKING));
        self.within(near)
            && self.left_ahead(delta).abs() <= near
            && left.saturating_abs() <= straight
    }

    /// What the nose, or the tail, must turn by to point there, 2⁻³² turns.
    pub fn bearing(&self, backwards: bool) -> i32 {
        let nose = if backwards {
            direction(-self.along, -self.across)
        } else {
            direction(self.along, self.across)
        };
        nose.0 as i32
    }
}

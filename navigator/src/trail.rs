//! What was driven: the way, the net rotation, and how far back is safe.

use geometry::{Point, Pose2};

/// Spacing of the way's points, mm.
const SPACING_MM: f64 = 50.0;
/// Floor this near to the way was driven over before, mm.
const AGAIN_MM: f64 = 20.0;
/// A straight way keeps its direction within this, radians.
const STRAIGHT_RAD: f64 = 0.12;
/// Farthest way back, mm: mode 0x30 reverses no farther.
const FARTHEST_BACK_MM: f64 = 280.0;

/// The driven way in the map's frame.
#[derive(Clone, Debug, Default)]
pub(crate) struct Trail {
    /// Points of the way; where it repeats itself, once.
    pub points: Vec<Point>,
    /// Sum of all turns, radians counter-clockwise.
    pub net_rad: f64,
    last: Option<Pose2>,
    /// Where the present straight way began and how far it reached, mm.
    straight: (Pose2, f64),
}

impl Trail {
    /// Takes the pose of a frame.
    pub fn observe(&mut self, pose: &Pose2) {
        let at = pose.position();
        let is_apart = |off: Point| off.dot(off) > AGAIN_MM * AGAIN_MM;
        if let Some(last) = self.last.replace(*pose) {
            self.net_rad += last.turn_to_rad(pose);
        } else {
            self.straight.0 = *pose;
        }
        if self
            .points
            .last()
            .is_none_or(|last| last.distance_mm(at) >= SPACING_MM)
            && self.points.iter().all(|&old| is_apart(old - at))
        {
            self.points.push(at);
        }
        if self.straight.0.turn_to_rad(pose).abs() > STRAIGHT_RAD {
            self.straight = (*pose, 0.0);
        }
        self.straight.1 = pose.relative_to(&self.straight.0).x_mm;
    }

    /// The way, but for where a body of this radius would now meet one of these obstacles that came later: well
    /// within the body as it passed. Farther out, an error of the map is as likely.
    pub fn open(&self, obstacles: &[Point], body_mm: f64) -> Vec<Point> {
        let near = |at: Point, to: Point, mm: f64| at.distance_mm(to) < mm;
        let is_later = |to: &&Point| self.points.iter().any(|&at| near(at, **to, body_mm / 2.0));
        let later: Vec<Point> = obstacles.iter().filter(is_later).copied().collect();
        let meets = |at: &&Point| later.iter().any(|&to| near(**at, to, body_mm));
        self.points
            .iter()
            .filter(|at| !meets(at))
            .copied()
            .collect()
    }

    /// How far the robot can go back over floor that it has just driven over, mm.
    pub fn reversible_mm(&self) -> f64 {
        self.straight.1.clamp(0.0, FARTHEST_BACK_MM)
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn way_back_ends_where_straight_way_began() {
        let mut trail = Trail::default();
        for step in 0..=20 {
            trail.observe(&Pose2::new(10.0 * f64::from(step), 0.0, 0.0));
        }
        assert!((trail.reversible_mm() - 200.0).abs() < 1e-9);
        trail.observe(&Pose2::new(120.0, 0.0, 0.0));
        assert!((trail.reversible_mm() - 120.0).abs() < 1e-9);
        trail.observe(&Pose2::new(120.0, 0.0, 0.15));
        assert!(trail.reversible_mm() < 1e-9);
        trail.observe(&Pose2::new(120.0, 0.0, 0.5));
        assert_eq!(trail.points.len(), 5);
        let turned = Pose2::new(120.0, 0.0, 0.5);
        for (mm, back_mm) in [(100.0, 100.0), (400.0, FARTHEST_BACK_MM)] {
            let Point { x_mm, y_mm } = turned.point_at(mm, 0.0);
            trail.observe(&Pose2::new(x_mm, y_mm, 0.5));
            assert!((trail.reversible_mm() - back_mm).abs() < 1e-9);
        }
    }

    #[test]
    fn net_rotation_counts_whole_turns() {
        let mut trail = Trail::default();
        for step in 0..=40 {
            trail.observe(&Pose2::new(
                0.0,
                0.0,
                geometry::wrap_angle(0.3 * f64::from(step)),
            ));
        }
        assert!((trail.net_rad - 12.0).abs() < 1e-9);
    }
}

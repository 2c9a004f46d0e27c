//! Where the robot is.

/// Position of the middle of the axle and direction of travel.
#[derive(Clone, Copy, Debug, Default, PartialEq)]
pub struct Pose {
    /// Millimetres along the frame's x.
    pub x_mm: f64,
    /// Millimetres along the frame's y.
    pub y_mm: f64,
    /// Radians, counter-clockwise from the frame's x; not wrapped.
    pub heading_rad: f64,
}

impl Pose {
    /// A pose from millimetres and radians.
    #[must_use]
    pub const fn new(x_mm: f64, y_mm: f64, heading_rad: f64) -> Self {
        Self {
            x_mm,
            y_mm,
            heading_rad,
        }
    }

    /// The point (`ahead`, `left`) of this pose's own frame, in the frame the pose is in (mm).
    #[must_use]
    pub fn point(&self, ahead: f64, left: f64) -> (f64, f64) {
        let (sin, cos) = self.heading_rad.sin_cos();
        (
            self.x_mm + ahead * cos - left * sin,
            self.y_mm + ahead * sin + left * cos,
        )
    }

    /// This pose seen from `origin`: what odometry that was reset at `origin` calls it.
    #[must_use]
    pub fn seen_from(&self, origin: &Self) -> Self {
        let (dx, dy) = (self.x_mm - origin.x_mm, self.y_mm - origin.y_mm);
        let (sin, cos) = origin.heading_rad.sin_cos();
        Self::new(
            dx * cos + dy * sin,
            dy * cos - dx * sin,
            self.heading_rad - origin.heading_rad,
        )
    }

    /// The inverse of [`Pose::seen_from`]: `self` is in `origin`'s frame, the result in the frame
    /// that `origin` is in.
    #[must_use]
    pub fn placed_at(&self, origin: &Self) -> Self {
        let (x, y) = origin.point(self.x_mm, self.y_mm);
        Self::new(x, y, origin.heading_rad + self.heading_rad)
    }

    /// The pose after the wheels rolled `left` and `right` millimetres along circular arcs, wheels
    /// `track` millimetres apart. Exact for a constant ratio of the two.
    #[must_use]
    pub fn rolled(&self, left: f64, right: f64, track: f64) -> Self {
        let turn = (right - left) / track;
        let half = turn / 2.0;
        // sin(h)/h, by its series where the quotient would lose its digits.
        let sinc = if half.abs() < 1e-3 {
            1.0 - half * half / 6.0
        } else {
            half.sin() / half
        };
        let chord = f64::midpoint(left, right) * sinc;
        let (sin, cos) = (self.heading_rad + half).sin_cos();
        Self::new(
            self.x_mm + chord * cos,
            self.y_mm + chord * sin,
            self.heading_rad + turn,
        )
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use std::f64::consts::{FRAC_PI_2, PI};

    fn close(a: Pose, b: Pose) -> bool {
        (a.x_mm - b.x_mm).abs() < 1e-6
            && (a.y_mm - b.y_mm).abs() < 1e-6
            && (a.heading_rad - b.heading_rad).abs() < 1e-9
    }

    #[test]
    fn a_quarter_circle_ends_where_geometry_says() {
        // The left wheel stands, the right rolls a quarter of a circle of the track's radius.
        let end = Pose::default().rolled(0.0, 125.0 * FRAC_PI_2, 125.0);
        assert!(close(end, Pose::new(62.5, 62.5, FRAC_PI_2)));
    }

    #[test]
    fn one_arc_equals_a_thousand_pieces_of_it() {
        let start = Pose::new(10.0, -20.0, 1.0);
        let mut pieces = start;
        for _ in 0..1000 {
            pieces = pieces.rolled(0.3, 0.5, 125.0);
        }
        assert!(close(pieces, start.rolled(300.0, 500.0, 125.0)));
    }

    #[test]
    fn seen_from_and_placed_at_undo_each_other() {
        let origin = Pose::new(100.0, 200.0, 2.0);
        let pose = Pose::new(-30.0, 40.0, -1.0);
        assert!(close(pose.seen_from(&origin).placed_at(&origin), pose));
        assert!(close(origin.seen_from(&origin), Pose::default()));
        let ahead = Pose::new(0.0, 0.0, PI).point(5.0, 0.0);
        assert!((ahead.0 + 5.0).abs() < 1e-9);
    }
}

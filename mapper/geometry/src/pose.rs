//! Points, poses and angles.

use std::f64::consts::TAU;
use std::ops::{Add, Mul, Sub};

/// The angle in −π ..= π that differs from `radians` by whole turns.
pub fn wrap_angle(radians: f64) -> f64 {
    radians - TAU * (radians / TAU).round()
}

/// A point or a vector of the plane, millimetres.
#[derive(Clone, Copy, Debug, Default, PartialEq)]
pub struct Point {
    /// Millimetres along x.
    pub x_mm: f64,
    /// Millimetres along y.
    pub y_mm: f64,
}

impl Point {
    /// A point from millimetres.
    pub const fn new(x_mm: f64, y_mm: f64) -> Self {
        Self { x_mm, y_mm }
    }

    /// Distance to another point, mm.
    #[must_use]
    pub fn distance_mm(self, other: Self) -> f64 {
        (self - other).length_mm()
    }

    /// The point at `share` (0 = here, 1 = `other`) of the straight line to `other`.
    #[must_use]
    pub fn lerp(self, other: Self, share: f64) -> Self {
        self + (other - self) * share
    }

    /// Length of the vector, mm.
    pub fn length_mm(self) -> f64 {
        libm::hypot(self.x_mm, self.y_mm)
    }

    /// The vector's direction, radians counter-clockwise from x.
    pub fn angle_rad(self) -> f64 {
        libm::atan2(self.y_mm, self.x_mm)
    }

    /// The scalar product, mm².
    pub fn dot(self, other: Self) -> f64 {
        self.x_mm * other.x_mm + self.y_mm * other.y_mm
    }

    /// The z of the vector product, mm²: positive where `other` lies counter-clockwise.
    pub fn cross(self, other: Self) -> f64 {
        self.x_mm * other.y_mm - self.y_mm * other.x_mm
    }

    /// The smallest and the largest x and y of some points; `None` without points.
    pub fn bounds(points: impl Iterator<Item = Self>) -> Option<(Self, Self)> {
        let both = points.map(|point| (point, point));
        both.reduce(|(low, high), (p, _)| {
            let low = Self::new(low.x_mm.min(p.x_mm), low.y_mm.min(p.y_mm));
            (low, Self::new(high.x_mm.max(p.x_mm), high.y_mm.max(p.y_mm)))
        })
    }
}

impl Add for Point {
    type Output = Self;

    fn add(self, other: Self) -> Self {
        Self::new(self.x_mm + other.x_mm, self.y_mm + other.y_mm)
    }
}

impl Sub for Point {
    type Output = Self;

    fn sub(self, other: Self) -> Self {
        Self::new(self.x_mm - other.x_mm, self.y_mm - other.y_mm)
    }
}

impl Mul<f64> for Point {
    type Output = Self;

    fn mul(self, factor: f64) -> Self {
        Self::new(self.x_mm * factor, self.y_mm * factor)
    }
}

/// Position of the middle of the axle, and the direction of travel.
#[derive(Clone, Copy, Debug, Default, PartialEq)]
pub struct Pose2 {
    /// Millimetres along the frame's x.
    pub x_mm: f64,
    /// Millimetres along the frame's y.
    pub y_mm: f64,
    /// Radians counter-clockwise from the frame's x, not wrapped.
    pub heading_rad: f64,
}

impl Pose2 {
    /// A pose from millimetres and radians.
    pub const fn new(x_mm: f64, y_mm: f64, heading_rad: f64) -> Self {
        Self {
            x_mm,
            y_mm,
            heading_rad,
        }
    }

    /// A pose at a point.
    pub const fn at(Point { x_mm, y_mm }: Point, heading_rad: f64) -> Self {
        Self::new(x_mm, y_mm, heading_rad)
    }

    /// The same position with another heading.
    #[must_use]
    pub const fn facing(&self, heading_rad: f64) -> Self {
        Self::at(self.position(), heading_rad)
    }

    /// Where it is.
    pub const fn position(&self) -> Point {
        Point::new(self.x_mm, self.y_mm)
    }

    /// The unit vector along the heading.
    pub fn direction(&self) -> Point {
        let (sin, cos) = libm::sincos(self.heading_rad);
        Point::new(cos, sin)
    }

    /// The point `ahead_mm` ahead and `left_mm` to the left, in the frame this pose is in.
    pub fn point_at(&self, ahead_mm: f64, left_mm: f64) -> Point {
        let Point { x_mm, y_mm } = self.direction();
        self.position() + Point::new(x_mm, y_mm) * ahead_mm + Point::new(-y_mm, x_mm) * left_mm
    }

    /// `local`, which is given in this pose's own frame, in the frame this pose is in.
    #[must_use]
    pub fn compose(&self, local: &Self) -> Self {
        let heading_rad = self.heading_rad + local.heading_rad;
        Self::at(self.point_at(local.x_mm, local.y_mm), heading_rad)
    }

    /// This pose in the frame of `origin`, the inverse of [`Pose2::compose`]: what an odometry
    /// reset at `origin` reports here.
    #[must_use]
    pub fn relative_to(&self, origin: &Self) -> Self {
        let (way, ahead) = (self.position() - origin.position(), origin.direction());
        let heading_rad = self.heading_rad - origin.heading_rad;
        Self::new(ahead.dot(way), ahead.cross(way), heading_rad)
    }

    /// The pose after the wheels, `track_mm` apart, roll these millimetres along circular arcs.
    /// Exact for a constant ratio of the two.
    #[must_use]
    pub fn advance_arc(&self, left_mm: f64, right_mm: f64, track_mm: f64) -> Self {
        let turn = (right_mm - left_mm) / track_mm;
        let half = turn / 2.0;
        // sin(h)/h by its series where the quotient loses digits.
        let sinc = if half.abs() < 1e-3 {
            1.0 - half * half / 6.0
        } else {
            libm::sin(half) / half
        };
        let chord = f64::midpoint(left_mm, right_mm) * sinc;
        let middle = self.facing(self.heading_rad + half);
        Self::at(middle.point_at(chord, 0.0), self.heading_rad + turn)
    }

    /// Distance between the positions, mm.
    pub fn distance_mm(&self, other: &Self) -> f64 {
        self.position().distance_mm(other.position())
    }

    /// The turn from this heading to that of `other`, radians in −π ..= π.
    pub fn turn_to_rad(&self, other: &Self) -> f64 {
        wrap_angle(other.heading_rad - self.heading_rad)
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use std::f64::consts::{FRAC_PI_2, PI};

    fn assert_close(a: Pose2, b: Pose2) {
        let turn = (a.heading_rad - b.heading_rad).abs();
        assert!(a.distance_mm(&b) < 1e-6 && turn < 1e-9, "{a:?} {b:?}");
    }

    #[test]
    fn arc_of_one_wheel_ends_on_circle_around_the_other() {
        let end = Pose2::default().advance_arc(0.0, 125.0 * FRAC_PI_2, 125.0);
        assert_close(end, Pose2::new(62.5, 62.5, FRAC_PI_2));
    }

    #[test]
    fn arc_equals_sum_of_its_pieces() {
        let start = Pose2::new(10.0, -20.0, 1.0);
        let mut pieces = start;
        for _ in 0..1000 {
            pieces = pieces.advance_arc(0.3, 0.5, 125.0);
        }
        assert_close(pieces, start.advance_arc(300.0, 500.0, 125.0));
    }

    #[test]
    fn compose_and_relative_to_are_inverse() {
        let origin = Pose2::new(100.0, 200.0, 2.0);
        let pose = Pose2::new(-30.0, 40.0, -1.0);
        assert_close(origin.compose(&pose.relative_to(&origin)), pose);
        assert_close(origin.relative_to(&origin), Pose2::default());
    }

    #[test]
    fn angles_wrap_into_half_a_turn() {
        for (radians, wrapped) in [(0.5, 0.5), (3.0 * PI - 0.1, PI - 0.1), (-4.0, TAU - 4.0)] {
            assert!((wrap_angle(radians) - wrapped).abs() < 1e-12);
        }
        let ahead = Pose2::new(0.0, 0.0, 6.0).turn_to_rad(&Pose2::new(1.0, 1.0, 0.0));
        assert!((ahead - (TAU - 6.0)).abs() < 1e-12);
    }
}

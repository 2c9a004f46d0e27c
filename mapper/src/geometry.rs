//! Poses, mounts and walls.

/// Where the robot believes to be: the middle of its axle.
#[derive(Clone, Copy, Debug, Default, PartialEq)]
pub struct Pose {
    /// Millimetres.
    pub x_mm: f64,
    /// Millimetres.
    pub y_mm: f64,
    /// Radians, counter-clockwise from x.
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
}

/// Where a rangefinder sits on the robot and where it looks.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Mount {
    /// Millimetres ahead of the middle of the axle.
    pub ahead_mm: f64,
    /// Millimetres to the left of the middle of the axle.
    pub left_mm: f64,
    /// Radians from straight ahead, counter-clockwise.
    pub bearing_rad: f64,
}

impl Mount {
    /// The first board's front, right and left rangefinder, in the order of the frame.
    #[must_use]
    pub const fn first_board() -> [Self; 3] {
        use std::f64::consts::FRAC_PI_2;
        [
            Self {
                ahead_mm: 80.0,
                left_mm: 0.0,
                bearing_rad: 0.0,
            },
            Self {
                ahead_mm: 0.0,
                left_mm: -60.0,
                bearing_rad: -FRAC_PI_2,
            },
            Self {
                ahead_mm: 0.0,
                left_mm: 60.0,
                bearing_rad: FRAC_PI_2,
            },
        ]
    }

    /// The sensor's own pose on a robot at `robot`.
    #[must_use]
    pub fn on(&self, robot: &Pose) -> Pose {
        let (sin, cos) = robot.heading_rad.sin_cos();
        Pose::new(
            robot.x_mm + self.ahead_mm * cos - self.left_mm * sin,
            robot.y_mm + self.ahead_mm * sin + self.left_mm * cos,
            robot.heading_rad + self.bearing_rad,
        )
    }
}

/// A straight piece of a true wall, mm.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Segment {
    /// One end's x.
    pub x1: f64,
    /// One end's y.
    pub y1: f64,
    /// The other end's x.
    pub x2: f64,
    /// The other end's y.
    pub y2: f64,
}

impl Segment {
    /// A segment from end to end.
    #[must_use]
    pub const fn new(x1: f64, y1: f64, x2: f64, y2: f64) -> Self {
        Self { x1, y1, x2, y2 }
    }

    /// Length, mm.
    #[must_use]
    pub fn length(&self) -> f64 {
        (self.x2 - self.x1).hypot(self.y2 - self.y1)
    }

    /// The point at `part` (0..=1) of the way.
    #[must_use]
    pub fn at(&self, part: f64) -> (f64, f64) {
        (
            self.x1 + part * (self.x2 - self.x1),
            self.y1 + part * (self.y2 - self.y1),
        )
    }

    /// Distance of a point to the nearest point of the segment, mm.
    #[must_use]
    pub fn distance(&self, x: f64, y: f64) -> f64 {
        let (dx, dy) = (self.x2 - self.x1, self.y2 - self.y1);
        let square = dx * dx + dy * dy;
        let along = (x - self.x1) * dx + (y - self.y1) * dy;
        let (px, py) = self.at(if square > 0.0 {
            (along / square).clamp(0.0, 1.0)
        } else {
            0.0
        });
        (x - px).hypot(y - py)
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_mount_moves_and_turns_with_the_robot() {
        let robot = Pose::new(100.0, 200.0, std::f64::consts::FRAC_PI_2);
        let [front, right, left] = Mount::first_board().map(|mount| mount.on(&robot));
        assert!((front.x_mm - 100.0).abs() < 1e-9 && (front.y_mm - 280.0).abs() < 1e-9);
        assert!((right.x_mm - 160.0).abs() < 1e-9 && right.heading_rad.abs() < 1e-9);
        assert!((left.x_mm - 40.0).abs() < 1e-9 && (left.y_mm - 200.0).abs() < 1e-9);
    }
}

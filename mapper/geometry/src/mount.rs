//! Where a sensor sits on the robot.

use std::f64::consts::FRAC_PI_2;

use crate::Pose2;

/// Position and direction of a rangefinder in the robot's frame.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Mount {
    /// Millimetres ahead of the middle of the axle.
    pub ahead_mm: f64,
    /// Millimetres to the left of the middle of the axle.
    pub left_mm: f64,
    /// Radians counter-clockwise from straight ahead.
    pub bearing_rad: f64,
}

impl Mount {
    /// A mount from millimetres and radians.
    pub const fn new(ahead_mm: f64, left_mm: f64, bearing_rad: f64) -> Self {
        Self {
            ahead_mm,
            left_mm,
            bearing_rad,
        }
    }

    /// Front, right and left rangefinder of the first board, in the order of the frame, on a body of 100 mm
    /// radius. The distances from the axle's middle are assumptions.
    pub const fn first_board() -> [Self; 3] {
        Self::on_body(100.0, 20.0)
    }

    /// The same on a body of another radius, its front edge so far ahead of the front rangefinder, mm.
    pub const fn on_body(radius_mm: f64, overhang_mm: f64) -> [Self; 3] {
        let aside_mm = radius_mm - 40.0;
        [
            Self::new(radius_mm - overhang_mm, 0.0, 0.0),
            Self::new(0.0, -aside_mm, -FRAC_PI_2),
            Self::new(0.0, aside_mm, FRAC_PI_2),
        ]
    }

    /// Pose of the sensor on a robot at `robot`.
    pub fn sensor_pose(&self, robot: &Pose2) -> Pose2 {
        robot.compose(&Pose2::new(self.ahead_mm, self.left_mm, self.bearing_rad))
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::Point;

    #[test]
    fn mounts_of_first_board_face_front_right_left() {
        let robot = Pose2::new(100.0, 200.0, FRAC_PI_2);
        let sensors = Mount::first_board().map(|mount| mount.sensor_pose(&robot));
        let expected = [(100.0, 280.0), (160.0, 200.0), (40.0, 200.0)];
        for (sensor, (x, y)) in sensors.iter().zip(expected) {
            assert!(sensor.position().distance_mm(Point::new(x, y)) < 1e-9);
        }
        assert!(sensors[1].heading_rad.abs() < 1e-9);
    }
}

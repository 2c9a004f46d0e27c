//! Wheels and track: how turning wheels move the robot.

use crate::{Pose, Sides};

/// The mechanical figures of a robot.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Chassis {
    /// True wheel diameters, mm. Unequal ones are an odometry error for the firmware to live with.
    pub wheel_diameter_mm: Sides<f64>,
    /// True distance between the wheels' contact lines, mm.
    pub track_mm: f64,
    /// Encoder counts per wheel turn, both channels and both edges.
    pub counts_per_turn: f64,
    /// Which way each encoder counts when its wheel rolls forward: +1 or −1.
    pub encoder_sign: Sides<f64>,
    /// Radius of the circle about the middle of the axle that the body fits in, mm.
    pub radius_mm: f64,
}

impl Default for Chassis {
    /// The first board: 80 mm, 125 mm, 3840 counts, both encoders counting down going forward.
    /// The body's radius is a choice.
    fn default() -> Self {
        Self {
            wheel_diameter_mm: Sides::new(80.0, 80.0),
            track_mm: 125.0,
            counts_per_turn: 3840.0,
            encoder_sign: Sides::new(-1.0, -1.0),
            radius_mm: 100.0,
        }
    }
}

impl Chassis {
    /// Millimetres that the wheels roll when they turn by these degrees.
    #[must_use]
    pub fn travel(&self, turned_deg: Sides<f64>) -> Sides<f64> {
        let per_degree = std::f64::consts::PI / 360.0;
        Sides::new(
            turned_deg.left * self.wheel_diameter_mm.left * per_degree,
            turned_deg.right * self.wheel_diameter_mm.right * per_degree,
        )
    }

    /// Encoder counts, signed as the encoders count, for wheels that turn by these degrees.
    #[must_use]
    pub fn counts(&self, turned_deg: Sides<f64>) -> Sides<f64> {
        let per_degree = self.counts_per_turn / 360.0;
        Sides::new(
            turned_deg.left * per_degree * self.encoder_sign.left,
            turned_deg.right * per_degree * self.encoder_sign.right,
        )
    }

    /// The pose after the wheels rolled these millimetres.
    #[must_use]
    pub fn roll(&self, pose: &Pose, travel: Sides<f64>) -> Pose {
        pose.rolled(travel.left, travel.right, self.track_mm)
    }
}

//! Wheels, encoders and track: how turning wheels move the robot.

use std::f64::consts::PI;

use crate::{Pose2, Sides};

/// The mechanical figures of a robot.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Chassis {
    /// True wheel diameters, mm.
    pub wheel_diameter_mm: Sides<f64>,
    /// True distance between the wheels' contact lines, mm.
    pub track_mm: f64,
    /// Encoder counts per wheel turn, both channels and both edges.
    pub counts_per_turn: f64,
    /// Radius of the body's bounding circle about the middle of the axle, mm.
    pub radius_mm: f64,
}

impl Default for Chassis {
    /// The first board: 80 mm, 125 mm, 3840 counts. The body's radius is an assumption.
    fn default() -> Self {
        Self {
            wheel_diameter_mm: Sides::new(80.0, 80.0),
            track_mm: 125.0,
            counts_per_turn: 3840.0,
            radius_mm: 100.0,
        }
    }
}

impl Chassis {
    /// Millimetres that the wheels roll when they turn by these degrees.
    pub fn travel(&self, turned_deg: Sides<f64>) -> Sides<f64> {
        let wheels = turned_deg.zip(self.wheel_diameter_mm);
        wheels.map(|(degrees, diameter)| degrees * diameter * PI / 360.0)
    }

    /// Encoder counts for wheels that turn by these degrees: as on the first board, both encoders count
    /// down going forward.
    pub fn counts(&self, turned_deg: Sides<f64>) -> Sides<f64> {
        turned_deg.map(|degrees| -degrees * self.counts_per_turn / 360.0)
    }

    /// The pose after the wheels rolled these millimetres.
    pub fn roll(&self, pose: &Pose2, travel: Sides<f64>) -> Pose2 {
        pose.advance_arc(travel.left, travel.right, self.track_mm)
    }
}

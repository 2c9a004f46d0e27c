//! A run as the distances that its wheels rolled: with other diameters and another track the same
//! turns of the wheels end elsewhere.

use super::wheel_geometry::WheelGeometry;
use crate::ground_truth::Point;
use host_link::pose::Pose;
use mapper::Pose2;
use serde::{Deserialize, Serialize};

/// The wheel distances of a run, report by report.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
pub struct WheelPath {
    /// The wheels the robot was configured with.
    wheels: WheelGeometry,
    /// Millimetres that the left and the right wheel rolled by those wheels' figures.
    rolled: Vec<(f64, f64)>,
    #[serde(skip)]
    last: Option<Pose>,
}

/// Reports closer together than this are one. Half the wire's rotation code is 0.005°.
const STANDSTILL_MM: f64 = 0.002;

impl WheelPath {
    /// An empty path of a robot configured with `wheels`.
    pub const fn new(wheels: WheelGeometry) -> Self {
        Self {
            wheels,
            rolled: Vec::new(),
            last: None,
        }
    }

    /// Adds the next reported pose.
    pub fn push(&mut self, now: Pose) {
        let Some(before) = self.last else {
            self.last = Some(now);
            return;
        };
        let turn = before.rotation_to_deg(now).to_radians();
        let middle = before.rotation_deg.to_radians() + turn / 2.0;
        let (dx, dy) = (now.x_mm - before.x_mm, now.y_mm - before.y_mm);
        let chord = dx * middle.cos() + dy * middle.sin();
        let arc = chord / chord_per_arc(turn);
        let difference = self.wheels.track_mm * turn / 2.0;
        if arc.abs() + difference.abs() < STANDSTILL_MM {
            // Kept as the last pose only when it moved, so that a creep adds up.
            return;
        }
        self.rolled.push((arc - difference, arc + difference));
        self.last = Some(now);
    }

    /// Whether it moved at all.
    pub fn moved(&self) -> bool {
        !self.rolled.is_empty()
    }

    /// The wheels the robot was configured with.
    pub const fn wheels(&self) -> &WheelGeometry {
        &self.wheels
    }

    /// The end by the robot's own odometry.
    pub fn odometry_end(&self) -> Point {
        self.end_with(&self.wheels)
    }

    /// The end if the wheels are truly these: every piece an exact arc.
    pub fn end_with(&self, wheels: &WheelGeometry) -> Point {
        let left_scale = wheels.left_mm / self.wheels.left_mm;
        let right_scale = wheels.right_mm / self.wheels.right_mm;
        let mut end = Pose2::default();
        for (left, right) in &self.rolled {
            end = end.advance_arc(left * left_scale, right * right_scale, wheels.track_mm);
        }
        Point::new(end.x_mm, end.y_mm)
    }
}

/// Length of a chord over that of its arc: sin(h)/h of half the turn, radians.
fn chord_per_arc(turn: f64) -> f64 {
    let half = turn / 2.0;
    if half.abs() < 1e-3 {
        1.0 - half * half / 6.0
    } else {
        half.sin() / half
    }
}

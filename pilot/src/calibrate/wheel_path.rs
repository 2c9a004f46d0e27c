//! What the robot believed it drove, as what its wheels rolled: with other diameters and another
//! track the same turns of the wheels end elsewhere.

use super::wheel_geometry::Geometry;
pub use host_link::ground_truth::Spot;
use host_link::pose::Place;
use serde::{Deserialize, Serialize};

/// A run.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
pub struct Path {
    /// The figures the robot believed in.
    believed: Geometry,
    /// Millimetres that the left and the right wheel rolled by those figures, report by report.
    rolled: Vec<(f64, f64)>,
    #[serde(skip)]
    last: Option<Place>,
}

/// Reports closer together than this are one: it stood. Half the wire's rotation code is 0.005°.
const STILL_MM: f64 = 0.002;

impl Path {
    /// Of a robot that believes in these figures, where it stands.
    #[must_use]
    pub const fn new(believed: Geometry) -> Self {
        Self {
            believed,
            rolled: Vec::new(),
            last: None,
        }
    }

    /// The next pose that it reported.
    pub fn take(&mut self, now: Place) {
        let Some(before) = self.last else {
            self.last = Some(now);
            return;
        };
        let turn = before.turn_to_deg(now).to_radians();
        let middle = before.rotation_deg.to_radians() + turn / 2.0;
        let (dx, dy) = (now.x_mm - before.x_mm, now.y_mm - before.y_mm);
        let chord = dx * middle.cos() + dy * middle.sin();
        let arc = chord / shortened(turn);
        let across = self.believed.track_mm * turn / 2.0;
        if arc.abs() + across.abs() < STILL_MM {
            // Kept as the last pose only when it moved, so that a creep adds up.
            return;
        }
        self.rolled.push((arc - across, arc + across));
        self.last = Some(now);
    }

    /// Whether it moved at all.
    #[must_use]
    pub fn moved(&self) -> bool {
        !self.rolled.is_empty()
    }

    /// The figures the robot believed in.
    #[must_use]
    pub const fn believed(&self) -> &Geometry {
        &self.believed
    }

    /// Where the robot believed it ended.
    #[must_use]
    pub fn end(&self) -> Spot {
        self.end_with(&self.believed)
    }

    /// Where it ended if these are the true figures: every stretch an exact arc.
    #[must_use]
    pub fn end_with(&self, figures: &Geometry) -> Spot {
        let left = figures.left_mm / self.believed.left_mm;
        let right = figures.right_mm / self.believed.right_mm;
        let (mut x, mut y, mut heading) = (0.0, 0.0, 0.0_f64);
        for (one, other) in &self.rolled {
            let (one, other) = (one * left, other * right);
            let turn = (other - one) / figures.track_mm;
            let chord = f64::midpoint(one, other) * shortened(turn);
            let (sine, cosine) = (heading + turn / 2.0).sin_cos();
            x += chord * cosine;
            y += chord * sine;
            heading += turn;
        }
        Spot {
            ahead_mm: x,
            left_mm: y,
        }
    }
}

/// What part of its arc a chord is: sin(h)/h of half the turn.
fn shortened(turn: f64) -> f64 {
    let half = turn / 2.0;
    if half.abs() < 1e-3 {
        1.0 - half * half / 6.0
    } else {
        half.sin() / half
    }
}

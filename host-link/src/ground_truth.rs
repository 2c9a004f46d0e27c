//! Who measures where a run ended.

use serde::{Deserialize, Serialize};

/// Somebody beside the robot. On a real one that is a person, whom the program asks; the virtual robot
/// comes with a simulated one, who sees where it truly stands and knows nothing of its figures.
pub trait Tape {
    /// Puts the robot back on its marks, as it stood when it was first put there, without rolling a
    /// wheel.
    fn put_back(&mut self);

    /// Where it stands now, seen from its marks; every reading off by chance with this standard
    /// deviation, millimetres.
    fn measure(&mut self, deviation_mm: f64) -> Spot;
}

/// A point on the floor, seen from where a run began: the middle of the axle, millimetres.
#[derive(Clone, Copy, Debug, Default, PartialEq, Serialize, Deserialize)]
pub struct Spot {
    /// Ahead of where the robot stood.
    pub ahead_mm: f64,
    /// To its left.
    pub left_mm: f64,
}

impl Spot {
    /// Straight distance from the start.
    #[must_use]
    pub fn distance_mm(self) -> f64 {
        self.ahead_mm.hypot(self.left_mm)
    }

    /// From `other` to this.
    #[must_use]
    pub fn minus(self, other: Self) -> Self {
        Self {
            ahead_mm: self.ahead_mm - other.ahead_mm,
            left_mm: self.left_mm - other.left_mm,
        }
    }
}

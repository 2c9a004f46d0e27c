//! Where a run truly ended: a person with a tape, or the simulation.

use serde::{Deserialize, Serialize};

/// The simulated robot's true position. On a real one a person measures it and types it in.
pub trait GroundTruth {
    /// Puts the robot back on its marks, as it stood at the start, without rolling a wheel.
    fn put_back(&mut self);

    /// The robot's position seen from its marks; every reading has this standard deviation,
    /// millimetres.
    fn measure(&mut self, deviation_mm: f64) -> Point;
}

/// A point on the floor, seen from where a run began: the middle of the axle, millimetres.
#[derive(Clone, Copy, Debug, Default, PartialEq, Serialize, Deserialize)]
pub struct Point {
    /// Ahead of where the robot stood.
    pub ahead_mm: f64,
    /// To its left.
    pub left_mm: f64,
}

impl Point {
    /// A point so many millimetres ahead and to the left.
    pub const fn new(ahead_mm: f64, left_mm: f64) -> Self {
        Self { ahead_mm, left_mm }
    }

    /// Straight distance from the start, millimetres.
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

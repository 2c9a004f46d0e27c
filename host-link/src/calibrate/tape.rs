//! Who measures where a run ended.

use super::path::Spot;

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

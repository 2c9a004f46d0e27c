//! The quadrature encoders on the wheels.

/// One wheel's encoder: an exact, unwrapped position in counts.
#[derive(Clone, Copy, Debug, Default)]
pub(crate) struct Encoder {
    phase: f64,
}

impl Encoder {
    /// Follows the wheel by `counts` (signed as the encoder counts); a dead encoder does not move.
    pub(crate) fn turn(&mut self, counts: f64, dead: bool) {
        if !dead {
            self.phase += counts;
        }
    }

    /// Position in counts with its fraction.
    pub(crate) fn phase(self) -> f64 {
        self.phase
    }

    /// The whole count: a count changes where [`Encoder::phase`] passes an integer.
    #[allow(clippy::cast_possible_truncation)] // 2^63 counts are 600 million kilometres
    pub(crate) fn count(self) -> i64 {
        self.phase.floor() as i64
    }
}

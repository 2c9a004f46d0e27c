//! Reference odometry: exact arcs (document, 4.1). Angles are ratios of whole numbers, reduced exactly
//! modulo a turn; the rest is binary64 with compensated sums: errors below 10⁻⁶ µm per km.
//! `tests/bench` uses this file, too.

use std::f64::consts::{PI, TAU};

use super::{Config, Turns};

/// Compensated sum (Neumaier).
#[derive(Clone, Copy, Debug, Default)]
pub(super) struct Sum(f64, f64);

impl Sum {
    fn add(&mut self, value: f64) {
        let sum = self.0 + value;
        self.1 += if self.0.abs() >= value.abs() {
            (self.0 - sum) + value
        } else {
            (value - sum) + self.0
        };
        self.0 = sum;
    }

    /// The sum less `other`.
    pub fn less(self, other: f64) -> f64 {
        (self.0 - other) + self.1
    }
}

/// The reference.
pub(super) struct ExactArcs {
    left: i128,
    right: i128,
    pub config: Config,
    /// Millimetres.
    pub x: Sum,
    /// Millimetres.
    pub y: Sum,
}

impl ExactArcs {
    pub fn new(config: Config) -> Self {
        Self {
            left: 0,
            right: 0,
            config,
            x: Sum::default(),
            y: Sum::default(),
        }
    }

    /// Micrometres per count, and twice counts times track: a turn in these units.
    fn scale(&self) -> (i128, i128, i128) {
        let config = &self.config;
        let turn = 2 * i128::from(config.counts_per_turn()) * i128::from(config.track().0);
        let (left, right) = (config.left().diameter.0, config.right().diameter.0);
        (left.into(), right.into(), turn)
    }

    /// Counts the wheels rolled forward.
    pub fn step(&mut self, left: i64, right: i64) {
        let (left, right) = (i128::from(left), i128::from(right));
        let (left_diameter, right_diameter, turn) = self.scale();
        // β + ψ/2, in halves of the unit.
        let middle =
            (2 * self.right + right) * right_diameter - (2 * self.left + left) * left_diameter;
        let middle = middle.rem_euclid(2 * turn) as f64 / (2 * turn) as f64 * TAU;
        let half_psi = (right * right_diameter - left * left_diameter) as f64 / turn as f64 * PI;
        let path = (right * right_diameter + left * left_diameter) as f64 * PI
            / (2000.0 * f64::from(self.config.counts_per_turn()));
        let chord = if half_psi == 0.0 {
            path
        } else {
            path * half_psi.sin() / half_psi
        };
        self.x.add(chord * middle.cos());
        self.y.add(chord * middle.sin());
        self.left += left;
        self.right += right;
    }

    /// Nearest 2⁻³² turns.
    pub fn heading(&self) -> Turns {
        let (left_diameter, right_diameter, turn) = self.scale();
        let rest = (self.right * right_diameter - self.left * left_diameter).rem_euclid(turn);
        Turns((((rest << 33) / turn + 1) >> 1) as u32)
    }
}

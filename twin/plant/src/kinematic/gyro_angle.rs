//! The gyroscope's own angle as the core integrates it: its bias from every rest.

use super::TICK_S;
use crate::{GyroParams, Rng};

/// Ticks without a count before a block of samples counts as rest.
const SETTLING_TICKS: u32 = 20;
/// Samples of a block.
const BLOCK: u32 = 64;
/// Largest spread of a block at rest, °/s.
const MAX_SPREAD_DEG_S: f64 = 1.0;
/// The part's resolution at ±500 °/s.
const LSB_PER_DEG_S: f64 = 65.5;

#[derive(Clone, Debug)]
pub(super) struct GyroAngle {
    params: GyroParams,
    rng: Rng,
    bias_deg_s: Option<f64>,
    angle_deg: f64,
    rest_ticks: u32,
    sum: f64,
    extremes: (f64, f64),
}

impl GyroAngle {
    pub(super) fn new(params: GyroParams, rng: Rng) -> Self {
        Self {
            params,
            rng,
            bias_deg_s: None,
            angle_deg: 0.0,
            rest_ticks: 0,
            sum: 0.0,
            extremes: (0.0, 0.0),
        }
    }

    /// A tick that ends at `time_s`, in which the robot turned at this rate; `stands`: no wheel moved
    /// a count.
    pub(super) fn tick(&mut self, rate_rad_s: f64, time_s: f64, stands: bool) {
        let noise = self.params.noise_deg_s * self.rng.normal();
        let exact = self.params.reading_deg_s(rate_rad_s.to_degrees(), time_s) + noise;
        let reading = (exact * LSB_PER_DEG_S).round() / LSB_PER_DEG_S;
        if let Some(bias) = self.bias_deg_s {
            self.angle_deg += (reading - bias) * TICK_S;
        }
        if !stands {
            self.rest_ticks = 0;
            return;
        }
        self.rest_ticks += 1;
        if self.rest_ticks <= SETTLING_TICKS {
            (self.sum, self.extremes) = (0.0, (reading, reading));
            return;
        }
        self.sum += reading;
        let (low, high) = self.extremes;
        self.extremes = (low.min(reading), high.max(reading));
        if self.rest_ticks == SETTLING_TICKS + BLOCK {
            if self.extremes.1 - self.extremes.0 <= MAX_SPREAD_DEG_S {
                self.bias_deg_s = Some(self.sum / f64::from(BLOCK));
            }
            self.rest_ticks = SETTLING_TICKS;
            (self.sum, self.extremes) = (0.0, (reading, reading));
        }
    }

    /// Radians counter-clockwise since the first bias; `None` before.
    pub(super) fn angle_rad(&self) -> Option<f64> {
        self.bias_deg_s.map(|_| self.angle_deg.to_radians())
    }
}

//! The vertical gyroscope's errors (MPU6050, Product Specification PS-MPU-6000A 3.4, 6.1).

/// The errors of one part.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct GyroParams {
    /// Reading at rest at switch-on, °/s (PS, 6.1: ±20).
    pub bias_deg_s: f64,
    /// Change of this reading while the part warms up, °/s per minute (PS, 6.1: ±20 °/s over 125 K,
    /// that is 0.16 °/s per kelvin, at an eighth of a kelvin per minute).
    pub drift_deg_s_min: f64,
    /// Scale factor: 1 is exact (PS, 6.1: ±3 %).
    pub scale: f64,
    /// Standard deviation of a sample's noise, °/s (PS, 6.1: 0.05 rms).
    pub noise_deg_s: f64,
}

impl Default for GyroParams {
    /// Errors well within the data sheet, without drift.
    fn default() -> Self {
        Self {
            bias_deg_s: -3.7,
            drift_deg_s_min: 0.0,
            scale: 1.02,
            noise_deg_s: 0.05,
        }
    }
}

impl GyroParams {
    /// A part without errors.
    pub const fn exact() -> Self {
        Self {
            bias_deg_s: 0.0,
            drift_deg_s_min: 0.0,
            scale: 1.0,
            noise_deg_s: 0.0,
        }
    }

    /// What the part reads without noise at this rate, °/s, so many seconds after switch-on.
    pub fn reading_deg_s(&self, rate_deg_s: f64, time_s: f64) -> f64 {
        rate_deg_s * self.scale + self.bias_deg_s + self.drift_deg_s_min * time_s / 60.0
    }
}

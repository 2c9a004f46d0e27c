//! Wheel diameters and track.

use fw_core::eeprom::fields::{TRACK, WHEEL_DIAMETER_LEFT, WHEEL_DIAMETER_RIGHT};
use fw_core::eeprom::{Config, Field};
use fw_core::types::Micrometres;
use serde::{Deserialize, Serialize};

/// The wheels as odometry needs them, millimetres.
#[derive(Clone, Copy, Debug, PartialEq, Serialize, Deserialize)]
pub struct WheelGeometry {
    /// Diameter of the left wheel.
    pub left_mm: f64,
    /// Diameter of the right wheel.
    pub right_mm: f64,
    /// Distance between the wheels' contact points.
    pub track_mm: f64,
}

impl WheelGeometry {
    /// Left and right diameter and track, millimetres.
    pub const fn new(left_mm: f64, right_mm: f64, track_mm: f64) -> Self {
        Self {
            left_mm,
            right_mm,
            track_mm,
        }
    }

    /// The wheels of a configuration.
    pub fn from_config(config: &Config) -> Self {
        let mm = |Micrometres(micrometres)| f64::from(micrometres) / 1000.0;
        Self {
            left_mm: mm(config.left().diameter),
            right_mm: mm(config.right().diameter),
            track_mm: mm(config.track()),
        }
    }

    /// The raw values of their fields, to the nearest micrometre.
    pub fn values(&self) -> [(&'static Field, u64); 3] {
        #[allow(
            clippy::cast_possible_truncation,
            clippy::cast_sign_loss,
            reason = "saturates; what is too large is not accepted"
        )]
        let micrometres = |mm: f64| u64::from((mm * 1000.0).round() as u32);
        [
            (WHEEL_DIAMETER_LEFT, micrometres(self.left_mm)),
            (WHEEL_DIAMETER_RIGHT, micrometres(self.right_mm)),
            (TRACK, micrometres(self.track_mm)),
        ]
    }

    /// All three larger by `factor`: distances change, rotations do not.
    #[must_use]
    pub fn scaled(&self, factor: f64) -> Self {
        Self {
            left_mm: self.left_mm * factor,
            right_mm: self.right_mm * factor,
            track_mm: self.track_mm * factor,
        }
    }

    /// The right wheel larger against the left by `factor`, their mean as it is.
    #[must_use]
    pub fn with_ratio(&self, factor: f64) -> Self {
        let sum = self.left_mm + self.right_mm;
        let ratio = self.right_mm / self.left_mm * factor;
        let left_mm = sum / (1.0 + ratio);
        Self {
            left_mm,
            right_mm: sum - left_mm,
            ..*self
        }
    }

    /// The track longer by `factor`.
    #[must_use]
    pub fn with_track(&self, factor: f64) -> Self {
        Self {
            track_mm: self.track_mm * factor,
            ..*self
        }
    }
}

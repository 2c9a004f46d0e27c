//! What an exploration has learned about wheels and gyroscope, and the wheels that follow from it.

use super::wheel_geometry::WheelGeometry;
use fw_core::eeprom::Config;
use mapper::CalibrationEstimate;
use serde::{Deserialize, Serialize};

/// Largest change of a figure that is accepted.
pub const ACCEPTED: f64 = 0.03;
/// A figure whose standard deviation is not smaller was hardly measured: half of what is assumed of a
/// calibrated robot.
pub const MEASURED: f64 = 0.002;

/// A factor, true over configured, and its standard deviation.
pub type Factor = (f64, f64);

/// What was learned.
#[derive(Clone, Copy, Debug, PartialEq, Serialize, Deserialize)]
pub struct Explored {
    /// The wheels that the robot was configured with.
    pub before: WheelGeometry,
    /// Of the way: of both diameters.
    pub travel: Factor,
    /// Of the right wheel's diameter to the left one's.
    pub ratio: Factor,
    /// Of the track.
    pub track: Factor,
    /// Of the gyroscope's turn, for which the EEPROM has no field.
    pub gyro: Factor,
}

impl Explored {
    /// What was learned with a configuration.
    pub fn new(config: &Config, learned: &CalibrationEstimate) -> Self {
        Self {
            before: WheelGeometry::from_config(config),
            travel: learned.travel_scale,
            ratio: learned.wheel_ratio,
            track: learned.track_scale,
            gyro: learned.gyro_scale,
        }
    }

    /// The corrected wheels. A figure that was hardly measured stays.
    ///
    /// # Errors
    /// A sentence: which figure is too far off, or that none was measured.
    pub fn wheels(&self) -> Result<WheelGeometry, String> {
        let mut factors = [1.0; 3];
        let learned = [
            ("way", self.travel),
            ("wheels' ratio", self.ratio),
            ("track", self.track),
        ];
        for (factor, (what, (value, deviation))) in factors.iter_mut().zip(learned) {
            if (value - 1.0).abs() > ACCEPTED || !value.is_finite() {
                return Err(format!(
                    "the {what} was learned as {:+.1} %; accepted is {:.0} % either way: calibrate with \
                     `robot calibrate distance` and `umbmark`",
                    (value - 1.0) * 100.0,
                    ACCEPTED * 100.0
                ));
            }
            if deviation < MEASURED {
                *factor = value;
            }
        }
        let [travel, ratio, _] = factors;
        // The turn is what was measured, from one wheel's way to the other's; the track follows from it and from
        // the way that the wheels will be written with.
        let turn = self.travel.0 / self.track.0;
        let variance = self.track.1.powi(2) - self.travel.1.powi(2);
        let deviation = variance.max(0.0).sqrt();
        let track = travel / if deviation < MEASURED { turn } else { 1.0 };
        let wheels = WheelGeometry {
            track_mm: self.before.track_mm * track,
            ..self.before.with_ratio(ratio).scaled(travel)
        };
        if wheels == self.before {
            return Err("no figure was learned well enough: explore for longer".into());
        }
        Ok(wheels)
    }

    /// What was learned, as a sentence.
    pub fn summary(&self) -> String {
        let percent = |(value, deviation): Factor| {
            format!(
                "{:+.2} % (± {:.2})",
                (value - 1.0) * 100.0,
                deviation * 100.0
            )
        };
        format!(
            "learned: right wheel against left {}, track {}, way {}, gyroscope {}",
            percent(self.ratio),
            percent(self.track),
            percent(self.travel),
            percent(self.gyro)
        )
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    fn explored(travel: Factor, ratio: Factor, track: Factor) -> Explored {
        Explored {
            before: WheelGeometry::new(80.0, 80.0, 125.0),
            travel,
            ratio,
            track,
            gyro: (1.01, 0.001),
        }
    }

    #[test]
    fn learned_figures_make_the_wheels_where_they_were_measured() {
        let (small, large) = (MEASURED / 2.0, MEASURED * 1.1);
        let wheels = |travel: Factor, ratio, turn: Factor| {
            let track = (travel.0 / turn.0, travel.1.hypot(turn.1));
            explored(travel, ratio, track).wheels()
        };
        let found = wheels((1.002, small), (1.004, small), (1.006, small)).unwrap();
        assert!((found.right_mm / found.left_mm - 1.004).abs() < 1e-9);
        assert!((found.right_mm + found.left_mm - 160.0 * 1.002).abs() < 1e-9);
        assert!((found.track_mm - 125.0 * 1.002 / 1.006).abs() < 1e-9);
        // The way's uncertainty is not the turn's.
        let found = wheels((1.002, large), (1.004, large), (0.996, 0.0005)).unwrap();
        assert_eq!((found.left_mm, found.right_mm), (80.0, 80.0));
        assert!((found.track_mm - 125.0 / 0.996).abs() < 1e-9);
        // Larger wheels alone would turn the robot farther.
        let found = wheels((1.002, small), (1.0, large), (0.996, large)).unwrap();
        assert!((found.track_mm - 125.0 * 1.002).abs() < 1e-9);
        for (turn, expected) in [((0.996, large), "longer"), ((0.969, small), "track")] {
            let why = wheels((1.0, large), (1.0, large), turn).unwrap_err();
            assert!(why.contains(expected), "{why}");
        }
        let summary = explored((1.0, 0.001), (1.004, 0.0002), (0.996, 0.0005)).summary();
        assert!(summary.contains("left +0.40 % (± 0.02), track -0.40 % (± 0.05)"));
    }
}

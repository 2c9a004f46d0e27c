//! The US-015 ultrasonic rangefinder: the nearest return of its cone, with noise.

use crate::{Pose2, Rng, Room};

/// The beam and the errors of a rangefinder.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct RangefinderParams {
    /// Half the opening angle of the cone, radians.
    pub half_angle_rad: f64,
    /// Nearest distance measured, mm; anything nearer reads as this.
    pub nearest_mm: f64,
    /// Farthest distance with an echo, mm.
    pub farthest_mm: f64,
    /// Standard deviation of the noise, mm: `noise_mm` + `noise_per_mm` · range.
    pub noise_mm: f64,
    /// The part of the noise that grows with the range, mm per mm.
    pub noise_per_mm: f64,
    /// Probability of an outlier (a multi-path reflection, or another source of sound).
    pub outlier: f64,
    /// Air temperature, °C.
    pub temperature_c: f64,
}

impl Default for RangefinderParams {
    /// The part's 15° cone and 20..4000 mm; noise and outliers are typical of such sensors.
    fn default() -> Self {
        Self {
            half_angle_rad: 15f64.to_radians(),
            nearest_mm: 20.0,
            farthest_mm: 4000.0,
            noise_mm: 1.0,
            noise_per_mm: 0.001,
            outlier: 0.003,
            temperature_c: 20.0,
        }
    }
}

/// Rays on each side of the beam's axis.
const RAYS_ASIDE: i32 = 6;

impl RangefinderParams {
    /// The sensor without noise and outliers.
    pub fn exact() -> Self {
        Self {
            noise_mm: 0.0,
            noise_per_mm: 0.0,
            outlier: 0.0,
            ..Self::default()
        }
    }

    /// Distance of the nearest surface in the cone that returns a strong enough echo, mm, without
    /// noise; `None` without an echo. Every surface scatters.
    ///
    /// A ray's return weakens off the axis, with the angle of incidence and with distance. An
    /// oblique wall is detected by the ray that meets it closest to its normal; one that no ray
    /// meets within about 70° of its normal reflects the sound away.
    pub fn nearest_return(&self, room: &Room, sensor: &Pose2) -> Option<f64> {
        (-RAYS_ASIDE..=RAYS_ASIDE)
            .filter_map(|ray| {
                let aside = f64::from(ray) / f64::from(RAYS_ASIDE);
                let heading_rad = sensor.heading_rad + aside * self.half_angle_rad;
                let hit = room.cast(&sensor.facing(heading_rad))?;
                // Beam: 1 on the axis, 0.4 at the cone's rim.
                let strength = (1.0 - 0.6 * aside * aside) * hit.cos_incidence;
                let far = hit.distance_mm / self.farthest_mm;
                let needed = 0.12 + 0.4 * far * far;
                (far <= 1.0 && strength >= needed).then_some(hit.distance_mm)
            })
            .min_by(f64::total_cmp)
            .map(|distance| distance.max(self.nearest_mm))
    }

    /// One measurement of the distance `truth`, mm, with noise and outliers; `None` without an echo.
    pub fn measure(&self, truth: Option<f64>, rng: &mut Rng) -> Option<f64> {
        // The same number of draws on every path keeps runs comparable.
        let (noise, chance, place) = (rng.normal(), rng.unit(), rng.unit());
        let truth = truth?;
        if chance < self.outlier {
            return Some(self.nearest_mm + place * (self.farthest_mm - self.nearest_mm));
        }
        let range = truth + noise * (self.noise_mm + self.noise_per_mm * truth);
        Some(range.clamp(self.nearest_mm, self.farthest_mm))
    }

    /// Width of the echo pulse for a distance, µs: there and back at 331.3 + 0.606·T m/s.
    pub fn echo_us(&self, range_mm: f64) -> f64 {
        2.0 * range_mm / (331.3 + 0.606 * self.temperature_c) * 1000.0
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    const BEAM_DEG: f64 = 15.0;

    /// Reading of a wall this far from the sensor, seen under this angle of incidence.
    fn reading(distance_mm: f64, incidence_deg: f64) -> Option<f64> {
        let room = Room::default().with_wall(distance_mm, -9000.0, distance_mm, 9000.0);
        let at = Pose2::new(0.0, 0.0, incidence_deg.to_radians());
        RangefinderParams::default().nearest_return(&room, &at)
    }

    #[test]
    fn perpendicular_wall_reads_its_distance_within_limits() {
        assert!((reading(2000.0, 0.0).unwrap() - 2000.0).abs() < 1e-6);
        assert_eq!(reading(4100.0, 0.0), None);
        assert!((reading(5.0, 0.0).unwrap() - 20.0).abs() < 1e-9);
    }

    #[test]
    fn oblique_wall_reads_short_and_grazing_wall_is_silent() {
        let read = reading(1000.0, 40.0).unwrap();
        let along = |degrees: f64| 1000.0 / degrees.to_radians().cos();
        let nearest_ray = along(40.0 - BEAM_DEG) - 1.0;
        assert!(read < along(40.0) && read > nearest_ray, "{read}");
        assert_eq!(reading(1000.0, 89.0), None);
    }

    #[test]
    fn noise_and_outliers_have_stated_size() {
        let beam = RangefinderParams::default();
        let mut rng = Rng::new(3);
        let mut errors: Vec<f64> = (0..5000)
            .map(|_| beam.measure(Some(1500.0), &mut rng).unwrap() - 1500.0)
            .collect();
        errors.retain(|error| error.abs() <= 15.0);
        let outliers = 5000 - errors.len();
        assert!((3..60).contains(&outliers), "{outliers}");
        #[allow(clippy::cast_precision_loss)]
        let sigma = (errors.iter().map(|e| e * e).sum::<f64>() / errors.len() as f64).sqrt();
        assert!((2.2..2.8).contains(&sigma), "{sigma}");
    }

    #[test]
    fn echo_of_2500_mm_takes_14577_us_at_19_3_celsius() {
        let beam = RangefinderParams {
            temperature_c: 19.3,
            ..RangefinderParams::default()
        };
        assert!((beam.echo_us(2500.0) - 14_577.0).abs() < 5.0);
    }
}

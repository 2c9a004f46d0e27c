//! The US-015 ultrasonic rangefinder: the nearest return of its cone, with noise.

use crate::{Pose, Rng, Room};

/// Where a rangefinder sits on the robot and where it looks.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Mount {
    /// Millimetres ahead of the middle of the axle.
    pub ahead_mm: f64,
    /// Millimetres to the left of the middle of the axle.
    pub left_mm: f64,
    /// Radians from straight ahead, counter-clockwise.
    pub bearing_rad: f64,
}

impl Mount {
    /// Front, right and left of the first board, in the order of the frame: looking ahead, to the
    /// right and to the left. Their distances from the axle's middle are a choice.
    #[must_use]
    pub const fn first_board() -> [Self; 3] {
        use std::f64::consts::FRAC_PI_2;
        [
            Self {
                ahead_mm: 80.0,
                left_mm: 0.0,
                bearing_rad: 0.0,
            },
            Self {
                ahead_mm: 0.0,
                left_mm: -60.0,
                bearing_rad: -FRAC_PI_2,
            },
            Self {
                ahead_mm: 0.0,
                left_mm: 60.0,
                bearing_rad: FRAC_PI_2,
            },
        ]
    }

    /// The sensor's own pose on a robot at `robot`.
    #[must_use]
    pub fn pose(&self, robot: &Pose) -> Pose {
        let (x, y) = robot.point(self.ahead_mm, self.left_mm);
        Pose::new(x, y, robot.heading_rad + self.bearing_rad)
    }
}

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
    /// Probability of an outlier (a reflection by way of a second surface, or another sound).
    pub outlier: f64,
    /// Air temperature, °C.
    pub temperature_c: f64,
}

impl Default for RangefinderParams {
    /// The part's 15° cone and 20..4000 mm; noise and outliers as such sensors show.
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

/// Speed of sound in air of this temperature (°C), mm/µs: 331.3 + 0.606·T m/s.
#[must_use]
pub fn speed_of_sound_mm_per_us(temperature_c: f64) -> f64 {
    (331.3 + 0.606 * temperature_c) / 1000.0
}

/// Rays on each side of the beam's axis.
const RAYS_ASIDE: i32 = 6;

impl RangefinderParams {
    /// Distance of the nearest surface in the cone that returns a strong enough echo, mm, without
    /// noise; `None` without an echo.
    ///
    /// A ray's return weakens off the axis, with the obliqueness of the surface and with distance.
    /// A wall seen obliquely is still heard by the ray of the cone that meets it most squarely;
    /// one that no ray meets within about 70° of its normal reflects the sound away.
    #[must_use]
    pub fn nearest_return(&self, room: &Room, sensor: &Pose) -> Option<f64> {
        (-RAYS_ASIDE..=RAYS_ASIDE)
            .filter_map(|ray| {
                let aside = f64::from(ray) / f64::from(RAYS_ASIDE);
                let heading = sensor.heading_rad + aside * self.half_angle_rad;
                let hit = room.cast(sensor.x_mm, sensor.y_mm, heading)?;
                // Beam: 1 on the axis, 0.4 at the cone's rim.
                let strength = (1.0 - 0.6 * aside * aside) * hit.cos_incidence;
                let far = hit.distance / self.farthest_mm;
                let needed = 0.12 + 0.4 * far * far;
                (far <= 1.0 && strength >= needed).then_some(hit.distance)
            })
            .min_by(f64::total_cmp)
            .map(|distance| distance.max(self.nearest_mm))
    }

    /// One measurement of the distance, mm, with noise and the odd outlier; `None` without an echo.
    pub fn measure(&self, room: &Room, sensor: &Pose, rng: &mut Rng) -> Option<f64> {
        // The same count of draws on every path keeps runs comparable.
        let (noise, chance, place) = (rng.normal(), rng.unit(), rng.unit());
        let truth = self.nearest_return(room, sensor)?;
        if chance < self.outlier {
            return Some(self.nearest_mm + place * (self.farthest_mm - self.nearest_mm));
        }
        let range = truth + noise * (self.noise_mm + self.noise_per_mm * truth);
        Some(range.clamp(self.nearest_mm, self.farthest_mm))
    }

    /// Width of the echo pulse for a distance, µs: there and back at the speed of sound.
    #[must_use]
    pub fn echo_us(&self, range_mm: f64) -> f64 {
        2.0 * range_mm / speed_of_sound_mm_per_us(self.temperature_c)
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    fn wall_ahead(at: f64) -> Room {
        Room::default().with_wall(at, -5000.0, at, 5000.0)
    }

    #[test]
    fn a_wall_square_ahead_reads_its_distance() {
        let beam = RangefinderParams::default();
        let at = Pose::default();
        assert!((beam.nearest_return(&wall_ahead(2000.0), &at).unwrap() - 2000.0).abs() < 1e-6);
        assert_eq!(beam.nearest_return(&wall_ahead(4100.0), &at), None);
        assert!((beam.nearest_return(&wall_ahead(5.0), &at).unwrap() - 20.0).abs() < 1e-9);
    }

    #[test]
    fn an_oblique_wall_reads_short_and_a_grazing_one_is_silent() {
        let beam = RangefinderParams::default();
        let room = wall_ahead(1000.0);
        let oblique = Pose::new(0.0, 0.0, 40f64.to_radians());
        let read = beam.nearest_return(&room, &oblique).unwrap();
        let axis = 1000.0 / 40f64.to_radians().cos();
        assert!(
            read < axis && read > 1000.0 / 25f64.to_radians().cos() - 1.0,
            "{read}"
        );
        let grazing = Pose::new(0.0, 0.0, 89f64.to_radians());
        assert_eq!(beam.nearest_return(&room, &grazing), None);
    }

    #[test]
    fn noise_is_millimetres_and_outliers_are_rare() {
        let beam = RangefinderParams::default();
        let (room, at, mut rng) = (wall_ahead(1500.0), Pose::default(), Rng::new(3));
        let errors: Vec<f64> = (0..5000)
            .map(|_| beam.measure(&room, &at, &mut rng).unwrap() - 1500.0)
            .collect();
        let wild = errors.iter().filter(|e| e.abs() > 15.0).count();
        assert!((3..60).contains(&wild), "{wild}");
        let calm: Vec<f64> = errors.into_iter().filter(|e| e.abs() <= 15.0).collect();
        #[allow(clippy::cast_precision_loss)]
        let sigma = (calm.iter().map(|e| e * e).sum::<f64>() / calm.len() as f64).sqrt();
        assert!((2.2..2.8).contains(&sigma), "{sigma}");
    }

    #[test]
    fn two_and_a_half_metres_are_fourteen_point_six_milliseconds() {
        let beam = RangefinderParams {
            temperature_c: 19.3,
            ..RangefinderParams::default()
        };
        assert!((beam.echo_us(2500.0) - 14_577.0).abs() < 5.0);
    }

    #[test]
    fn mounts_look_ahead_right_and_left() {
        let robot = Pose::new(100.0, 200.0, std::f64::consts::FRAC_PI_2);
        let [front, right, left] = Mount::first_board().map(|mount| mount.pose(&robot));
        assert!((front.y_mm - 280.0).abs() < 1e-9);
        assert!((right.x_mm - 160.0).abs() < 1e-9 && right.heading_rad.abs() < 1e-9);
        assert!((left.x_mm - 40.0).abs() < 1e-9);
    }
}

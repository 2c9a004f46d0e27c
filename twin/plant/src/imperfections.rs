//! How the world differs from its textbook: what no configuration knows of a robot and its floor.

use crate::{GyroParams, Rng};

/// The random generators of a run, beside the rangefinders'.
pub(crate) mod stream {
    pub(crate) const DRAW: u64 = 1;
    pub(crate) const DRAW_GYRO: u64 = 2;
    pub(crate) const FLOOR: u64 = 3;
    pub(crate) const GYRO: u64 = 4;
}

/// The imperfections, each of which can be switched off. The figures bound or scale what is drawn from
/// a run's seed. The default is everything on.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Imperfections {
    /// Bound of the true wheel diameters' and the true track's deviation from the configured ones.
    /// 0.3 % and 0.5 %: what remains after a calibration with a tape measure (Borenstein and Feng,
    /// "Measurement and correction of systematic odometry errors in mobile robots", 1996).
    pub geometry: Option<GeometrySpread>,
    /// Standard deviation of a wheel's travel per √(100 mm), mm, white in travel. 0.15: on a track of
    /// 125 mm it turns the robot by 0.3° per √m (floor texture; Borenstein and Feng's non-systematic
    /// errors).
    pub travel_noise_mm: Option<f64>,
    /// What crossing a sill or a carpet edge adds at most.
    pub sill: Option<Sill>,
    /// Bound of the motors' and the battery's deviation from the first board's figures.
    pub drive: Option<DriveSpread>,
    /// Smooth surfaces reflect ultrasound like mirrors: the beam's incidence decides on the echo.
    pub incidence: bool,
    /// The echo over a mirroring wall, where the direct path does not answer.
    pub double_bounce: bool,
    /// Soft surfaces return no echo from afar.
    pub soft_surfaces: bool,
    /// Bound of the gyroscope's errors.
    pub gyro: Option<GyroSpread>,
}

/// Bounds of the chassis' true figures, as shares of the configured ones.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct GeometrySpread {
    /// Each wheel's diameter.
    pub wheel: f64,
    /// The track.
    pub track: f64,
}

/// The largest effects of a sill, drawn uniformly at every crossing (Borenstein and Feng's
/// non-systematic errors).
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Sill {
    /// Turn to either side, degrees.
    pub yaw_deg: f64,
    /// Travel that both wheels lose, mm.
    pub slip_mm: f64,
}

/// Bounds of the drive's figures. The motors' are usual for brushed gear motors, and less than the
/// first board's two differ by; the battery's are those of a pack in use.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct DriveSpread {
    /// Each motor's speeds, a share.
    pub speed: f64,
    /// Each motor's dead zone, a share.
    pub dead_zone: f64,
    /// Each motor's lag, a share.
    pub lag: f64,
    /// Lowest and highest charge at the start, 0..=1.
    pub charge: [f64; 2],
    /// Lowest and highest internal resistance of a cell, ohm.
    pub cell_ohm: [f64; 2],
}

/// Bounds of the gyroscope's errors (PS-MPU-6000A, 6.1).
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct GyroSpread {
    /// The bias at switch-on, °/s.
    pub bias_deg_s: f64,
    /// The bias' change, °/s per minute; drawn with this size in either direction.
    pub drift_deg_s_min: f64,
    /// The scale, a share: what remains of the data sheet's 3 % after a calibration.
    pub scale: f64,
    /// Noise of a sample, °/s rms; not drawn.
    pub noise_deg_s: f64,
}

impl Default for Imperfections {
    fn default() -> Self {
        Self {
            geometry: Some(GeometrySpread {
                wheel: 0.003,
                track: 0.005,
            }),
            travel_noise_mm: Some(0.15),
            sill: Some(Sill {
                yaw_deg: 2.0,
                slip_mm: 10.0,
            }),
            drive: Some(DriveSpread {
                speed: 0.1,
                dead_zone: 0.15,
                lag: 0.15,
                charge: [0.6, 1.0],
                cell_ohm: [0.04, 0.08],
            }),
            incidence: true,
            double_bounce: true,
            soft_surfaces: true,
            gyro: Some(GyroSpread {
                bias_deg_s: 20.0,
                drift_deg_s_min: 0.02,
                scale: 0.01,
                noise_deg_s: 0.05,
            }),
        }
    }
}

impl Imperfections {
    /// The default for an uncalibrated robot: wheels and track within 1 %, the gyroscope's scale
    /// within the data sheet's 3 % (PS-MPU-6000A, 6.1).
    pub fn uncalibrated() -> Self {
        let mut world = Self::default();
        let (wheel, track) = (0.01, 0.01);
        world.geometry = Some(GeometrySpread { wheel, track });
        world.gyro.iter_mut().for_each(|gyro| gyro.scale = 0.03);
        world
    }

    /// A world as configured: what remains are the rangefinders' noise and outliers.
    pub const fn none() -> Self {
        Self {
            geometry: None,
            travel_noise_mm: None,
            sill: None,
            drive: None,
            incidence: false,
            double_bounce: false,
            soft_surfaces: false,
            gyro: None,
        }
    }

    /// Without the one of this name, that of its field with hyphens.
    ///
    /// # Errors
    /// The names that are accepted.
    pub fn without(mut self, name: &str) -> Result<Self, &'static str> {
        match name {
            "geometry" => self.geometry = None,
            "travel-noise" => self.travel_noise_mm = None,
            "sill" => self.sill = None,
            "drive" => self.drive = None,
            "incidence" => self.incidence = false,
            "double-bounce" => self.double_bounce = false,
            "soft-surfaces" => self.soft_surfaces = false,
            "gyro" => self.gyro = None,
            _ => {
                return Err(
                    "accepted are geometry, travel-noise, sill, drive, incidence, double-bounce, \
                     soft-surfaces, gyro",
                );
            }
        }
        Ok(self)
    }

    /// The gyroscope of this seed: `params`, or what the seed draws instead.
    pub fn draw_gyro(&self, params: GyroParams, seed: u64) -> GyroParams {
        let mut rng = Rng::stream(seed, stream::DRAW_GYRO);
        self.gyro.map_or(params, |spread| GyroParams {
            bias_deg_s: rng.within(spread.bias_deg_s),
            drift_deg_s_min: spread.drift_deg_s_min.copysign(rng.within(1.0)),
            scale: 1.0 + rng.within(spread.scale),
            noise_deg_s: spread.noise_deg_s,
        })
    }
}

#[cfg(test)]
mod tests;

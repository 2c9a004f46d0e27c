//! What the localiser takes, and how it works.

use super::{MatcherConfig, MotionNoise};
use crate::{Mount, Pose2};

/// What one frame reports.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Observation {
    /// Time of the frame, s.
    pub time_s: f64,
    /// The pose that the robot reports.
    pub odometry: Pose2,
    /// The gyroscope's own angle, rad, not wrapped; `None` without a gyroscope.
    pub gyro_rad: Option<f64>,
    /// The latest ranges in the order of [`LocaliserConfig::mounts`], mm; `None` without an echo.
    pub ranges_mm: [Option<f64>; 3],
    /// Bearing of the first one where it is swept, rad counter-clockwise from straight ahead; none: that of its
    /// mount.
    pub front_bearing_rad: Option<f64>,
}

/// How to localise.
#[derive(Clone, Debug, PartialEq)]
pub struct LocaliserConfig {
    /// Width of the map's cells, mm.
    pub cell_mm: f64,
    /// The rangefinders: front, right, left; `None` where none is fitted.
    pub mounts: [Option<Mount>; 3],
    /// Mean age of a new range at the time of the frame's position, s.
    pub range_age_s: f64,
    /// Nearest and farthest range accepted, mm.
    pub limits_mm: (f64, f64),
    /// Half the opening angle of the beam, rad.
    pub half_angle_rad: f64,
    /// Largest angle of incidence with an echo, rad.
    pub incidence_rad: f64,
    /// Noise of the motion.
    pub motion: MotionNoise,
    /// Weight of the matches.
    pub matcher: MatcherConfig,
    /// Length of a stretch, mm of way.
    pub stretch_mm: f64,
    /// Whether gyroscope and matches correct the reported pose. Without, it is the estimate, and the map is in its
    /// frame.
    pub corrects: bool,
}

impl Default for LocaliserConfig {
    /// The first board; cells of 25 mm. The wire carries ranges below 2500 mm.
    fn default() -> Self {
        Self {
            cell_mm: 25.0,
            mounts: Mount::first_board().map(Some),
            // From the trigger to the echo's end, to the next tick and to the next frame: 12 to 33 ms by distance,
            // as tests/tests/velocity.rs measures.
            range_age_s: 0.020,
            limits_mm: (30.0, 2490.0),
            half_angle_rad: 15f64.to_radians(),
            incidence_rad: 30f64.to_radians(),
            motion: MotionNoise::default(),
            matcher: MatcherConfig::default(),
            stretch_mm: 400.0,
            corrects: true,
        }
    }
}

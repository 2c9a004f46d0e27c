//! What a configuration demands of the localiser and the plans.

use crate::mapping;
use fw_core::eeprom::Config;
use fw_core::wire::Field;
use host_link::error::{Error, IN_EEPROM};
use mapper::{LocaliserConfig, MotionNoise};

/// The localiser's settings for a configuration and a body of this radius, mm.
pub fn localiser_config(config: &Config, body_mm: f64, cell_mm: f64) -> LocaliserConfig {
    LocaliserConfig {
        cell_mm,
        mounts: mapping::mounts(config, body_mm),
        motion: MotionNoise {
            track_mm: f64::from(config.track().0) / 1000.0,
            ..MotionNoise::default()
        },
        ..LocaliserConfig::default()
    }
}

/// Half the width of the front sensor's sweep, degrees.
const SWEEP_DEG: f64 = 60.0;

/// # Errors
/// [`Error::WrongMode`] where the mode carries no velocity.
pub fn ensure_velocity(config: &Config) -> Result<(), Error> {
    let mode = config.mode();
    if mode.has(Field::Velocity) {
        return Ok(());
    }
    Err(Error::WrongMode(mode.name(), "velocity to drive at"))
}

/// The plan's settings for a configuration and a body of this radius, mm.
///
/// # Errors
/// [`Error::WrongMode`] where the mode carries no velocity; [`Error::Rejected`] without a rangefinder; [`Error::Usage`]
/// of a body narrower than its track.
pub fn navigator_config(config: &Config, body_mm: f64) -> Result<navigator::Config, Error> {
    ensure_velocity(config)?;
    if config.rangefinders() == 0 {
        let why = "rangefinders = 0, and a plan needs 1 to 3 to see its way";
        return Err(Error::Rejected(IN_EEPROM.into(), why.into()));
    }
    let half_track_mm = f64::from(config.track().0) / 2000.0;
    if half_track_mm > body_mm {
        let why = format!("--body-radius {body_mm} is less than half of track_mm, {half_track_mm}");
        return Err(Error::Usage(why));
    }
    let limits = config.velocity_limits();
    let defaults = navigator::Config::default();
    Ok(navigator::Config {
        mounts: mapping::mounts(config, body_mm),
        body_mm,
        // Where a wheel cannot follow, the core slows down and keeps the turn.
        cruise_mm_s: defaults.cruise_mm_s.min(limits.speed_mm_s.into()),
        sweep_half_width_rad: config.servo().map_or(0.0, |_| SWEEP_DEG.to_radians()),
        ..defaults
    })
}

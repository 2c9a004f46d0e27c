//! What a configuration demands of the localiser and the plans.

use crate::mapping;
use fw_core::eeprom::Config;
use fw_core::wire::Field;
use host_link::error::Error;
use mapper::{LocaliserConfig, MotionNoise, Mount};

/// The localiser's settings for a configuration.
pub fn localiser_config(config: &Config, cell_mm: f64) -> LocaliserConfig {
    LocaliserConfig {
        cell_mm,
        mounts: mounts(config),
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

/// The plan's settings for a configuration.
///
/// # Errors
/// [`Error::WrongMode`] where the mode carries no velocity; [`Error::Rejected`] without a rangefinder or too wide.
pub fn navigator_config(config: &Config) -> Result<navigator::Config, Error> {
    ensure_velocity(config)?;
    let rejected = |why: &str| Err(Error::Rejected("in the EEPROM".into(), why.into()));
    if config.rangefinders() == 0 {
        return rejected("rangefinders = 0, and a plan needs 1 to 3 to see its way");
    }
    if f64::from(config.track().0) > 2000.0 * navigator::BODY_MM {
        return rejected("track_mm is above 200, the width of the body that plans keep off walls");
    }
    let limits = config.velocity_limits();
    let defaults = navigator::Config::default();
    Ok(navigator::Config {
        mounts: mounts(config),
        // Where a wheel cannot follow, the core slows down and keeps the turn.
        cruise_mm_s: defaults.cruise_mm_s.min(limits.speed_mm_s.into()),
        sweep_half_width_rad: config.servo().map_or(0.0, |_| SWEEP_DEG.to_radians()),
        ..defaults
    })
}

/// What is fitted: the code of another is that of a beam without an echo.
fn mounts(config: &Config) -> [Option<Mount>; 3] {
    let mut fitted = mapping::mounts(config).into_iter();
    [(); 3].map(|()| fitted.next())
}

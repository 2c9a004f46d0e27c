//! Configurations that [`fw_core::eeprom::check`] accepts, drawn field by field over the whole of
//! every field's range.

use fixed::types::I32F32;
use fw_core::binary64::Binary64;
use fw_core::eeprom::{first_board, Accepted, Config, Field, FIELDS};
#[cfg(kani)]
use fw_core::eeprom::{Gains, Platform};
use fw_core::wire::Mode;

use super::contract::is_bounded;
#[cfg(kani)]
use crate::input::any;
use crate::input::{Input, Source};

/// A configuration that was accepted. Kani's harnesses put any figures at all in here: a property takes
/// of them what [`Self::bounded`] does.
#[derive(Clone, Debug, PartialEq, Eq)]
pub struct AcceptedConfig(pub Config);

impl AcceptedConfig {
    /// The configuration, if it keeps what `accepted_configuration_is_bounded` promises of every one
    /// that is accepted. That much, and no more, the properties downstream take for granted.
    #[must_use]
    pub fn bounded(self) -> Option<Config> {
        is_bounded(&self.0).then_some(self.0)
    }

    /// Any gains of both regulators; the other figures are the first board's.
    #[cfg(kani)]
    #[must_use]
    pub fn of_any_gains() -> Self {
        let gains = || Gains {
            p: any(),
            i: any(),
            d: any(),
            anti_windup: any(),
        };
        Self(Config {
            forward: gains(),
            rotation: gains(),
            ..first_board()
        })
    }

    /// Any battery.
    #[cfg(kani)]
    #[must_use]
    pub fn of_any_battery() -> Self {
        Self(Config {
            cells: any(),
            adc_max_voltage: any(),
            adc_max_word: any(),
            dividers: core::array::from_fn(|_| any()),
            ..first_board()
        })
    }

    /// Any figures of a platform.
    #[cfg(kani)]
    #[must_use]
    pub fn of_any_platform() -> Self {
        Self::of_platform(any())
    }

    /// Any diameters of the wheels.
    #[cfg(kani)]
    #[must_use]
    pub fn of_any_diameters() -> Self {
        Self::of_platform(Platform {
            wheel_diameter_left: any(),
            wheel_diameter_right: any(),
            ..Platform::FIRST_BOARD
        })
    }

    /// Any figures of the wheels and of what drives them.
    #[cfg(kani)]
    #[must_use]
    pub fn of_any_wheels() -> Self {
        Self::of_platform(Platform {
            counts_per_turn: any(),
            wheel_diameter_left: any(),
            wheel_diameter_right: any(),
            track: any(),
            dead_zone_left: any(),
            dead_zone_right: any(),
            limit_left: any(),
            limit_right: any(),
            ..Platform::FIRST_BOARD
        })
    }

    /// Any mode, and any figures of a platform but those of its wheels.
    #[cfg(kani)]
    #[must_use]
    pub fn of_any_mode() -> Self {
        let board = Platform::FIRST_BOARD;
        let Self(config) = Self::of_platform(Platform {
            counts_per_turn: board.counts_per_turn,
            wheel_diameter_left: board.wheel_diameter_left,
            wheel_diameter_right: board.wheel_diameter_right,
            track: board.track,
            dead_zone_left: board.dead_zone_left,
            dead_zone_right: board.dead_zone_right,
            limit_left: board.limit_left,
            limit_right: board.limit_right,
            ..any()
        });
        Self(Config {
            mode: any(),
            ..config
        })
    }

    #[cfg(kani)]
    fn of_platform(platform: Platform) -> Self {
        Self(Config {
            platform,
            ..first_board()
        })
    }
}

/// Bits that `field` accepts: both ends of its range often, all of it sometimes; `shape` is below 128.
fn accepted(field: &Field, shape: u8, source: &mut impl Source) -> u64 {
    let anything = source.bits(64);
    match *field.accepted {
        Accepted::Whole { min, max } => {
            let largest = match field.kind.len() {
                1 => 0xFF,
                2 => 0xFFFF,
                _ => u32::MAX,
            };
            let (min, max) = (u64::from(min), u64::from(max.min(largest)));
            match shape % 8 {
                0 => min,
                1 => max,
                2 => min + (anything & 0xFF).min(max - min),
                _ => min + anything % (max - min + 1),
            }
        }
        Accepted::Number { min, max } => {
            let (low, high) = (min.to_bits().unsigned_abs(), max.to_bits().unsigned_abs());
            let span = high - low;
            let bits = match shape % 8 {
                0 => low,
                1 => high,
                // Small factors matter as much as large ones.
                2..=5 => low + ((anything % (span + 1)) >> (shape >> 3 << 1)),
                _ => low + anything % (span + 1),
            };
            Binary64::from_fixed(I32F32::from_bits(i64::try_from(bits).unwrap_or(0))).0
        }
        Accepted::Mode => Mode::draw(source).code().into(),
        Accepted::Key | Accepted::Checksum(_) | Accepted::Rule(_) => 0,
    }
}

impl Input for AcceptedConfig {
    fn draw(source: &mut impl Source) -> Self {
        let mut config = first_board();
        for field in FIELDS {
            // Half of the fields stay as they are on the first board, and take a byte each.
            let shape = source.bits8();
            if shape & 1 == 1 {
                field.set(&mut config, accepted(field, shape >> 1, source));
            }
        }
        // What fields must hold together.
        for tap in &mut config.dividers {
            tap.lower = tap.lower.clamp(1, 10_000_000);
            tap.upper = tap.upper.min(10_000_000).min(tap.lower.saturating_mul(99));
        }
        let platform = &mut config.platform;
        if config.mode == Mode::GuardedSweep {
            platform.servo = true;
            platform.rangefinders = platform.rangefinders.max(1);
        }
        platform.dead_zone_left = platform.dead_zone_left.min(platform.limit_left - 1);
        platform.dead_zone_right = platform.dead_zone_right.min(platform.limit_right - 1);
        platform.battery_cutoff = platform.battery_cutoff.min(platform.battery_warn);
        Self(config)
    }
}

//! Configurations that [`fw_core::eeprom::check`] accepts, drawn field by field over the whole of
//! every field's range.

use fixed::types::I32F32;
use fw_core::double::Double;
use fw_core::eeprom::{first_board, Accepted, Config, Field, FIELDS};
use fw_core::wire::Mode;

use crate::input::{Input, Source};

/// A configuration that was accepted.
#[derive(Clone, Debug, PartialEq, Eq)]
pub struct AcceptedConfig(pub Config);

/// Bits that `field` accepts: both ends of its range often, all of it sometimes; `shape` is below 128.
fn accepted(field: &Field, shape: u8, source: &mut impl Source) -> u64 {
    let anything = source.bits64();
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
            Double::from_fixed(I32F32::from_bits(i64::try_from(bits).unwrap_or(0))).0
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

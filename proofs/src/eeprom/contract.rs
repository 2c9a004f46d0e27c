//! T5: what an accepted configuration promises to everything downstream.

use fw_core::eeprom::fields::{CELLS, STOP_DEADLINE, TAP_1_UPPER, TRACK};
use fw_core::eeprom::{Config, Gains, Image, Wheel};
use fw_core::wire::Mode;

use super::accepted::AcceptedConfig;
use crate::property::Seen;

/// The promise, written out independently of the field table.
pub fn is_bounded(config: &Config) -> bool {
    let gains = |gains: &Gains| {
        [gains.p, gains.i, gains.d, gains.anti_windup]
            .into_iter()
            .all(|gain| (0..=10_000 << 32).contains(&gain.value().to_bits()))
    };
    let wheel = |wheel: &Wheel| {
        (10_000..=1_000_000).contains(&wheel.diameter.0)
            && 0 <= wheel.dead_zone.hundredths()
            && wheel.dead_zone < wheel.limit
    };
    let dividers = config.dividers().iter().all(|divider| {
        (1..=10_000_000).contains(&divider.lower.0)
            && u64::from(divider.upper.0) <= 99 * u64::from(divider.lower.0)
    });
    let servo = config
        .servo()
        .is_none_or(|servo| (1..=1 << 31).contains(&servo.travel.0));
    gains(config.forward())
        && gains(config.rotation())
        && (1..=8).contains(&config.cells())
        && config.dividers().len() == usize::from(config.cells())
        && ((1 << 32) / 10..=10 << 32).contains(&config.adc_max_volts().to_bits())
        && config.adc_max_word() >= 1
        && dividers
        && config.counts_per_turn() >= 100
        && wheel(config.left())
        && wheel(config.right())
        && (20_000..=2_000_000).contains(&config.track().0)
        && config.rangefinders() <= 3
        && (20..=2_000).contains(&config.stop_deadline().0)
        && (9_600..=2_000_000).contains(&config.log_baud())
        && config.battery_cutoff() <= config.battery_warn()
        && config.battery_warn().0.to_bits() <= 5 << 16
        && (200..=65_535).contains(&config.position_tolerance().0)
        && (8 << 16..=0x2000 << 16).contains(&config.rotation_tolerance().0)
        && config.log_period().0 <= 60_000
        && servo
        && (config.mode() != Mode::GuardedSweep
            || config.servo().is_some() && config.rangefinders() >= 1)
}

/// What [`Config::from_fields`] accepts is bounded.
// Requirement: WIRE-eeprom-4
pub fn accepted_configuration_is_bounded(values: AcceptedConfig) -> Seen {
    let Some(config) = values.config() else {
        return Seen::NOTHING;
    };
    assert!(is_bounded(&config));
    let ends = [
        config.forward().p.value().to_bits() == 10_000 << 32,
        values.get(TAP_1_UPPER) == 10_000_000,
        values.get(TRACK) == 20_000,
        values.get(STOP_DEADLINE) == 2_000,
        values.get(CELLS) == 8,
    ];
    Seen::NOTHING
        .case(0, values != AcceptedConfig::FIRST_BOARD)
        .case(1, ends.contains(&true))
}

/// What [`Config::decode`] accepts is bounded: a good image with anything written over two places and
/// the checksum right again.
pub fn decoded_configuration_is_bounded(one: u16, first: u64, two: u16, second: u64) -> Seen {
    let mut image = Image::FIRST_BOARD;
    for (at, value) in [(one, first), (two, second)] {
        for (place, byte) in value.to_le_bytes().into_iter().enumerate() {
            if let Some(slot) = image.0.get_mut(usize::from(at % 0x338) + place) {
                *slot = byte;
            }
        }
    }
    image.seal();
    let decoded = Config::decode(&image);
    if let Ok(config) = &decoded {
        assert!(is_bounded(config));
    }
    Seen::NOTHING
        .case(0, decoded.is_ok())
        .case(1, decoded.is_err())
}

crate::properties! {
    theorem T5 accepted_configuration_is_bounded(values: AcceptedConfig) {
        cases ["other than the first board's", "at the end of a range"];
        kani any_gains [unwind(80)] = (AcceptedConfig::of_any_gains(),);
        kani any_battery [unwind(80)] = (AcceptedConfig::of_any_battery(),);
        kani any_wheels [unwind(80)] = (AcceptedConfig::of_any_wheels(),);
        kani any_mode [unwind(80)] = (AcceptedConfig::of_any_mode(),);
        sampled 50_000;
    }
    property T5 decoded_configuration_is_bounded(one: u16, first: u64, two: u16, second: u64) {
        cases ["accepted", "rejected"];
        stepped (0x0C..0x338_u16).flat_map(|at| {
            (0..=255).step_by(5).map(move |byte: u64| (at, byte, 0, 0x8C7B_6A59_4837_2615))
        });
        sampled 50_000;
    }
}

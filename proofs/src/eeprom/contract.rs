//! T5: what an accepted configuration promises. Every property downstream that takes a configuration
//! for granted takes only what is written here.

use fw_core::binary64::Binary64;
use fw_core::eeprom::{check, decode, first_board, Config, Gains};
use fw_core::wire::Mode;

use super::accepted::AcceptedConfig;
use super::image::{first_image, mend};
use crate::property::Seen;

/// The promise, written out independently of the field table.
#[must_use]
pub fn is_bounded(config: &Config) -> bool {
    let platform = &config.platform;
    let number = |double: Binary64, low: i64, high: i64| {
        double
            .to_scaled(32)
            .is_ok_and(|value| low <= value && value <= high)
    };
    let factor = |double: Binary64| number(double, 0, 10_000 << 32);
    let gains = |gains: &Gains| {
        factor(gains.p) && factor(gains.i) && factor(gains.d) && factor(gains.anti_windup)
    };
    let dividers = config
        .dividers
        .iter()
        .take(usize::from(config.cells))
        .all(|divider| {
            (1..=10_000_000).contains(&divider.lower)
                && u64::from(divider.upper) <= 99 * u64::from(divider.lower)
        });
    let diameter = |micrometres: u32| (10_000..=1_000_000).contains(&micrometres);
    gains(&config.forward)
        && gains(&config.rotation)
        && (1..=8).contains(&config.cells)
        && number(config.adc_max_voltage, (1 << 32) / 10, 10 << 32)
        && (1..=65_535).contains(&config.adc_max_word)
        && dividers
        && platform.counts_per_turn >= 100
        && diameter(platform.wheel_diameter_left)
        && diameter(platform.wheel_diameter_right)
        && (20_000..=2_000_000).contains(&platform.track)
        && platform.rangefinders <= 3
        && (20..=2_000).contains(&platform.stop_deadline)
        && platform.dead_zone_left < platform.limit_left
        && platform.limit_left <= 10_000
        && platform.dead_zone_right < platform.limit_right
        && platform.limit_right <= 10_000
        && platform.log_baud >= 9_600
        && platform.log_baud <= 2_000_000
        && platform.battery_cutoff <= platform.battery_warn
        && platform.battery_warn <= 5_000
        && platform.rotation_tolerance <= 0x2000
        && platform.log_period <= 60_000
        && (config.mode != Mode::GuardedSweep || platform.servo && platform.rangefinders >= 1)
}

/// What [`check`] accepts is bounded.
// Requirement: WIRE-eeprom-4
pub fn accepted_configuration_is_bounded(config: AcceptedConfig) -> Seen {
    let AcceptedConfig(config) = config;
    if check(&config).is_err() {
        return Seen::NOTHING;
    }
    assert!(is_bounded(&config));
    let board = first_board();
    let (gains, battery) = (&config.forward, &config.dividers);
    let ends = [
        gains.p.to_scaled(32) == Ok(10_000 << 32),
        battery[0].upper == 10_000_000,
        config.platform.track == 20_000,
        config.platform.stop_deadline == 2_000,
    ];
    Seen::NOTHING
        .case(0, config != board)
        .case(1, ends.contains(&true))
}

/// What [`decode`] accepts is bounded: a good image with anything written over two of its fields and
/// the checksum mended.
pub fn decoded_configuration_is_bounded(one: u16, first: u64, two: u16, second: u64) -> Seen {
    let mut image = first_image(0);
    for (at, value) in [(one, first), (two, second)] {
        for (place, byte) in value.to_le_bytes().into_iter().enumerate() {
            if let Some(slot) = image.get_mut(usize::from(at % 0x338) + place) {
                *slot = byte;
            }
        }
    }
    mend(&mut image);
    let decoded = decode(&image);
    if let Ok(config) = &decoded {
        assert!(is_bounded(config));
    }
    Seen::NOTHING
        .case(0, decoded.is_ok())
        .case(1, decoded.is_err())
}

crate::properties! {
    theorem T5 accepted_configuration_is_bounded(config: AcceptedConfig) {
        cases ["other than the first board's", "at the end of a range"];
        kani any_gains [unwind(66)] = (AcceptedConfig::of_any_gains(),);
        kani any_battery [unwind(66)] = (AcceptedConfig::of_any_battery(),);
        kani any_wheels [unwind(66)] = (AcceptedConfig::of_any_wheels(),);
        kani any_mode [unwind(66)] = (AcceptedConfig::of_any_mode(),);
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

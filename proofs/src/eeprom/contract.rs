//! T5: what an accepted configuration promises to everything downstream.

use fw_core::eeprom::fields::{
    ACCELERATION, ADC_MAX, ADC_MAX_WORD, BATTERY_CUTOFF, BATTERY_WARN, BLIND_SPEED, CELLS,
    COUNTS_PER_TURN, DEAD_ZONE_LEFT, DEAD_ZONE_RIGHT, DECELERATION, ENCODER_LEFT_REVERSED,
    ENCODER_RIGHT_REVERSED, FIELDS, FRONT_OVERHANG, FULL_SPEED_LEFT, FULL_SPEED_RIGHT, GYRO,
    LAYOUT_LENGTH, LAYOUT_VERSION, LIMIT_LEFT, LIMIT_RIGHT, LOG_BAUD, LOG_PERIOD, MAX_SPEED,
    MAX_YAW_RATE, MODE, MOTOR_LEFT_REVERSED, MOTOR_RIGHT_REVERSED, POSITION_TOLERANCE,
    RANGEFINDERS, REACTION_TIME, REVERSE_DISTANCE, REVERSE_SPEED, ROTATION_TOLERANCE, SERVO,
    SERVO_REVERSED, SERVO_TRAVEL, SIGNS_RESERVED, STOP_DEADLINE, STOP_DISTANCE, TAP_1_UPPER, TRACK,
    WHEEL_DIAMETER_LEFT, WHEEL_DIAMETER_RIGHT, YAW_ACCELERATION,
};
use fw_core::eeprom::{Config, Field, Gains, Image, Wheel};
use fw_core::wire::Mode;

use super::accepted::{AcceptedConfig, fields};
use crate::property::Seen;

/// The integers of `docs/interfaces.md` with a range narrower than their bytes: the smallest and the largest.
#[rustfmt::skip]
const RANGES: &[(&Field, u64, u64)] = &[
    (CELLS, 1, 8), (ADC_MAX_WORD, 1, 65_535), (LAYOUT_VERSION, 2, 2), (LAYOUT_LENGTH, 0x52, 0x52),
    (COUNTS_PER_TURN, 100, 60_000), (WHEEL_DIAMETER_LEFT, 10_000, 1_000_000),
    (WHEEL_DIAMETER_RIGHT, 10_000, 1_000_000), (TRACK, 20_000, 2_000_000),
    (ENCODER_LEFT_REVERSED, 0, 1), (ENCODER_RIGHT_REVERSED, 0, 1), (MOTOR_LEFT_REVERSED, 0, 1),
    (MOTOR_RIGHT_REVERSED, 0, 1), (SERVO_REVERSED, 0, 1), (SIGNS_RESERVED, 0, 0),
    (RANGEFINDERS, 0, 3), (SERVO, 0, 1), (GYRO, 0, 1), (STOP_DEADLINE, 20, 2_000),
    (DEAD_ZONE_LEFT, 0, 9_999), (DEAD_ZONE_RIGHT, 0, 9_999), (LIMIT_LEFT, 1, 10_000),
    (LIMIT_RIGHT, 1, 10_000), (LOG_BAUD, 9_600, 2_000_000), (BATTERY_WARN, 0, 5_000),
    (BATTERY_CUTOFF, 0, 5_000), (POSITION_TOLERANCE, 200, 65_535), (ROTATION_TOLERANCE, 8, 8_192),
    (LOG_PERIOD, 0, 60_000), (SERVO_TRAVEL, 0, 32_768), (STOP_DISTANCE, 0, 2_000),
    (FRONT_OVERHANG, 0, 1_000), (REACTION_TIME, 0, 1_000), (DECELERATION, 50, 10_000),
    (BLIND_SPEED, 0, 2_000), (REVERSE_SPEED, 0, 2_000), (REVERSE_DISTANCE, 0, 10_000),
    (MAX_SPEED, 10, 2_000), (MAX_YAW_RATE, 256, 32_768), (ACCELERATION, 50, 10_000),
    (YAW_ACCELERATION, 256, 65_535), (FULL_SPEED_LEFT, 1, 5_000), (FULL_SPEED_RIGHT, 1, 5_000),
];

/// Half of 2⁻³²: rounded to the even neighbour, as the ends of both ranges are.
const HALF: f64 = 1.0 / 8_589_934_592.0;
/// The outermost numbers that are rounded to the ends: -0 and 10000, 0.1 and 10.
const GAIN_ENDS: [u64; 2] = [(-HALF).to_bits(), (10_000.0 + HALF).to_bits()];
const ADC_ENDS: [u64; 2] = [(858_993_459.0 * HALF).to_bits(), (10.0 + HALF).to_bits()];

/// Whether the tables of `docs/interfaces.md` accept these raw values, without the code's own ranges.
fn is_acceptable(values: &AcceptedConfig) -> bool {
    let get = |field: &Field| values.get(field);
    // Numbers of one sign are ordered as their bits.
    let real = |field: &Field, [min, max]: [u64; 2]| match get(field) {
        negative if negative >> 63 == 1 => negative <= min,
        positive => positive <= max && (positive >= min || min >> 63 == 1),
    };
    let mut gains = fields().filter(|field| field.address >> 8 == 1);
    let cells = get(CELLS);
    let mut right = gains.all(|gain| real(gain, GAIN_ENDS))
        && real(ADC_MAX, ADC_ENDS)
        && matches!(get(MODE), 0..=2 | 0x10..=0x12 | 0x20 | 0x30)
        && get(DEAD_ZONE_LEFT) < get(LIMIT_LEFT)
        && get(DEAD_ZONE_RIGHT) < get(LIMIT_RIGHT)
        && get(BATTERY_CUTOFF) <= get(BATTERY_WARN)
        && (get(MODE) != 0x20 || get(SERVO) == 1 && get(RANGEFINDERS) >= 1);
    // Not over the slice, as for the fields.
    for (field, min, max) in (0..RANGES.len()).map(|at| RANGES[at]) {
        right &= min <= get(field) && get(field) <= max;
    }
    let mut taps = fields().filter(|field| field.tap != 0);
    while let (Some(upper), Some(lower)) = (taps.next(), taps.next()) {
        right &= u64::from(upper.tap) > cells
            || get(upper) <= 10_000_000
                && (1..=10_000_000).contains(&get(lower))
                && get(upper) <= 99 * get(lower);
    }
    right
}

/// Raw values are accepted exactly when the tables accept them.
// Requirement: WIRE-eeprom-4, WIRE-eeprom-10, WIRE-eeprom-13, WIRE-refused-1, WIRE-refused-3, WIRE-refused-4
// Requirement: WIRE-refused-5, WIRE-refused-6, WIRE-refused-7
pub fn acceptance_is_the_tables(values: AcceptedConfig, which: u8, raw: u64) -> Seen {
    let field = &FIELDS[usize::from(which) % FIELDS.len()];
    let values = values.with(field, raw & field.kind.max());
    let right = is_acceptable(&values);
    assert!(Config::from_fields(|field| values.get(field)).is_ok() == right);
    // Not by Kani, which took twice the time.
    assert!(cfg!(kani) || values.checked().0 == right);
    Seen::NOTHING.case(0, right).case(1, !right)
}

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
            && (1..=5_000).contains(&wheel.full_speed_mm_s)
    };
    // Not over the slice: CBMC would go as far as the harnesses' bound.
    let dividers = (0..8).all(|cell| match config.dividers().get(cell) {
        Some(divider) => {
            (1..=10_000_000).contains(&divider.lower.0)
                && u64::from(divider.upper.0) <= 99 * u64::from(divider.lower.0)
        }
        None => cell >= usize::from(config.cells()),
    });
    let servo = config
        .servo()
        .is_none_or(|servo| (1..=1 << 31).contains(&servo.travel.0));
    let (stop, limits) = (config.obstacle_stop(), config.velocity_limits());
    let rate = |rate: u16| (50..=10_000).contains(&rate);
    let obstacle_stop = stop.stop_distance_mm <= 2_000
        && stop.overhang_mm <= 1_000
        && stop.reaction_time.0 <= 1_000
        && rate(stop.deceleration_mm_s2)
        && stop.blind_speed_mm_s.max(stop.reverse_speed_mm_s) <= 2_000
        && stop.reverse_distance_mm <= 10_000;
    let velocity_limits = (10..=2_000).contains(&limits.speed_mm_s)
        && (1 << 24..=1 << 31).contains(&limits.yaw_rate)
        && rate(limits.acceleration_mm_s2)
        && limits.yaw_acceleration >= 1 << 24;
    gains(config.forward())
        && obstacle_stop
        && velocity_limits
        && gains(config.rotation())
        && (1..=8).contains(&config.cells())
        && config.dividers().len() == usize::from(config.cells())
        && ((1 << 32) / 10..=10 << 32).contains(&config.adc_max_volts().to_bits())
        && config.adc_max_word() >= 1
        && dividers
        && (100..=60_000).contains(&config.counts_per_turn())
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

/// What [`Config::from_fields`] accepts is bounded. Kani decides each group of fields with the others as on the first
/// board; groups together are sampled.
// Requirement: WIRE-eeprom-4
pub fn accepted_configuration_is_bounded(values: AcceptedConfig) -> Seen {
    given!(let (true, config) = values.checked());
    assert!(is_bounded(&config));
    let ends = [
        config.forward().p.value().to_bits() == 10_000 << 32,
        values.get(TAP_1_UPPER) == 10_000_000,
        values.get(TRACK) == 20_000,
        values.get(STOP_DEADLINE) == 2_000,
        values.get(CELLS) == 8,
    ];
    // Field by field: CBMC compares arrays byte by byte, beyond the harnesses' bound.
    let differs = |field| values.get(field) != AcceptedConfig::FIRST_BOARD.get(field);
    seen!(fields().any(differs), ends.contains(&true))
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
    seen!(decoded.is_ok(), decoded.is_err())
}

/// Every field with every range's ends and their neighbours, and every single bit.
#[cfg(test)]
fn each_field() -> impl Iterator<Item = (AcceptedConfig, u8, u64)> {
    let ends = RANGES.iter().flat_map(|&(_, min, max)| [min, max]);
    let ends = ends.flat_map(|end| [end.wrapping_sub(1), end, end + 1]);
    let bits = (0..64).map(|bit| 1_u64 << bit);
    let reals = GAIN_ENDS.into_iter().chain(ADC_ENDS);
    let reals = reals.flat_map(|end| [end - 1, end, end + 1]);
    let raws: Vec<_> = ends.chain(bits).chain(reals).chain([u64::MAX]).collect();
    (0..FIELDS.len()).flat_map(move |which| {
        let which = u8::try_from(which).unwrap_or(0);
        raws.clone()
            .into_iter()
            .map(move |raw| (AcceptedConfig::FIRST_BOARD, which, raw))
    })
}

/// Any raw values in these fields; every tap has a divider.
#[cfg(kani)]
fn with_dividers(chosen: impl Fn(&Field) -> bool) -> AcceptedConfig {
    let mut values = AcceptedConfig::of_any(chosen);
    for field in fields().filter(|field| field.tap != 0) {
        values = values.with(field, 1);
    }
    values
}

crate::properties! {
    theorem T5 accepted_configuration_is_bounded(values: AcceptedConfig) {
        cases ["other than the first board's", "at the end of a range"];
        kani any_gains [unwind(80)] = (AcceptedConfig::of_any_page(1),);
        kani any_cells [unwind(80), solver(minisat)] = (with_dividers(|field| field.address == CELLS.address),);
        kani any_adc [unwind(80)] = (with_dividers(|field| {
            field.address >> 8 == 2 && field.tap == 0
        }).with(CELLS, 8),);
        kani any_dividers [unwind(80), solver(minisat)] = (AcceptedConfig::of_any(|field| field.tap != 0).with(CELLS, 8),);
        kani any_wheels [unwind(80)] = (AcceptedConfig::of_any_wheels(),);
        kani any_mode [unwind(80)] = (AcceptedConfig::of_any_mode(),);
        sampled 50_000;
    }
    property T3 acceptance_is_the_tables(values: AcceptedConfig, which: u8, raw: u64) {
        cases ["accepted", "rejected"];
        kani any_gains [unwind(80), solver(minisat)] = (AcceptedConfig::of_any_page(1), 0, any());
        kani any_battery [unwind(80), solver(minisat)] = (AcceptedConfig::of_any_page(2), 0, any());
        kani any_wheels [unwind(80)] = (AcceptedConfig::of_any_wheels(), 1, any());
        kani any_mode [unwind(80)] = (AcceptedConfig::of_any_mode(), 1, any());
        stepped each_field();
        sampled 100_000;
    }
    property T5 decoded_configuration_is_bounded(one: u16, first: u64, two: u16, second: u64) {
        cases ["accepted", "rejected"];
        stepped (0x0C..0x338_u16).flat_map(|at| {
            (0..=255).step_by(5).map(move |byte: u64| (at, byte, 0, 0x8C7B_6A59_4837_2615))
        });
        sampled 50_000;
    }
}

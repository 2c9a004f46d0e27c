//! Conditions between fields.

use super::fields::{
    BATTERY_CUTOFF, DEAD_ZONE_LEFT, DEAD_ZONE_RIGHT, RANGEFINDERS, SERVO, TAP_1_UPPER, TAP_2_UPPER,
    TAP_3_UPPER, TAP_4_UPPER, TAP_5_UPPER, TAP_6_UPPER, TAP_7_UPPER, TAP_8_UPPER,
};
use super::{Config, Divider, Field};
use crate::wire::Mode;

/// A condition between fields.
#[derive(Debug)]
pub struct Constraint {
    /// The field that is named where it does not hold.
    pub field: &'static Field,
    /// What this field must be, in words.
    pub expected: &'static str,
    /// Whether a configuration whose fields are all within their ranges meets it; the second
    /// argument is the field's tap.
    pub holds: fn(&Config, u8) -> bool,
}

const fn constraint(
    field: &'static Field,
    expected: &'static str,
    holds: fn(&Config, u8) -> bool,
) -> Constraint {
    Constraint {
        field,
        expected,
        holds,
    }
}

/// With an ADC of at most 10 V, a tap of at most 1000 V: inside the type of a voltage.
const RATIO: &str = "at most 99 times the lower resistor";

// Requirement: WIRE-refused-5
fn within_ratio(config: &Config, tap: u8) -> bool {
    let in_use = config.dividers();
    let divider = in_use.get(usize::from(tap).wrapping_sub(1));
    divider.is_none_or(|Divider { upper, lower }| {
        u64::from(upper.0) <= u64::from(lower.0).saturating_mul(99)
    })
}

/// Every constraint, in the order in which they are checked.
// Requirement: WIRE-refused-1
pub static CONSTRAINTS: &[Constraint] = &[
    constraint(TAP_1_UPPER, RATIO, within_ratio),
    constraint(TAP_2_UPPER, RATIO, within_ratio),
    constraint(TAP_3_UPPER, RATIO, within_ratio),
    constraint(TAP_4_UPPER, RATIO, within_ratio),
    constraint(TAP_5_UPPER, RATIO, within_ratio),
    constraint(TAP_6_UPPER, RATIO, within_ratio),
    constraint(TAP_7_UPPER, RATIO, within_ratio),
    constraint(TAP_8_UPPER, RATIO, within_ratio),
    constraint(RANGEFINDERS, "at least 1 in mode 0x20", |config, _| {
        config.mode() != Mode::GuardedSweep || config.rangefinders() >= 1
    }),
    constraint(SERVO, "1 in mode 0x20", |config, _| {
        config.mode() != Mode::GuardedSweep || config.servo().is_some()
    }),
    constraint(DEAD_ZONE_LEFT, "less than limit_left", |config, _| {
        config.left().dead_zone < config.left().limit
    }),
    constraint(DEAD_ZONE_RIGHT, "less than limit_right", |config, _| {
        config.right().dead_zone < config.right().limit
    }),
    constraint(BATTERY_CUTOFF, "at most battery_warn", |config, _| {
        config.battery_cutoff() <= config.battery_warn()
    }),
];

//! Conditions between fields.

use super::fields::{
    BATTERY_CUTOFF, DEAD_ZONE_LEFT, DEAD_ZONE_RIGHT, FIELDS, RANGEFINDERS, SERVO, TAP_1_UPPER,
    TAP_2_UPPER, TAP_3_UPPER, TAP_4_UPPER, TAP_5_UPPER, TAP_6_UPPER, TAP_7_UPPER, TAP_8_UPPER,
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
    condition: Condition,
}

/// What must hold; a value and not a function, so that the machine code has no indirect call.
#[derive(Clone, Copy, Debug)]
enum Condition {
    WithinRatio,
    ScanHasRangefinder,
    ScanHasServo,
    LeftDeadZoneBelowLimit,
    RightDeadZoneBelowLimit,
    CutoffAtMostWarn,
}

#[allow(clippy::indexing_slicing, reason = "evaluated by the compiler")]
const fn constraint(
    field: &'static Field,
    expected: &'static str,
    condition: Condition,
) -> Constraint {
    Constraint {
        field: &FIELDS[field.index as usize],
        expected,
        condition,
    }
}

impl Constraint {
    /// Whether a configuration whose fields are all within their ranges meets it.
    pub fn holds(&self, config: &Config) -> bool {
        let scans = config.mode() == Mode::GuardedSweep;
        let (left, right) = (config.left(), config.right());
        match self.condition {
            Condition::WithinRatio => within_ratio(config, self.field.tap),
            Condition::ScanHasRangefinder => !scans || config.rangefinders() >= 1,
            Condition::ScanHasServo => !scans || config.servo().is_some(),
            Condition::LeftDeadZoneBelowLimit => left.dead_zone < left.limit,
            Condition::RightDeadZoneBelowLimit => right.dead_zone < right.limit,
            Condition::CutoffAtMostWarn => config.battery_cutoff() <= config.battery_warn(),
        }
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
    constraint(TAP_1_UPPER, RATIO, Condition::WithinRatio),
    constraint(TAP_2_UPPER, RATIO, Condition::WithinRatio),
    constraint(TAP_3_UPPER, RATIO, Condition::WithinRatio),
    constraint(TAP_4_UPPER, RATIO, Condition::WithinRatio),
    constraint(TAP_5_UPPER, RATIO, Condition::WithinRatio),
    constraint(TAP_6_UPPER, RATIO, Condition::WithinRatio),
    constraint(TAP_7_UPPER, RATIO, Condition::WithinRatio),
    constraint(TAP_8_UPPER, RATIO, Condition::WithinRatio),
    constraint(
        RANGEFINDERS,
        "at least 1 in mode 0x20",
        Condition::ScanHasRangefinder,
    ),
    constraint(SERVO, "1 in mode 0x20", Condition::ScanHasServo),
    constraint(
        DEAD_ZONE_LEFT,
        "less than limit_left",
        Condition::LeftDeadZoneBelowLimit,
    ),
    constraint(
        DEAD_ZONE_RIGHT,
        "less than limit_right",
        Condition::RightDeadZoneBelowLimit,
    ),
    constraint(
        BATTERY_CUTOFF,
        "at most battery_warn",
        Condition::CutoffAtMostWarn,
    ),
];

//! What fields must hold together.

use super::{Config, Divider};
use crate::wire::Mode;

/// A condition between fields; the one at `address` is named when it does not hold.
#[derive(Debug)]
pub struct Rule {
    /// The field to name.
    pub address: u16,
    /// What it must be, in words.
    pub expected: &'static str,
    /// Whether a configuration whose fields are all within their ranges meets it.
    pub holds: fn(&Config) -> bool,
}

/// With an ADC of at most 10 V, a tap of at most 1000 V: inside the type of a voltage.
const RATIO: &str = "at most 99 times the lower resistor";

// Requirement: WIRE-refused-5
fn within_ratio(config: &Config, tap: u8) -> bool {
    let divider = config.dividers.get(usize::from(tap)).copied();
    let Divider { upper, lower } = divider.unwrap_or_default();
    tap >= config.cells || u64::from(upper) <= u64::from(lower).saturating_mul(99)
}

/// Every rule, in the order in which they are checked.
// Requirement: WIRE-refused-1
#[rustfmt::skip]
pub static RULES: &[Rule] = &[
    Rule { address: 0x0210, expected: RATIO, holds: |config| within_ratio(config, 0) },
    Rule { address: 0x0218, expected: RATIO, holds: |config| within_ratio(config, 1) },
    Rule { address: 0x0220, expected: RATIO, holds: |config| within_ratio(config, 2) },
    Rule { address: 0x0228, expected: RATIO, holds: |config| within_ratio(config, 3) },
    Rule { address: 0x0230, expected: RATIO, holds: |config| within_ratio(config, 4) },
    Rule { address: 0x0238, expected: RATIO, holds: |config| within_ratio(config, 5) },
    Rule { address: 0x0240, expected: RATIO, holds: |config| within_ratio(config, 6) },
    Rule { address: 0x0248, expected: RATIO, holds: |config| within_ratio(config, 7) },
    Rule {
        address: 0x0311,
        expected: "at least 1 in mode 0x20",
        holds: |config| config.mode != Mode::GuardedSweep || config.platform.rangefinders >= 1,
    },
    Rule {
        address: 0x0318,
        expected: "1 in mode 0x20",
        holds: |config| config.mode != Mode::GuardedSweep || config.platform.servo,
    },
    Rule {
        address: 0x031C,
        expected: "less than limit_left",
        holds: |config| config.platform.dead_zone_left < config.platform.limit_left,
    },
    Rule {
        address: 0x031E,
        expected: "less than limit_right",
        holds: |config| config.platform.dead_zone_right < config.platform.limit_right,
    },
    Rule {
        address: 0x032A,
        expected: "at most battery_warn",
        holds: |config| config.platform.battery_cutoff <= config.platform.battery_warn,
    },
];

//! Configurations that [`Config::from_fields`] accepts, drawn field by field over the whole of every
//! field's range.

use fixed::types::I32F32;
use fw_core::binary64::Binary64;
use fw_core::eeprom::fields::{
    BATTERY_CUTOFF, BATTERY_WARN, CELLS, COUNT, DEAD_ZONE_LEFT, DEAD_ZONE_RIGHT, FIELDS,
    FIRST_BOARD, FORWARD_ANTI_WINDUP, FORWARD_D, FORWARD_I, FORWARD_P, LIMIT_LEFT, LIMIT_RIGHT,
    MODE, RANGEFINDERS, ROTATION_ANTI_WINDUP, ROTATION_D, ROTATION_I, ROTATION_P, SERVO,
};
use fw_core::eeprom::{Accepted, CONSTRAINTS, Config, Field, Gain, Gains, Kind};
use fw_core::wire::Mode;

use crate::input::{Input, Source};

/// The raw values of a configuration, in the order of [`FIELDS`]. In rows: CBMC keeps up to 64 elements apart.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct AcceptedConfig([[u64; 16]; COUNT.div_ceil(16)]);

/// Every field. Not over the slice, whose pointers cost CBMC twice the steps.
pub fn fields() -> impl Iterator<Item = &'static Field> + Clone {
    (0..COUNT).map(|at| &FIELDS[at])
}

/// The first board's gains of the forward PID.
pub fn forward_gains() -> Gains {
    gains([FORWARD_P, FORWARD_I, FORWARD_D, FORWARD_ANTI_WINDUP])
}

/// The first board's gains of the rotation PID.
pub fn rotation_gains() -> Gains {
    gains([ROTATION_P, ROTATION_I, ROTATION_D, ROTATION_ANTI_WINDUP])
}

fn gains([p, i, d, anti_windup]: [&Field; 4]) -> Gains {
    let gain = |field: &Field| {
        let value = Binary64(FIRST_BOARD[usize::from(field.index)]).to_fixed();
        Gain::new(value.unwrap_or_default()).unwrap_or_default()
    };
    Gains {
        p: gain(p),
        i: gain(i),
        d: gain(d),
        anti_windup: gain(anti_windup),
    }
}

impl AcceptedConfig {
    /// The first board's.
    pub const FIRST_BOARD: Self = {
        let (mut rows, mut at) = ([[0; 16]; COUNT.div_ceil(16)], 0);
        while at < COUNT {
            rows[at / 16][at % 16] = FIRST_BOARD[at];
            at += 1;
        }
        Self(rows)
    };

    /// The raw value of a field.
    pub fn get(&self, field: &Field) -> u64 {
        self.0[usize::from(field.index) / 16][usize::from(field.index) % 16]
    }

    /// With another raw value in a field.
    #[must_use]
    pub fn with(mut self, field: &Field, raw: u64) -> Self {
        self.0[usize::from(field.index) / 16][usize::from(field.index) % 16] = raw;
        self
    }

    /// The configuration, if it is accepted: always for a drawn one; Kani's harnesses and
    /// [`Self::with`] put any values in here.
    pub fn config(&self) -> Option<Config> {
        Config::from_fields(|field| self.get(field)).ok()
    }

    /// What the values mean, and whether they are accepted: apart, CBMC keeps what is known of them. As
    /// [`Config::from_fields`], but for the fields that hold what the first board's hold, as tests expect.
    pub fn checked(&self) -> (bool, Config) {
        let config = Config::of_checked(&|field: &'static Field| self.get(field));
        let cells = config.cells();
        let same = |at: usize| self.0[at / 16][at % 16] == FIRST_BOARD[at];
        let same_cells = same(CELLS.index.into());
        let (mut accepted, mut at) = (true, 0);
        // CBMC writes a trace for every assertion that is reached: an iterator's steps would be most of it.
        while at < COUNT {
            let field = &FIELDS[at];
            accepted = accepted
                && (same(at) && (field.tap == 0 || same_cells)
                    || field.contains(self.0[at / 16][at % 16], cells));
            at += 1;
        }
        at = 0;
        while at < CONSTRAINTS.len() {
            accepted = accepted && CONSTRAINTS[at].holds(&config);
            at += 1;
        }
        (accepted, config)
    }

    /// Any raw values in these fields; the others are the first board's.
    #[cfg(kani)]
    pub fn of_any(chosen: impl Fn(&Field) -> bool) -> Self {
        let (mut values, mut at) = (Self::FIRST_BOARD, 0);
        while at < COUNT {
            if chosen(&FIELDS[at]) {
                let any: u64 = crate::input::any();
                values.0[at / 16][at % 16] = any & FIELDS[at].kind.max();
            }
            at += 1;
        }
        values
    }

    /// Any gains of both regulators (page 1), any battery (2) or any platform (3).
    #[cfg(kani)]
    pub fn of_any_page(page: u16) -> Self {
        Self::of_any(|field| field.address >> 8 == page)
    }

    /// Any wheels and motors.
    #[cfg(kani)]
    pub fn of_any_wheels() -> Self {
        Self::of_any(is_of_a_wheel)
    }

    /// Any mode, and any platform but its wheels and motors.
    #[cfg(kani)]
    pub fn of_any_mode() -> Self {
        Self::of_any(|field| matches!(field.address >> 8, 0 | 3) && !is_of_a_wheel(field))
    }
}

/// Whether a field describes a wheel, its motor or its encoder.
#[cfg(kani)]
fn is_of_a_wheel(field: &Field) -> bool {
    matches!(field.address, 0x0302..=0x030F | 0x031C..=0x0323)
        || field.address == 0x0310 && field.kind.mask() < 1 << 4
}

/// A raw value that `field` accepts: both ends of its range often, all of it sometimes; `shape` is
/// below 128.
fn accepted(field: &Field, shape: u8, source: &mut impl Source) -> u64 {
    let anything = source.bits(64);
    match *field.accepted {
        Accepted::IntRange { min, max } => {
            let (min, max) = (u64::from(min), u64::from(max).min(field.kind.max()));
            match shape % 8 {
                0 => min,
                1 => max,
                2 => min + (anything & 0xFF).min(max - min),
                _ => min + anything % (max - min + 1),
            }
        }
        Accepted::RealRange { min, max } => {
            let (low, high) = (u64::from(min), u64::from(max) << 32);
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
    }
}

impl Input for AcceptedConfig {
    fn draw(source: &mut impl Source) -> Self {
        let mut values = Self::FIRST_BOARD;
        for field in fields() {
            // Half of the fields stay as they are on the first board, and take a byte each.
            let shape = match field.kind {
                Kind::Bits { .. } if field.constant().is_some() => 0,
                _ => source.bits8(),
            };
            if shape & 1 == 1 {
                values = values.with(field, accepted(field, shape >> 1, source));
            }
        }
        // The constraints.
        let taps = fields().filter(|field| field.tap != 0);
        for (upper, lower) in taps.clone().step_by(2).zip(taps.skip(1).step_by(2)) {
            let ohms = values.get(lower).clamp(1, 10_000_000);
            let most = 10_000_000.min(ohms * 99);
            values = values
                .with(lower, ohms)
                .with(upper, values.get(upper).min(most));
        }
        if values.get(MODE) == u64::from(Mode::GuardedSweep.code()) {
            let rangefinders = values.get(RANGEFINDERS).max(1);
            values = values.with(SERVO, 1).with(RANGEFINDERS, rangefinders);
        }
        for (below, limit) in [
            (DEAD_ZONE_LEFT, values.get(LIMIT_LEFT) - 1),
            (DEAD_ZONE_RIGHT, values.get(LIMIT_RIGHT) - 1),
            (BATTERY_CUTOFF, values.get(BATTERY_WARN)),
        ] {
            values = values.with(below, values.get(below).min(limit));
        }
        values
    }
}

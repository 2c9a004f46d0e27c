//! The register map as one table: what stands where, in which unit, and what is accepted.
//!
//! Decoding, encoding, checking, error messages and the tools on the Pi all go along it. The ranges
//! are wide enough for any robot of this kind and narrow enough that nothing downstream can
//! overflow or divide by zero; each says why it is what it is.
#![allow(
    clippy::cast_possible_truncation,
    reason = "a raw value is as wide as the field it was read from"
)]

use super::error::Value;
use super::Config;
use crate::binary64::Binary64;
use crate::wire::Mode;
use fixed::types::I32F32;

/// How a field is stored; several bytes are little-endian.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Kind {
    /// One byte.
    U8,
    /// Two bytes.
    U16,
    /// Four bytes.
    U32,
    /// IEEE-754 binary64, eight bytes.
    Binary64,
}

impl Kind {
    /// Bytes.
    #[must_use]
    pub const fn len(self) -> usize {
        match self {
            Self::U8 => 1,
            Self::U16 => 2,
            Self::U32 => 4,
            Self::Binary64 => 8,
        }
    }

    /// Never: every kind has bytes.
    #[must_use]
    pub const fn is_empty(self) -> bool {
        false
    }
}

/// What a field may hold.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Accepted {
    /// The EEPROM key ([`super::KEY`]).
    Key,
    /// The number of a mode.
    Mode,
    /// An integer, both ends included.
    Whole {
        /// The smallest.
        min: u32,
        /// The largest.
        max: u32,
    },
    /// A finite double that, to the nearest 2⁻³², lies in here, both ends included.
    Number {
        /// The smallest.
        min: I32F32,
        /// The largest.
        max: I32F32,
    },
    /// This checksum.
    Checksum(u32),
    /// What another field demands.
    Rule(&'static str),
}

impl Accepted {
    /// Whether a field's bits are accepted.
    // Requirement: WIRE-eeprom-10, WIRE-refused-3
    fn takes(self, raw: u64) -> bool {
        match self {
            Self::Mode => u8::try_from(raw).is_ok_and(|code| Mode::from_code(code).is_some()),
            Self::Whole { min, max } => (u64::from(min)..=u64::from(max)).contains(&raw),
            Self::Number { min, max } => Binary64(raw)
                .to_fixed()
                .is_ok_and(|number| (min..=max).contains(&number)),
            Self::Checksum(sum) => raw == u64::from(sum),
            Self::Key | Self::Rule(_) => true,
        }
    }
}

/// A field of the register map.
#[derive(Debug)]
pub struct Field {
    /// Where its first byte stands.
    pub address: u16,
    /// Its name: the path in [`Config`], dividers counted from 1.
    pub name: &'static str,
    /// Its unit; empty where it has none.
    pub unit: &'static str,
    /// How it is stored.
    pub kind: Kind,
    /// What it may hold.
    pub accepted: &'static Accepted,
    /// The battery tap it belongs to, from 1: with fewer cells it may hold anything. 0 = none.
    pub tap: u8,
}

impl Field {
    /// Its bits in a configuration.
    #[must_use]
    pub fn get(&self, config: &Config) -> u64 {
        get(self.address, config)
    }

    /// Stores its bits in a configuration; bits that no field can hold change nothing.
    pub fn set(&self, config: &mut Config, raw: u64) {
        match config
            .dividers
            .get_mut(usize::from(self.tap).wrapping_sub(1))
        {
            // The upper resistor's word and the lower one's take turns.
            Some(divider) if self.address & 4 == 0 => divider.upper = raw as u32,
            Some(divider) => divider.lower = raw as u32,
            None => set(self.address, config, raw),
        }
    }

    /// Its value, as an error shows it.
    #[must_use]
    pub const fn value(&self, raw: u64) -> Value {
        match self.kind {
            Kind::Binary64 => Value::Number(Binary64(raw)),
            Kind::U8 | Kind::U16 | Kind::U32 => Value::Whole(raw as u32),
        }
    }

    /// Whether its bits are accepted in a robot of `cells` cells.
    // Requirement: WIRE-eeprom-4, WIRE-eeprom-13
    #[must_use]
    pub fn takes(&self, raw: u64, cells: u8) -> bool {
        self.tap > cells || self.accepted.takes(raw)
    }

    /// The field at an address.
    #[must_use]
    pub fn at(address: u16) -> Option<&'static Self> {
        FIELDS.iter().find(|field| field.address == address)
    }
}

const fn whole(min: u32, max: u32) -> Accepted {
    Accepted::Whole { min, max }
}

const ANY: Accepted = whole(0, u32::MAX);
const SWITCH: Accepted = whole(0, 1);
/// A negative factor would drive away from the target. Ten thousand percent of duty per millimetre,
/// degree or sample is full duty at the smallest error there is.
// Requirement: WIRE-refused-4
const FACTOR: Accepted = Accepted::Number {
    min: I32F32::ZERO,
    max: I32F32::lit("10000"),
};
/// From 10 mm, a wheel smaller than which the motor's shaft would not fit, to 1 m.
const DIAMETER: Accepted = whole(10_000, 1_000_000);
/// Larger than any divider for a battery needs; times a 16-bit word still far inside 64 bits.
const RESISTOR: u32 = 10_000_000;
/// Hundredths of a percent; a limit of 0 would be a robot that cannot move.
const LIMIT: Accepted = whole(1, 10_000);

/// One kind of field: its row in the table, how its bits are read from a [`Config`], how they are
/// stored there.
macro_rules! whole_field {
    (row $address:literal, $name:literal, $unit:literal, $kind:ident $type:ident, $accepted:expr,
     $tap:literal, $($path:tt)+) => {
        row($address, $name, $unit, Kind::$kind, &$accepted, $tap)
    };
    (get $config:ident, $name:literal, $unit:literal, $kind:ident $type:ident, $accepted:expr,
     $tap:literal, $($path:tt)+) => {
        u64::from($config.$($path)+)
    };
    (set $config:ident, $raw:ident, $name:literal, $unit:literal, $kind:ident $type:ident,
     $accepted:expr, $tap:literal, $($path:tt)+) => {
        $config.$($path)+ = $raw as $type
    };
}

/// Sixteen rows of the same: what a divider's tap and `upper` or `lower` say is enough to store it,
/// so [`Field::set`] does without an arm for each.
macro_rules! divider_field {
    (row $address:literal, $name:literal, $accepted:expr, $tap:literal, $end:ident) => {
        row($address, $name, "ohm", Kind::U32, &$accepted, $tap)
    };
    (get $config:ident, $name:literal, $accepted:expr, $tap:literal, $end:ident) => {
        u64::from($config.dividers[$tap - 1].$end)
    };
    (set $config:ident, $raw:ident, $name:literal, $accepted:expr, $tap:literal, $end:ident) => {
        ()
    };
}

macro_rules! double_field {
    (row $address:literal, $name:literal, $unit:literal, $accepted:expr, $($path:tt)+) => {
        row($address, $name, $unit, Kind::Binary64, &$accepted, 0)
    };
    (get $config:ident, $name:literal, $unit:literal, $accepted:expr, $($path:tt)+) => {
        $config.$($path)+.0
    };
    (set $config:ident, $raw:ident, $name:literal, $unit:literal, $accepted:expr,
     $($path:tt)+) => {
        $config.$($path)+ = Binary64($raw)
    };
}

macro_rules! switch_field {
    (row $address:literal, $name:literal, $accepted:expr, $($path:tt)+) => {
        row($address, $name, "", Kind::U8, &$accepted, 0)
    };
    (get $config:ident, $name:literal, $accepted:expr, $($path:tt)+) => {
        u64::from($config.$($path)+)
    };
    (set $config:ident, $raw:ident, $name:literal, $accepted:expr, $($path:tt)+) => {
        $config.$($path)+ = $raw == 1
    };
}

macro_rules! fixed_field {
    (row $address:literal, $name:literal, $kind:ident, $value:literal) => {
        row($address, $name, "", Kind::$kind, &whole($value, $value), 0)
    };
    (get $config:ident, $name:literal, $kind:ident, $value:literal) => {
        $value
    };
    (set $config:ident, $raw:ident, $name:literal, $kind:ident, $value:literal) => {
        ()
    };
}

macro_rules! mode_field {
    (row $address:literal, $name:literal) => {
        row($address, $name, "", Kind::U8, &Accepted::Mode, 0)
    };
    (get $config:ident, $name:literal) => {
        $config.mode.code().into()
    };
    (set $config:ident, $raw:ident, $name:literal) => {
        if let Some(mode) = Mode::from_code($raw as u8) {
            $config.mode = mode;
        }
    };
}

/// One bit for each sign, from bit 0.
macro_rules! signs_field {
    (row $address:literal, $name:literal, $($sign:ident $bit:literal),+) => {
        row($address, $name, "", Kind::U8, &whole(0, 0x1F), 0)
    };
    (get $config:ident, $name:literal, $($sign:ident $bit:literal),+) => {
        0 $(| u64::from($config.platform.$sign) << $bit)+
    };
    (set $config:ident, $raw:ident, $name:literal, $($sign:ident $bit:literal),+) => {{
        $($config.platform.$sign = $raw >> $bit & 1 != 0;)+
    }};
}

/// The table and the two ways between its bits and a [`Config`]. These are one function each and not
/// a pair of pointers a row: half the flash, and no indirect call.
macro_rules! fields {
    ($($(#[$attribute:meta])* $kind:ident!($address:literal, $($rest:tt)*)),* $(,)?) => {
        /// Every field, by address, but for the EEPROM key at 0x0000 and the checksum at 0x0334.
        pub static FIELDS: &[Field] = &[$($kind!(row $address, $($rest)*)),*];

        fn get(address: u16, config: &Config) -> u64 {
            match address {
                $($address => $kind!(get config, $($rest)*),)*
                _ => 0,
            }
        }

        fn set(address: u16, config: &mut Config, raw: u64) {
            match address {
                $($address => $kind!(set config, raw, $($rest)*),)*
                _ => {}
            }
        }
    };
}

const fn row(
    address: u16,
    name: &'static str,
    unit: &'static str,
    kind: Kind,
    accepted: &'static Accepted,
    tap: u8,
) -> Field {
    Field {
        address,
        name,
        unit,
        kind,
        accepted,
        tap,
    }
}

#[rustfmt::skip]
fields![
    // Page 0x00 (document, 6.0.1). Any byte can be a key.
    // Requirement: DOC-5.1.6-2
    whole_field!(0x000A, "key_from_pi", "", U8 u8, ANY, 0, key_from_pi),
    whole_field!(0x000B, "key_from_stm", "", U8 u8, ANY, 0, key_from_stm),
    // Requirement: DOC-6.0.1-2
    mode_field!(0x000C, "mode"),

    // Page 0x01 (document, 6.0.2).
    // Requirement: DOC-6.0.2-1
    double_field!(0x0100, "forward.p", "%/mm", FACTOR, forward.p),
    double_field!(0x0108, "forward.i", "%/mm", FACTOR, forward.i),
    double_field!(0x0110, "forward.d", "%/mm", FACTOR, forward.d),
    double_field!(0x0118, "forward.anti_windup", "", FACTOR, forward.anti_windup),
    double_field!(0x0120, "rotation.p", "%/deg", FACTOR, rotation.p),
    double_field!(0x0128, "rotation.i", "%/deg", FACTOR, rotation.i),
    double_field!(0x0130, "rotation.d", "%/deg", FACTOR, rotation.d),
    double_field!(0x0138, "rotation.anti_windup", "", FACTOR, rotation.anti_windup),

    // Page 0x02 (document, 6.0.3).
    // Requirement: WIRE-refused-7
    whole_field!(0x0203, "cells", "", U8 u8, whole(1, 8), 0, cells),
    // No microcontroller's ADC measures more than 10 V; less than 100 mV is noise.
    // Requirement: DOC-6.0.3-1, WIRE-refused-6
    double_field!(0x0204, "adc_max_voltage", "V", Accepted::Number {
        min: I32F32::lit("0.1"),
        max: I32F32::lit("10"),
    }, adc_max_voltage),
    // Up to 16 bits.
    whole_field!(0x020C, "adc_max_word", "", U32 u32, whole(1, 65_535), 0, adc_max_word),
    divider_field!(0x0210, "dividers.1.upper", whole(0, RESISTOR), 1, upper),
    // Requirement: WIRE-refused-5
    divider_field!(0x0214, "dividers.1.lower", whole(1, RESISTOR), 1, lower),
    divider_field!(0x0218, "dividers.2.upper", whole(0, RESISTOR), 2, upper),
    divider_field!(0x021C, "dividers.2.lower", whole(1, RESISTOR), 2, lower),
    divider_field!(0x0220, "dividers.3.upper", whole(0, RESISTOR), 3, upper),
    divider_field!(0x0224, "dividers.3.lower", whole(1, RESISTOR), 3, lower),
    divider_field!(0x0228, "dividers.4.upper", whole(0, RESISTOR), 4, upper),
    divider_field!(0x022C, "dividers.4.lower", whole(1, RESISTOR), 4, lower),
    divider_field!(0x0230, "dividers.5.upper", whole(0, RESISTOR), 5, upper),
    divider_field!(0x0234, "dividers.5.lower", whole(1, RESISTOR), 5, lower),
    divider_field!(0x0238, "dividers.6.upper", whole(0, RESISTOR), 6, upper),
    divider_field!(0x023C, "dividers.6.lower", whole(1, RESISTOR), 6, lower),
    divider_field!(0x0240, "dividers.7.upper", whole(0, RESISTOR), 7, upper),
    divider_field!(0x0244, "dividers.7.lower", whole(1, RESISTOR), 7, lower),
    divider_field!(0x0248, "dividers.8.upper", whole(0, RESISTOR), 8, upper),
    divider_field!(0x024C, "dividers.8.lower", whole(1, RESISTOR), 8, lower),

    // Page 0x03, ours.
    // Requirement: WIRE-platform-1
    fixed_field!(0x0300, "layout_version", U8, 1),
    fixed_field!(0x0301, "layout_length", U8, 0x38),
    // Below 100 counts a turn a count is centimetres and degrees.
    whole_field!(0x0302, "counts_per_turn", "", U16 u16, whole(100, 60_000), 0, platform.counts_per_turn),
    whole_field!(0x0304, "wheel_diameter_left", "um", U32 u32, DIAMETER, 0, platform.wheel_diameter_left),
    whole_field!(0x0308, "wheel_diameter_right", "um", U32 u32, DIAMETER, 0, platform.wheel_diameter_right),
    // Not narrower than two motors' shafts, not wider than a door is high.
    whole_field!(0x030C, "track", "um", U32 u32, whole(20_000, 2_000_000), 0, platform.track),
    signs_field!(0x0310, "signs", encoder_left_reversed 0, encoder_right_reversed 1,
        motor_left_reversed 2, motor_right_reversed 3, servo_reversed 4),
    whole_field!(0x0311, "rangefinders", "", U8 u8, whole(0, 3), 0, platform.rangefinders),
    whole_field!(0x0312, "bearings.front", "turn/65536", U16 u16, ANY, 0, platform.bearings[0]),
    whole_field!(0x0314, "bearings.right", "turn/65536", U16 u16, ANY, 0, platform.bearings[1]),
    whole_field!(0x0316, "bearings.left", "turn/65536", U16 u16, ANY, 0, platform.bearings[2]),
    switch_field!(0x0318, "servo", SWITCH, platform.servo),
    switch_field!(0x0319, "gyro", SWITCH, platform.gyro),
    // Two ticks at least; at the robot's 1 m/s, 2 s without a host are too far already.
    whole_field!(0x031A, "stop_deadline", "ms", U16 u16, whole(20, 2_000), 0, platform.stop_deadline),
    whole_field!(0x031C, "dead_zone_left", "0.01 %", U16 u16, whole(0, 9_999), 0, platform.dead_zone_left),
    whole_field!(0x031E, "dead_zone_right", "0.01 %", U16 u16, whole(0, 9_999), 0, platform.dead_zone_right),
    whole_field!(0x0320, "limit_left", "0.01 %", U16 u16, LIMIT, 0, platform.limit_left),
    whole_field!(0x0322, "limit_right", "0.01 %", U16 u16, LIMIT, 0, platform.limit_right),
    // The USART's divider from 100 MHz is 16 bits wide and at least 16.
    whole_field!(0x0324, "log_baud", "baud", U32 u32, whole(9_600, 2_000_000), 0, platform.log_baud),
    // Above any cell there is; 0 switches the supervision off.
    whole_field!(0x0328, "battery_warn", "mV", U16 u16, whole(0, 5_000), 0, platform.battery_warn),
    whole_field!(0x032A, "battery_cutoff", "mV", U16 u16, whole(0, 5_000), 0, platform.battery_cutoff),
    // A tolerance below what a count can tell is never met; half a turn is no rotation at all.
    whole_field!(0x032C, "position_tolerance", "um", U16 u16, whole(200, 65_535), 0, platform.position_tolerance),
    whole_field!(0x032E, "rotation_tolerance", "turn/65536", U16 u16, whole(8, 0x2000), 0, platform.rotation_tolerance),
    whole_field!(0x0330, "log_period", "ms", U16 u16, whole(0, 60_000), 0, platform.log_period),
    // A sensor that looks further back than sideways sees the robot.
    whole_field!(0x0332, "servo_travel", "turn/65536", U16 u16, whole(0, 0x8000), 0, platform.servo_travel),
];

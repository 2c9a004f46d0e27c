//! One field of the register map: where it is stored, its unit and what it may hold.

use super::error::FieldValue;
use super::fields::name;
use crate::binary64::Binary64;
use crate::wire::Mode;
use fixed::types::I32F32;

/// How a field is stored; several bytes are little-endian.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Kind {
    /// Some bits of one byte.
    Bits {
        /// Position of the lowest bit, 0 to 7.
        shift: u8,
        /// Number of bits, 1 to 8.
        width: u8,
    },
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
    /// Bytes that the field lies in, 1 to 8.
    #[must_use]
    pub const fn bytes(self) -> u16 {
        match self {
            Self::Bits { .. } | Self::U8 => 1,
            Self::U16 => 2,
            Self::U32 => 4,
            Self::Binary64 => 8,
        }
    }

    /// The bits of these bytes that belong to the field.
    #[must_use]
    pub const fn mask(self) -> u64 {
        match self {
            Self::Bits { shift, width } => {
                (0xFF >> (8_u8.saturating_sub(width) & 7)) << (shift & 7)
            }
            _ => u64::MAX >> (64_u16.saturating_sub(8 * self.bytes()) & 63),
        }
    }

    /// Position of the field's lowest bit.
    const fn shift(self) -> u8 {
        match self {
            Self::Bits { shift, .. } => shift & 7,
            _ => 0,
        }
    }

    /// The largest raw value.
    #[must_use]
    pub const fn max(self) -> u64 {
        self.mask() >> self.shift()
    }
}

/// The unit of a raw value.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Unit {
    /// A count, a code, a switch or a ratio.
    None,
    /// Percent of duty per millimetre.
    PercentPerMillimetre,
    /// Percent of duty per degree.
    PercentPerDegree,
    /// Hundredths of a percent of duty.
    PercentHundredths,
    /// Volts.
    Volts,
    /// Thousandths of a volt.
    Millivolts,
    /// Ohms.
    Ohms,
    /// Thousandths of a millimetre.
    Micrometres,
    /// Turn × 0x10000, counter-clockwise.
    Turns,
    /// Milliseconds.
    Milliseconds,
    /// Millimetres.
    Millimetres,
    /// Millimetres per second.
    MillimetresPerSecond,
    /// Millimetres per second, per second.
    MillimetresPerSecondSquared,
    /// Turns × 0x10000 per second.
    TurnsPerSecond,
    /// Turns × 0x10000 per second, per second.
    TurnsPerSecondSquared,
    /// Symbols per second.
    Baud,
}

impl Unit {
    /// As the log writes it, in ASCII; empty for none.
    #[must_use]
    pub const fn symbol(self) -> &'static str {
        match self {
            Self::None => "",
            Self::PercentPerMillimetre => "%/mm",
            Self::PercentPerDegree => "%/deg",
            Self::PercentHundredths => "0.01 %",
            Self::Volts => "V",
            Self::Millivolts => "mV",
            Self::Ohms => "ohm",
            Self::Micrometres => "um",
            Self::Turns => "turn/65536",
            Self::Milliseconds => "ms",
            Self::Millimetres => "mm",
            Self::MillimetresPerSecond => "mm/s",
            Self::MillimetresPerSecondSquared => "mm/s^2",
            Self::TurnsPerSecond => "turn/65536/s",
            Self::TurnsPerSecondSquared => "turn/65536/s^2",
            Self::Baud => "baud",
        }
    }
}

/// What a field may hold.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Accepted {
    /// The number of a mode.
    Mode,
    /// An integer, both ends included.
    IntRange {
        /// The smallest.
        min: u32,
        /// The largest.
        max: u32,
    },
    /// A finite binary64 that, to the nearest 2⁻³², lies in here, both ends included. No pointers:
    /// CBMC does not evaluate a constant union of them and integers.
    RealRange {
        /// The smallest, 2⁻³²: below 1.
        min: u32,
        /// The largest: a whole number below 2³¹.
        max: u32,
    },
}

impl Accepted {
    /// Whether a raw value is accepted.
    // Requirement: WIRE-eeprom-10, WIRE-refused-3, WIRE-refused-5
    #[must_use]
    pub fn contains(self, raw: u64) -> bool {
        match self {
            Self::Mode => u8::try_from(raw).is_ok_and(|code| Mode::from_code(code).is_some()),
            Self::IntRange { min, max } => (u64::from(min)..=u64::from(max)).contains(&raw),
            Self::RealRange { min, max } => Binary64(raw)
                .to_fixed()
                .is_ok_and(|number| (Self::real(min, 0)..=Self::real(0, max)).contains(&number)),
        }
    }

    /// An end of a [`Self::RealRange`], from its 2⁻³² and its whole part.
    #[must_use]
    pub fn real(fraction: u32, whole: u32) -> I32F32 {
        I32F32::from_bits(i64::from(whole) << 32 | i64::from(fraction))
    }
}

/// A field of the register map.
#[derive(Clone, Copy, Debug)]
pub struct Field {
    /// Where its first byte is stored; the upper byte is the page.
    pub address: u16,
    /// The unit of its raw value.
    pub unit: Unit,
    /// How it is stored.
    pub kind: Kind,
    /// What it may hold.
    pub accepted: &'static Accepted,
    /// The battery tap it belongs to, from 1: with fewer cells it may hold anything. 0 = none.
    pub tap: u8,
    /// Its position in [`super::FIELDS`].
    pub index: u8,
}

impl Field {
    /// Its name, unique.
    pub fn name(&self) -> &'static str {
        name(self.index)
    }

    /// A raw value with its type, as an error shows it.
    #[must_use]
    #[allow(
        clippy::cast_possible_truncation,
        reason = "a raw value is as wide as the field it was read from"
    )]
    pub const fn value(&self, raw: u64) -> FieldValue {
        match self.kind {
            Kind::Binary64 => FieldValue::Real(Binary64(raw)),
            _ => FieldValue::Int(raw as u32),
        }
    }

    /// Whether a raw value is accepted in a robot of `cells` battery cells.
    // Requirement: WIRE-eeprom-4, WIRE-eeprom-13
    pub fn contains(&self, raw: u64, cells: u8) -> bool {
        self.tap > cells || self.accepted.contains(raw)
    }

    /// The only value it may hold, if there is but one.
    pub const fn constant(&self) -> Option<u32> {
        match *self.accepted {
            Accepted::IntRange { min, max } if min == max => Some(min),
            _ => None,
        }
    }

    /// Its raw value in `bytes`, which begin at `base`; bytes beyond them read 0xFF.
    // Requirement: WIRE-eeprom-8
    pub(super) const fn read(&self, bytes: &[u8], base: u16) -> u64 {
        let start = self.address.wrapping_sub(base) as usize;
        let mut raw = 0;
        let mut at = self.kind.bytes() as usize;
        while at > 0 {
            at -= 1;
            raw = raw << 8 | byte(bytes, start.wrapping_add(at)) as u64;
        }
        (raw & self.kind.mask()) >> self.kind.shift()
    }
}

/// The byte at an index, 0xFF beyond the last.
#[allow(clippy::indexing_slicing, reason = "compared with the length before")]
pub(super) const fn byte(bytes: &[u8], index: usize) -> u8 {
    if index < bytes.len() {
        bytes[index]
    } else {
        0xFF
    }
}

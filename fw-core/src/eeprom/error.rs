//! A rejected configuration: page, address, field, value, and what is accepted.

use super::KEY;
use super::field::{Accepted, Field, Unit};
use super::fields::{LAYOUT_VERSION, name};
use crate::binary64::{Binary64, Binary64Error};
use crate::log::Line;
use crate::wire::Mode;

/// The first field that was rejected.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct ConfigError {
    /// Where its first byte is stored; the upper byte is the page.
    pub address: u16,
    /// See [`Self::field`].
    pub(super) name: u8,
    /// The unit of its value.
    pub unit: Unit,
    /// What it holds.
    pub value: FieldValue,
    /// What is accepted.
    pub expected: Expected,
}

/// What a field holds.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum FieldValue {
    /// The ten bytes of the EEPROM key.
    Key([u8; 10]),
    /// An integer.
    Int(u32),
    /// A binary64.
    Real(Binary64),
    /// A checksum.
    Checksum(u32),
}

/// What a rejected field should hold.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Expected {
    /// The EEPROM key ([`KEY`]).
    Key,
    /// A value of the field's range.
    Range(Accepted),
    /// This checksum.
    Checksum(u32),
    /// What a constraint between fields demands.
    Constraint(&'static str),
}

fn key(line: &mut Line, key: &[u8; 10]) {
    for &byte in key {
        line.hex(byte.into(), 2);
    }
}

fn real(line: &mut Line, value: Binary64) {
    match value.to_fixed() {
        Ok(fixed) => line.fixed(fixed, 6),
        Err(Binary64Error::NotANumber) => line.text("NaN"),
        Err(Binary64Error::Infinite) => line.text("infinity"),
        Err(Binary64Error::OutOfRange) => line
            .text("a binary64 of bits 0x")
            .hex((value.0 >> 32) as u32, 8)
            .hex((value.0 & 0xFFFF_FFFF) as u32, 8),
    };
}

impl FieldValue {
    fn log(&self, line: &mut Line) {
        match self {
            Self::Key(bytes) => key(line, bytes),
            Self::Int(value) => {
                line.int((*value).into());
            }
            Self::Real(value) => real(line, *value),
            Self::Checksum(sum) => {
                line.text("0x").hex(*sum, 8);
            }
        }
    }
}

impl Accepted {
    /// What is accepted, as text.
    pub fn log(&self, line: &mut Line) {
        match *self {
            Self::Mode => {
                let mut between = "";
                for mode in Mode::ALL {
                    line.text(between).text("0x").hex(mode.code().into(), 2);
                    between = ", ";
                }
            }
            Self::IntRange { min, max } if min == max => {
                line.int(min.into());
            }
            Self::IntRange { min, max } => {
                line.int(min.into()).text(" to ").int(max.into());
            }
            Self::RealRange { min, max } => {
                line.fixed(Self::real(min, 0), 1);
                line.text(" to ").fixed(Self::real(0, max), 1);
            }
        }
    }
}

impl Expected {
    fn log(&self, line: &mut Line) {
        match self {
            Self::Key => key(line, &KEY),
            Self::Range(accepted) => accepted.log(line),
            Self::Checksum(sum) => {
                line.text("0x").hex(*sum, 8);
            }
            Self::Constraint(text) => {
                line.text(text);
            }
        }
    }
}

impl ConfigError {
    /// `raw` is not in the field's range.
    pub(super) const fn range(field: &Field, raw: u64) -> Self {
        Self::new(field, raw, Expected::Range(*field.accepted))
    }

    pub(super) const fn new(field: &Field, raw: u64, expected: Expected) -> Self {
        Self {
            address: field.address,
            name: field.index,
            unit: field.unit,
            value: field.value(raw),
            expected,
        }
    }

    /// The field's name.
    pub fn field(&self) -> &'static str {
        name(self.name)
    }

    /// The page, 0x00 ..= 0x03.
    pub const fn page(&self) -> u8 {
        (self.address >> 8) as u8
    }

    /// The error as text: `EEPROM page 0x.. address 0x..: <field> is <value>, accepted: <range>`,
    /// and what to do about another layout.
    pub fn log(&self, line: &mut Line) {
        line.text("EEPROM page 0x")
            .hex(self.page().into(), 2)
            .text(" address 0x")
            .hex((self.address & 0xFF).into(), 2)
            .text(": ")
            .text(self.field())
            .text(" is ");
        self.value.log(line);
        if self.unit != Unit::None {
            line.text(" ").text(self.unit.symbol());
        }
        line.text(", accepted: ");
        self.expected.log(line);
        if self.address == LAYOUT_VERSION.address {
            line.text("; run robot eeprom migrate");
        }
    }
}

impl core::fmt::Display for ConfigError {
    fn fmt(&self, f: &mut core::fmt::Formatter<'_>) -> core::fmt::Result {
        let mut line = Line::new();
        self.log(&mut line);
        f.write_str(line.as_str())
    }
}

impl core::error::Error for ConfigError {}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::eeprom::fields::{FORWARD_P, MODE};
    use std::string::ToString;

    #[test]
    fn error_shows_value_and_what_is_accepted() {
        let huge = ConfigError::range(FORWARD_P, 0x7E37_E43C_0800_759C);
        let sum = ConfigError {
            value: FieldValue::Checksum(0x12AB),
            expected: Expected::Checksum(0x0C0D_E000),
            ..huge
        };
        for (error, expected) in [
            (
                huge,
                "EEPROM page 0x01 address 0x00: forward.p is a binary64 of bits 0x7E37E43C0800759C %/mm, \
                 accepted: 0.0 to 10000.0",
            ),
            (
                sum,
                "EEPROM page 0x01 address 0x00: forward.p is 0x000012AB %/mm, accepted: 0x0C0DE000",
            ),
            (
                ConfigError::range(MODE, 0xF),
                "EEPROM page 0x00 address 0x0C: mode is 15, accepted: 0x00, 0x01, 0x02, 0x10, 0x11, 0x12, \
                 0x20, 0x30",
            ),
        ] {
            assert_eq!(error.to_string(), expected);
        }
    }
}

//! A rejected configuration: page, address, field, value, and what is accepted.

use super::{Accepted, KEY};
use crate::binary64::{Binary64, Binary64Error};
use crate::log::Line;
use crate::wire::Mode;

/// The first field that was rejected.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct ConfigError {
    /// Where its first byte stands; the upper byte is the page.
    pub address: u16,
    /// Its name.
    pub field: &'static str,
    /// Its unit; empty where it has none.
    pub unit: &'static str,
    /// What it holds.
    pub value: Value,
    /// What is accepted.
    pub expected: Accepted,
}

/// What a field holds.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Value {
    /// The ten bytes of the EEPROM key.
    Key([u8; 10]),
    /// An integer.
    Whole(u32),
    /// A double.
    Number(Binary64),
    /// A checksum.
    Checksum(u32),
}

fn key(line: &mut Line, key: &[u8; 10]) {
    for &byte in key {
        line.hex(byte.into(), 2);
    }
}

fn number(line: &mut Line, value: Binary64) {
    match value.to_fixed() {
        Ok(fixed) => {
            line.fixed(fixed, 6);
        }
        Err(Binary64Error::NotANumber) => {
            line.text("NaN");
        }
        Err(Binary64Error::Infinite) => {
            line.text("infinity");
        }
        Err(Binary64Error::OutOfRange) => {
            line.text("a double of bits 0x")
                .hex((value.0 >> 32) as u32, 8)
                .hex((value.0 & 0xFFFF_FFFF) as u32, 8);
        }
    }
}

impl Value {
    fn log(&self, line: &mut Line) {
        match self {
            Self::Key(bytes) => key(line, bytes),
            Self::Whole(value) => {
                line.int((*value).into());
            }
            Self::Number(value) => number(line, *value),
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
            Self::Key => key(line, &KEY),
            Self::Mode => {
                let mut between = "";
                for mode in Mode::ALL {
                    line.text(between).text("0x").hex(mode.code().into(), 2);
                    between = ", ";
                }
            }
            Self::Whole { min, max } if min == max => {
                line.int(min.into());
            }
            Self::Whole { min, max } => {
                line.int(min.into()).text(" to ").int(max.into());
            }
            Self::Number { min, max } => {
                line.fixed(min, 1).text(" to ").fixed(max, 1);
            }
            Self::Checksum(sum) => {
                line.text("0x").hex(sum, 8);
            }
            Self::Rule(text) => {
                line.text(text);
            }
        }
    }
}

impl ConfigError {
    /// The page, 0x00 ..= 0x03.
    #[must_use]
    pub const fn page(&self) -> u8 {
        (self.address >> 8) as u8
    }

    /// The error as text: `EEPROM page 0x.. address 0x..: <field> is <value>, accepted: <range>`.
    pub fn log(&self, line: &mut Line) {
        line.text("EEPROM page 0x")
            .hex(self.page().into(), 2)
            .text(" address 0x")
            .hex((self.address & 0xFF).into(), 2)
            .text(": ")
            .text(self.field)
            .text(" is ");
        self.value.log(line);
        if !self.unit.is_empty() {
            line.text(" ").text(self.unit);
        }
        line.text(", accepted: ");
        self.expected.log(line);
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

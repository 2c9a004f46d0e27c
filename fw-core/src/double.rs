//! IEEE-754 binary64 as the wire and the EEPROM carry it: bits, decoded without a float instruction.

/// A binary64 as its 64 bits; `f64::to_bits` makes one, `f64::from_bits` reads one.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub struct Double(pub u64);

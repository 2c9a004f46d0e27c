//! The EEPROM's bytes: pages 0x00 to 0x03, read and written field by field.

use super::crc32::Crc32;
use super::error::{ConfigError, Expected, FieldValue};
use super::field::{Field, Unit, byte};
use super::fields::{COUNT, CRC_NAME, FIRST_BOARD, KEY_NAME, LAYOUT_LENGTH, LAYOUT_VERSION, TABLE};

/// Bytes of the image: addresses 0x0000 to 0x03FF.
pub const IMAGE_LEN: usize = 0x400;

/// What a configured EEPROM holds at 0x0000 (document, 6.0.1).
// Requirement: DOC-6.0.1-1
pub const KEY: [u8; 10] = [0x15, 0x26, 0x37, 0x48, 0x59, 0x6A, 0x7B, 0x8C, 0x9D, 0xAE];

/// The layout of page 0x03 that this code reads.
pub const LAYOUT: u8 = 2;

/// Where page 0x03 begins.
pub const PLATFORM: u16 = 0x0300;

/// Bytes of page 0x03 that its layout defines, checksum included.
pub const PLATFORM_LEN: usize = 0x52;

/// Where the checksum is stored: behind every byte that it covers.
pub const CRC_ADDRESS: u16 = 0x034E;

/// A range of addresses.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct Span {
    /// The first.
    pub address: u16,
    /// Bytes, at least 1.
    pub len: u16,
}

#[allow(
    clippy::cast_possible_truncation,
    reason = "at most IMAGE_LEN, also in constants"
)]
const fn address(index: usize) -> u16 {
    index as u16
}

const fn low_byte(value: u64) -> u8 {
    value.to_le_bytes()[0]
}

/// The end of the run of defined bytes that begins at `start`, and where the next run begins;
/// [`IMAGE_LEN`] for none.
#[allow(
    clippy::indexing_slicing,
    reason = "the index is compared with the count"
)]
const fn run(start: u16) -> (u16, u16) {
    let mut end = start;
    if start == 0 {
        end = address(KEY.len());
    }
    let mut index = 0;
    while index < COUNT {
        let field = &TABLE[index];
        if field.address >= start {
            if field.address > end {
                return (end, field.address);
            }
            end = field.address + field.kind.bytes();
        }
        index += 1;
    }
    (end + 4, address(IMAGE_LEN))
}

/// Number of [`SPANS`].
const SPAN_COUNT: usize = {
    let (mut count, mut start) = (0, 0);
    while start < address(IMAGE_LEN) {
        start = run(start).1;
        count += 1;
    }
    count
};

/// The defined bytes by address: the EEPROM key, every field, the checksum. Nothing else of an
/// EEPROM is read, and the checksum covers nothing else.
#[allow(clippy::indexing_slicing, reason = "evaluated by the compiler")]
pub const SPANS: [Span; SPAN_COUNT] = {
    let mut spans = [Span { address: 0, len: 0 }; SPAN_COUNT];
    let (mut index, mut start) = (0, 0);
    while index < SPAN_COUNT {
        let (end, next) = run(start);
        spans[index] = Span {
            address: start,
            len: end - start,
        };
        start = next;
        index += 1;
    }
    spans
};

/// The first board's page 0x03.
pub(super) static FIRST_PLATFORM: [u8; PLATFORM_LEN] = match Image::FIRST_BOARD
    .0
    .split_at(PLATFORM as usize)
    .1
    .first_chunk()
{
    Some(page) => *page,
    None => [0; PLATFORM_LEN],
};

/// Pages 0x00 to 0x03 of an EEPROM. Cells that were never written read 0xFF.
#[derive(Clone, Debug, PartialEq, Eq)]
pub struct Image(pub [u8; IMAGE_LEN]);

impl Image {
    /// An EEPROM that was never written.
    pub const BLANK: Self = Self([0xFF; IMAGE_LEN]);

    /// The first board as it ran: what a new EEPROM starts from.
    // Requirement: DOC-2.3-5
    #[allow(clippy::indexing_slicing, reason = "evaluated by the compiler")]
    pub const FIRST_BOARD: Self = {
        let mut image = Self::BLANK;
        let mut index = 0;
        while index < COUNT {
            image.set(&TABLE[index], FIRST_BOARD[index]);
            index += 1;
        }
        image.seal();
        image
    };

    /// The raw value of a field.
    pub const fn get(&self, field: &Field) -> u64 {
        field.read(&self.0, 0)
    }

    /// Stores a raw value; bits beyond the field are dropped. [`Self::seal`] brings the checksum up
    /// to date.
    pub const fn set(&mut self, field: &Field, raw: u64) {
        let mask = field.kind.mask();
        let shift = mask.trailing_zeros();
        let raw = (raw << shift) & mask;
        let mut at = 0;
        while at < field.kind.bytes() {
            let address = field.address.wrapping_add(at);
            let (keep, new) = (!low_byte(mask >> (8 * at)), low_byte(raw >> (8 * at)));
            self.put(address, byte(&self.0, address as usize) & keep | new);
            at += 1;
        }
    }

    /// [`Self::set`] and [`Self::seal`], as an expression.
    #[must_use]
    pub const fn with(mut self, field: &Field, raw: u64) -> Self {
        self.set(field, raw);
        self.seal();
        self
    }

    /// Writes the EEPROM key and, unless page 0x03 is blank, the checksum: after the last change.
    #[allow(
        clippy::indexing_slicing,
        reason = "the index is compared with the length"
    )]
    pub const fn seal(&mut self) {
        let mut at = 0;
        while at < KEY.len() {
            self.put(address(at), KEY[at]);
            at += 1;
        }
        if self.is_original() {
            return;
        }
        let sum = self.checksum();
        let mut at = 0;
        while at < 4 {
            self.put(CRC_ADDRESS + at, low_byte(sum as u64 >> (8 * at)));
            at += 1;
        }
    }

    /// Makes page 0x03 blank, as the original EEPROM has it: the first board's platform applies.
    pub const fn make_original(&mut self) {
        let mut at = 0;
        while at < PLATFORM_LEN {
            self.put(PLATFORM + address(at), 0xFF);
            at += 1;
        }
    }

    /// Whether the defined bytes of page 0x03 are blank: the first board's platform applies.
    // Requirement: WIRE-eeprom-1
    pub const fn is_original(&self) -> bool {
        let mut at = PLATFORM as usize;
        while at < PLATFORM as usize + PLATFORM_LEN {
            if byte(&self.0, at) != 0xFF {
                return false;
            }
            at += 1;
        }
        true
    }

    /// CRC-32 over the defined bytes before the checksum, by address.
    // Requirement: WIRE-eeprom-2
    #[must_use]
    #[allow(
        clippy::indexing_slicing,
        reason = "the index is compared with the count"
    )]
    pub const fn checksum(&self) -> u32 {
        let mut crc = Crc32::new();
        let mut index = 0;
        while index < SPAN_COUNT {
            let Span { address, len } = SPANS[index];
            let mut at = address;
            while at < address + len && at < CRC_ADDRESS {
                crc.update(byte(&self.0, at as usize));
                at += 1;
            }
            index += 1;
        }
        crc.finish()
    }

    /// The checksum that the image holds.
    pub const fn stored_checksum(&self) -> u32 {
        let at = CRC_ADDRESS as usize;
        u32::from_le_bytes([
            byte(&self.0, at),
            byte(&self.0, at + 1),
            byte(&self.0, at + 2),
            byte(&self.0, at + 3),
        ])
    }

    /// Takes every defined byte from another image and leaves the others alone.
    // Requirement: DOC-6.0.1-3, WIRE-eeprom-9
    pub fn copy_defined(&mut self, from: &Self) {
        for span in &SPANS {
            for address in span.address..span.address + span.len {
                self.put(address, byte(&from.0, address.into()));
            }
        }
    }

    /// Checks the EEPROM key and, unless page 0x03 is blank, its layout and the checksum.
    ///
    /// # Errors
    /// The first of these that is wrong.
    // Requirement: WIRE-refused-2
    pub(super) fn verify(&self) -> Result<(), ConfigError> {
        let mut key = [0; KEY.len()];
        for (slot, found) in key.iter_mut().zip(self.0) {
            *slot = found;
        }
        // Byte by byte: comparing whole arrays would link a routine of its own.
        if !key
            .iter()
            .zip(&KEY)
            .all(|(found, expected)| found == expected)
        {
            return Err(ConfigError {
                address: 0,
                name: KEY_NAME,
                unit: Unit::None,
                value: FieldValue::Key(key),
                expected: Expected::Key,
            });
        }
        if self.is_original() {
            return Ok(());
        }
        for field in [LAYOUT_VERSION, LAYOUT_LENGTH] {
            let raw = self.get(field);
            if !field.accepted.contains(raw) {
                return Err(ConfigError::range(field, raw));
            }
        }
        let (found, computed) = (self.stored_checksum(), self.checksum());
        if found != computed {
            return Err(ConfigError {
                address: CRC_ADDRESS,
                name: CRC_NAME,
                unit: Unit::None,
                value: FieldValue::Checksum(found),
                expected: Expected::Checksum(computed),
            });
        }
        Ok(())
    }

    #[allow(clippy::indexing_slicing, reason = "compared with the length before")]
    const fn put(&mut self, address: u16, value: u8) {
        if (address as usize) < IMAGE_LEN {
            self.0[address as usize] = value;
        }
    }
}

// Set-then-get is the identity for every field, and no two fields share a bit.
#[allow(clippy::indexing_slicing, reason = "evaluated by the compiler")]
const _: () = {
    let mut image = Image([0; IMAGE_LEN]);
    let mut index = 0;
    while index < COUNT {
        let field = &TABLE[index];
        assert!(image.get(field) == 0, "overlaps a field before it");
        image.set(field, field.kind.max());
        assert!(image.get(field) == field.kind.max());
        index += 1;
    }
};

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn spans_are_what_the_running_core_computes() {
        let mut start = 0;
        for span in SPANS {
            let (end, next) = run(start);
            assert_eq!((span.address, span.len), (start, end - start));
            start = next;
        }
        assert_eq!(start, address(IMAGE_LEN));
    }
}

//! The chip: AT24C512 or AT24CS64, two address bytes, write bursts of at most 32 bytes inside a
//! 32-byte boundary, a write cycle of up to 5 ms that is over when the part acknowledges again
//! (AT24C512C and AT24CS64 data sheets, "acknowledge polling").

use super::image::differences;
use crate::board_io::{BoardIo, IoError};
use crate::error::Error;
use fw_core::eeprom::Image;
use std::ops::Range;

/// 7-bit I2C address.
// Requirement: WIRE-eeprom-7
pub const ADDRESS: u8 = 0x50;

/// The longest burst, bytes, and the boundary it must not cross.
pub const BURST: usize = 32;

/// How long a write cycle may take before the part counts as broken, microseconds (data sheets: 5 ms).
pub const CYCLE_TIMEOUT_US: u32 = 20_000;

/// Between two polls, microseconds.
const POLL_US: u32 = 250;

/// Bytes per read transaction.
const READ: usize = 256;

/// How often a transaction is tried.
const ATTEMPTS: usize = 3;

/// The bursts that turn `before` into `after`: every stretch of differing bytes, cut at the 32-byte
/// boundaries.
// Requirement: WIRE-eeprom-5
pub fn bursts(before: &Image, after: &Image) -> Vec<Range<usize>> {
    let mut bursts = Vec::new();
    for stretch in differences(before, after) {
        let mut from = stretch.start;
        while from < stretch.end {
            let to = stretch.end.min((from / BURST + 1) * BURST);
            bursts.push(from..to);
            from = to;
        }
    }
    bursts
}

/// Compares what was written from the address `from` on with what was read back.
///
/// # Errors
/// [`Error::Verify`] with the first byte that is not what was written.
// Requirement: DOC-6-7
pub fn verify(from: u16, written: &[u8], read: &[u8]) -> Result<(), Error> {
    let mut bytes = (from..).zip(written).zip(read);
    match bytes.find(|((_, written), read)| written != read) {
        None => Ok(()),
        Some(((address, &written), &read)) => Err(Error::Verify {
            address,
            written,
            read,
        }),
    }
}

/// Whether an EEPROM acknowledges its address to the Pi.
pub fn answers(io: &mut BoardIo) -> bool {
    (io.i2c)(ADDRESS, &[0, 0], &mut []).is_ok()
}

/// Reads `out.len()` bytes from `address` on.
// Requirement: DOC-6-8
pub(super) fn read(io: &mut BoardIo, address: u16, out: &mut [u8]) -> Result<(), Error> {
    for (from, chunk) in (address..).step_by(READ).zip(out.chunks_mut(READ)) {
        io.interrupt.check()?;
        retry(io, "reading", from, &from.to_be_bytes(), chunk)?;
    }
    Ok(())
}

/// Writes one burst, waits for the end of its write cycle and reads it back.
pub(super) fn write_burst(io: &mut BoardIo, address: usize, data: &[u8]) -> Result<(), Error> {
    assert!(address % BURST + data.len() <= BURST);
    let address = u16::try_from(address).unwrap_or(u16::MAX);
    io.interrupt.check()?;
    let message = [&address.to_be_bytes(), data].concat();
    // Writing the same bytes twice does no harm, so a disturbed transaction may be repeated.
    retry(io, "writing", address, &message, &mut [])?;
    await_cycle(io, address)?;
    let mut back = [0; BURST];
    let back = back.get_mut(..data.len()).unwrap_or_default();
    read(io, address, back)?;
    verify(address, data, back)
}

/// Polls until the part acknowledges its address again. Setting the address pointer starts no write.
fn await_cycle(io: &mut BoardIo, address: u16) -> Result<(), Error> {
    let mut waited = 0;
    loop {
        match (io.i2c)(ADDRESS, &address.to_be_bytes(), &mut []) {
            Ok(()) => return Ok(()),
            Err(cause) if waited >= CYCLE_TIMEOUT_US => {
                return Err(failure("waiting for a write cycle's end", address, &cause));
            }
            Err(_) => (io.delay)(POLL_US),
        }
        waited += POLL_US;
    }
}

/// Tries a transaction up to three times, a write cycle's time apart: the chip may be busy with a
/// cycle that an earlier process began.
fn retry(
    io: &mut BoardIo,
    doing: &'static str,
    address: u16,
    write: &[u8],
    read: &mut [u8],
) -> Result<(), Error> {
    let mut outcome = (io.i2c)(ADDRESS, write, read);
    for _ in 1..ATTEMPTS {
        if outcome.is_err() {
            (io.delay)(5_000);
            outcome = (io.i2c)(ADDRESS, write, read);
        }
    }
    outcome.map_err(|cause| failure(doing, address, &cause))
}

fn failure(doing: &'static str, address: u16, cause: &IoError) -> Error {
    Error::Eeprom {
        doing,
        address,
        cause: cause.to_string(),
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    // Requirement: WIRE-eeprom-5
    #[test]
    fn bursts_cover_differences_within_boundaries() {
        let before = Image::BLANK;
        let mut after = before.clone();
        for at in [0, 31, 32, 95, 96, 97, 0x3FF] {
            after.0[at] = 1;
        }
        let bursts = bursts(&before, &after);
        let expected = [0..1, 31..32, 32..33, 95..96, 96..98, 0x3FF..0x400];
        assert_eq!(bursts, expected);
        assert!(super::bursts(&before, &before).is_empty());
    }
}

//! The configuration EEPROM: taking its bus from the STM, reading, writing, and returning it.

mod bus;
pub mod chip;
pub mod image;
pub mod journal;
pub mod repair;

use crate::board_io::BoardIo;
use crate::error::Error;
use bus::BusAccess;
use fw_core::eeprom::Image;
use journal::Journal;

/// Reads pages 0x00 to 0x03.
///
/// # Errors
/// [`Error::Eeprom`], [`Error::Pin`], [`Error::Interrupted`], [`Error::NotRestored`].
pub fn read(io: &mut BoardIo) -> Result<Image, Error> {
    bus::with(io, BusAccess::Read, |io| {
        let mut image = Image::BLANK;
        chip::read(io, 0, &mut image.0)?;
        Ok(image)
    })
    .map(|(image, _)| image)
}

/// What [`program`] did.
#[derive(Clone, Debug, PartialEq)]
pub struct Programmed {
    /// What the EEPROM held before.
    pub before: Image,
    /// Bytes that differed and were written.
    pub bytes: usize,
    /// Bursts it took.
    pub bursts: usize,
    /// Milliseconds from the reset's end to `STM_READY`.
    pub ready_ms: u32,
}

/// The progress of [`program`].
#[derive(Clone, Copy, Debug, PartialEq)]
pub enum Progress<'a> {
    /// What the EEPROM holds before anything changes.
    Before(&'a Image),
    /// A burst is written and read back.
    Written {
        /// Bytes written so far.
        done: usize,
        /// Bytes to write.
        of: usize,
    },
}

/// Writes what differs of pages 0x00 to 0x03, reads all of it back, restores protection and bus,
/// resets the STM and awaits `STM_READY`.
///
/// `watch` gets the EEPROM's content before anything changes, and the progress of the write.
///
/// # Errors
/// [`Error::Eeprom`], [`Error::Verify`], [`Error::Pin`], [`Error::Interrupted`], [`Error::NotReady`],
/// [`Error::NotRestored`], [`Error::Unwritable`] for the journal. Protection, bus and reset are
/// restored before any of them is returned.
// Requirement: DOC-2.1-1
pub fn program(
    io: &mut BoardIo,
    image: &Image,
    ready_timeout_ms: u32,
    journal: Option<&Journal>,
    mut watch: impl FnMut(Progress<'_>),
) -> Result<Programmed, Error> {
    let access = BusAccess::Write { ready_timeout_ms };
    let outcome = bus::with(io, access, |io| {
        let mut before = Image::BLANK;
        chip::read(io, 0, &mut before.0)?;
        watch(Progress::Before(&before));
        let bursts = chip::bursts(&before, image);
        let bytes = bursts.iter().map(ExactSizeIterator::len).sum();
        if !bursts.is_empty() {
            if let Some(journal) = journal {
                journal.begin(&before)?;
            }
            io.set_protect(false)?;
            let mut done = 0;
            for burst in &bursts {
                chip::write_burst(io, burst.start, image.0.get(burst.clone()).unwrap_or(&[]))?;
                done += burst.len();
                watch(Progress::Written { done, of: bytes });
            }
        }
        let mut after = Image::BLANK;
        chip::read(io, 0, &mut after.0)?;
        chip::verify(0, &image.0, &after.0)?;
        if let Some(journal) = journal {
            journal.written()?;
        }
        Ok((before, bytes, bursts.len()))
    });
    if let (Ok(_) | Err(Error::NotReady { .. }), Some(journal)) = (&outcome, journal) {
        // Written, and the STM has been reset.
        journal.end()?;
    }
    let ((before, bytes, bursts), ready_ms) = outcome?;
    Ok(Programmed {
        before,
        bytes,
        bursts,
        ready_ms: ready_ms.unwrap_or_default(),
    })
}

#[cfg(test)]
mod tests;

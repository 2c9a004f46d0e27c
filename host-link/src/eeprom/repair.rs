//! Repair of what a killed run left, at the next start: idle lines, an incomplete write undone, an STM
//! that lost its EEPROM while booting reset.

use super::journal::Journal;
use super::{image, program};
use crate::board_io::BoardIo;
use crate::error::Error;
use crate::file;
use crate::reset;

/// What was repaired besides the lines.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Repaired {
    /// Nothing was to be repaired.
    Nothing,
    /// The STM was reset.
    Reset {
        /// A write had been completed just before; otherwise the STM was not ready.
        due: bool,
    },
    /// An incomplete write: the content before it is written back, and the STM reset.
    RolledBack {
        /// Bytes that had been changed already.
        bytes: usize,
    },
}

/// Sets the lines idle. If `journal` shows an incomplete write, writes the content before it back. If the journal
/// shows that a reset was due, or the last run was `killed` and the STM is not ready, resets it: it may have been
/// reading its configuration when the bus was taken.
///
/// # Errors
/// [`Error::Pin`]; with a journal, those of [`file::ensure_trusted`], [`image::load`] and [`program`], but for
/// [`Error::NotReady`]: the restored content need not be acceptable.
pub fn repair(
    io: &mut BoardIo,
    journal: &Journal,
    killed: bool,
    ready_timeout_ms: u32,
) -> Result<Repaired, Error> {
    io.set_idle()?;
    if journal.unfinished() {
        file::ensure_trusted(journal.path())?;
        let before = image::load(journal.path())?;
        let mut bytes = 0;
        let outcome = program(io, &before, ready_timeout_ms, Some(journal), |step| {
            if let super::Progress::Written { of, .. } = step {
                bytes = of;
            }
        });
        return match outcome {
            Ok(_) | Err(Error::NotReady { .. }) => Ok(Repaired::RolledBack { bytes }),
            Err(error) => Err(error),
        };
    }
    let due = journal.reset_due();
    if due || killed && !io.is_ready().unwrap_or(false) {
        reset::pulse(io)?;
        journal.end()?;
        return Ok(Repaired::Reset { due });
    }
    Ok(Repaired::Nothing)
}

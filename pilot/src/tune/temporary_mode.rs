//! The EEPROM's mode changed for a measurement, and restored on every path: success, error, Ctrl-C
//! and panic. If the process is killed, the next one finds an unfinished write in the journal, and undoes it.

use fw_core::eeprom::fields::MODE;
use fw_core::eeprom::{Config, Image};
use fw_core::wire::Mode;
use host_link::board_io::{BoardIo, Interrupt};
use host_link::eeprom::{self, journal::Journal};
use host_link::error::Error;
use host_link::settings::Settings;

/// An image's settings with another mode.
///
/// # Errors
/// [`Error::Rejected`] for an image that is not accepted, or that cannot run the mode.
pub fn set_mode(image: &Image, mode: Mode) -> Result<Settings, Error> {
    Settings::from_image(image)?.with(&[(MODE, mode.code().into())])
}

/// An STM whose mode may be changed. Writes `original` back and resets the STM when dropped.
pub struct ModeGuard<'m> {
    io: &'m mut BoardIo,
    original: &'m Image,
    journal: Option<&'m Journal>,
    ready_timeout_ms: u32,
    restored: bool,
}

/// Runs `work`, which enters modes, and brings the EEPROM back to `original`. Ctrl-C cuts `work` short,
/// not the restoring. `journal`, the one of EEPROM writes, keeps the original on disk meanwhile.
///
/// # Errors
/// Those of `work` and of the journal; [`Error::NotRestored`] if restoring fails (it carries the error of
/// `work`, if any).
pub fn with_modes<T>(
    io: &mut BoardIo,
    original: &Image,
    journal: Option<&Journal>,
    ready_timeout_ms: u32,
    work: impl FnOnce(&mut ModeGuard<'_>) -> Result<T, Error>,
) -> Result<T, Error> {
    if let Some(journal) = journal {
        journal.begin(original)?;
    }
    let mut guard = ModeGuard {
        io,
        original,
        journal,
        ready_timeout_ms,
        restored: false,
    };
    let outcome = work(&mut guard);
    match (outcome, guard.restore()) {
        (outcome, Ok(())) => outcome,
        (outcome, Err(error)) => Err(Error::NotRestored {
            step: "restoring the EEPROM's mode (the next command tries again)",
            cause: error.to_string(),
            first: outcome.err().map(Box::new),
        }),
    }
}

impl ModeGuard<'_> {
    /// Puts the STM into a mode.
    ///
    /// # Errors
    /// Those of [`set_mode`] and [`eeprom::program`].
    pub fn enter(&mut self, mode: Mode) -> Result<(&mut BoardIo, Config), Error> {
        let (settings, timeout) = (set_mode(self.original, mode)?, self.ready_timeout_ms);
        eeprom::program(self.io, settings.image(), timeout, None, |_| {})?;
        Ok((self.io, settings.config().clone()))
    }

    fn restore(&mut self) -> Result<(), Error> {
        // A Ctrl-C that ended the work must not end this too.
        let interrupt = std::mem::replace(&mut self.io.interrupt, Interrupt::new());
        let timeout = self.ready_timeout_ms;
        let mut write = || eeprom::program(self.io, self.original, timeout, None, |_| {});
        let outcome = write().or_else(|_| write());
        self.io.interrupt = interrupt;
        self.restored = true;
        outcome?;
        self.journal.map_or(Ok(()), Journal::end)
    }
}

impl Drop for ModeGuard<'_> {
    fn drop(&mut self) {
        if !self.restored {
            // Only on the way out of a panic, which is what will be reported.
            let _ = self.restore();
        }
    }
}

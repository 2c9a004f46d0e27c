//! What stood in the EEPROM before a write, kept on disk while the write runs: if the process is
//! killed half-way, the next one finds it and brings the old content back.

use super::image;
use crate::error::Error;
use fw_core::eeprom::Image;
use std::fs;
use std::io::ErrorKind;
use std::path::{Path, PathBuf};

/// The journal's place.
#[derive(Clone, Debug, PartialEq, Eq)]
pub struct Journal(PathBuf);

impl Journal {
    /// A journal kept in the file `path`, which exists only while a write runs.
    #[must_use]
    pub fn new(path: impl Into<PathBuf>) -> Self {
        Self(path.into())
    }

    /// The file.
    #[must_use]
    pub fn path(&self) -> &Path {
        &self.0
    }

    /// Notes `before`. An older note stays: it is the last content that was whole.
    ///
    /// # Errors
    /// [`Error::Unwritable`].
    pub fn begin(&self, before: &Image) -> Result<(), Error> {
        if self.0.exists() {
            return Ok(());
        }
        image::save(&self.0, before)
    }

    /// The write is complete and read back: what stood there before is no longer wanted, but the STM
    /// has yet to be reset.
    ///
    /// # Errors
    /// [`Error::Unwritable`].
    pub fn written(&self) -> Result<(), Error> {
        if !self.0.exists() {
            return Ok(());
        }
        fs::rename(&self.0, self.reset_note()).map_err(|cause| Error::unwritable(&self.0, &cause))
    }

    /// Forgets everything: the STM has been reset after a complete write.
    ///
    /// # Errors
    /// [`Error::Unwritable`].
    pub fn end(&self) -> Result<(), Error> {
        for path in [&self.0, &self.reset_note()] {
            match fs::remove_file(path) {
                Err(cause) if cause.kind() != ErrorKind::NotFound => {
                    return Err(Error::unwritable(path, &cause));
                }
                _ => {}
            }
        }
        Ok(())
    }

    fn reset_note(&self) -> PathBuf {
        image::with_suffix(&self.0, ".written")
    }

    /// Whether a write was complete, but the STM perhaps not reset after it.
    #[must_use]
    pub fn reset_due(&self) -> bool {
        self.reset_note().exists()
    }

    /// Whether a write was cut short since the last one that ended.
    #[must_use]
    pub fn unfinished(&self) -> bool {
        self.0.exists()
    }
}

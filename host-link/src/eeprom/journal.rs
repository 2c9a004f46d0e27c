//! What stood in the EEPROM before a write, kept on disk while the write runs: if the process is
//! killed half-way, the next one finds it, repairs the lines and can bring the old content back.

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

    /// Forgets the note: the write is complete and read back.
    ///
    /// # Errors
    /// [`Error::Unwritable`].
    pub fn end(&self) -> Result<(), Error> {
        match fs::remove_file(&self.0) {
            Err(cause) if cause.kind() != ErrorKind::NotFound => {
                Err(Error::unwritable(&self.0, &cause))
            }
            _ => Ok(()),
        }
    }

    /// Whether a write was cut short since the last one that ended.
    #[must_use]
    pub fn unfinished(&self) -> bool {
        self.0.exists()
    }
}

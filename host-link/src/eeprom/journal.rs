//! The EEPROM's content before a write, kept on disk during the write: if the process is killed, the
//! next one restores it.

use crate::error::Error;
use crate::file::{self, Kind};
use fw_core::eeprom::Image;
use std::fs::{self, Permissions};
use std::io::ErrorKind;
use std::os::unix::fs::PermissionsExt;
use std::path::{Path, PathBuf};

/// A journal file.
#[derive(Clone, Debug, PartialEq, Eq)]
pub struct Journal(PathBuf);

impl Journal {
    /// A journal kept in the file `path`, which exists only while a write runs.
    pub fn new(path: impl Into<PathBuf>) -> Self {
        Self(path.into())
    }

    /// The file.
    pub fn path(&self) -> &Path {
        &self.0
    }

    /// Saves `before`. An older journal stays: it is the last complete content.
    ///
    /// # Errors
    /// [`Error::Unwritable`].
    pub fn begin(&self, before: &Image) -> Result<(), Error> {
        if self.0.exists() {
            return Ok(());
        }
        file::save(&self.0, Kind::Image, &before.0)?;
        // The next user of the robot may have to undo the write. Not every file system has permissions.
        let _ = fs::set_permissions(&self.0, Permissions::from_mode(0o660));
        Ok(())
    }

    /// The write is complete and read back, but the STM is not yet reset.
    ///
    /// # Errors
    /// [`Error::Unwritable`].
    pub fn written(&self) -> Result<(), Error> {
        if !self.0.exists() {
            return Ok(());
        }
        fs::rename(&self.0, self.reset_marker())
            .and_then(|()| file::sync_folder(&self.0))
            .map_err(|cause| Error::unwritable(&self.0, &cause))
    }

    /// Removes the journal: the STM has been reset after a complete write.
    ///
    /// # Errors
    /// [`Error::Unwritable`].
    pub fn end(&self) -> Result<(), Error> {
        for path in [&self.0, &self.reset_marker()] {
            match fs::remove_file(path) {
                Err(cause) if cause.kind() != ErrorKind::NotFound => {
                    return Err(Error::unwritable(path, &cause));
                }
                _ => {}
            }
        }
        Ok(())
    }

    fn reset_marker(&self) -> PathBuf {
        file::with_suffix(&self.0, ".written")
    }

    /// Whether a write was complete but possibly not followed by a reset.
    pub fn reset_due(&self) -> bool {
        self.reset_marker().exists()
    }

    /// Whether the latest write did not end.
    pub fn unfinished(&self) -> bool {
        self.0.exists()
    }
}

//! What can go wrong, as one sentence with what to do next, and the exit code it ends in.

use std::fmt;

/// Why a command did not do what was asked. The variant decides the exit code, see `docs/gates.md`.
#[derive(Debug)]
pub enum Error {
    /// Something that was run, checked or measured failed: exit code 1.
    Failed(String),
    /// The command line is not one of ours: exit code 2.
    Usage(String),
    /// The firmware's target cannot be built for on this machine: exit code 3.
    SetUp(String),
    /// A program that this command needs is not installed: exit code 4.
    Missing(String),
    /// The board, real or virtual, did not answer or holds something else than it was given:
    /// exit code 5.
    Board(String),
}

/// The result of everything here.
pub type Result<T> = std::result::Result<T, Error>;

impl Error {
    /// The process's exit code.
    pub fn code(&self) -> u8 {
        match self {
            Self::Failed(_) => 1,
            Self::Usage(_) => 2,
            Self::SetUp(_) => 3,
            Self::Missing(_) => 4,
            Self::Board(_) => 5,
        }
    }
}

impl fmt::Display for Error {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        match self {
            Self::Failed(text)
            | Self::Usage(text)
            | Self::SetUp(text)
            | Self::Missing(text)
            | Self::Board(text) => f.write_str(text),
        }
    }
}

/// Shorthand for [`Error::Failed`].
pub fn failed<T>(text: impl Into<String>) -> Result<T> {
    Err(Error::Failed(text.into()))
}

/// Gives an I/O error the file or program it happened to.
pub trait Of<T> {
    /// Turns an I/O error into [`Error::Failed`] that names `what`.
    fn of(self, what: impl fmt::Display) -> Result<T>;
}

impl<T> Of<T> for std::io::Result<T> {
    fn of(self, what: impl fmt::Display) -> Result<T> {
        self.map_err(|error| Error::Failed(format!("{what}: {error}")))
    }
}

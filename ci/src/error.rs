//! Failures with an exit code of their own; every other error ends with 1.

pub use anyhow::{Context, Error, Result, bail, ensure};

/// Why a command fails; the number is the exit code, see `cargo xtask --help`.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Kind {
    /// The gate cannot be decided here; it never counts as passed.
    Skipped = 1,
    Usage = 2,
    /// No toolchain on this machine builds for the robot's processor.
    NoToolchain = 3,
    /// A program that the command needs is not installed.
    MissingProgram = 4,
    /// The board, real or virtual, does not answer or holds something else than it was given.
    Board = 5,
}

#[derive(Debug, thiserror::Error)]
#[error("{1}")]
pub struct Failure(pub Kind, pub String);

pub fn fail<T>(kind: Kind, text: impl Into<String>) -> Result<T> {
    Err(Failure(kind, text.into()).into())
}

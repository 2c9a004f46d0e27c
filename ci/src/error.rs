//! Failures with an exit code of their own; every other error ends with 1.

use std::fmt;

pub use anyhow::{Context, Error, Result, bail, ensure};

/// Decides the exit code, see `cargo xtask --help`.
#[derive(Debug)]
pub enum Failure {
    /// The command line is wrong: 2.
    Usage(String),
    /// No toolchain on this machine builds for the robot's processor: 3.
    NoToolchain(String),
    /// A program that the command needs is not installed: 4.
    MissingProgram(String),
    /// The gate cannot be decided here, and why; it never counts as passed.
    Skipped(String),
    /// The board, real or virtual, does not answer or holds something else than it was given: 5.
    Board(String),
}

impl fmt::Display for Failure {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        let (Self::Usage(text)
        | Self::NoToolchain(text)
        | Self::MissingProgram(text)
        | Self::Skipped(text)
        | Self::Board(text)) = self;
        f.write_str(text)
    }
}

impl std::error::Error for Failure {}

/// The process's exit code for an error.
pub fn exit_code(error: &Error) -> u8 {
    match error.downcast_ref() {
        None | Some(Failure::Skipped(_)) => 1,
        Some(Failure::Usage(_)) => 2,
        Some(Failure::NoToolchain(_)) => 3,
        Some(Failure::MissingProgram(_)) => 4,
        Some(Failure::Board(_)) => 5,
    }
}

//! The stack bound of this robot's firmware.

use stack_bound::{bound, Options, Report};

use crate::error::{Error, Result};

/// Computes the bound of an ELF for the STM32F411: 4 priority bits, RAM from `0x2000_0000`.
///
/// # Errors
/// Names what has no bound, or why an overflow would not fault.
pub fn worst_case(elf: &[u8]) -> Result<Report> {
    let options = Options {
        priority_bits: 4,
        ram_start: Some(0x2000_0000),
        ..Options::default()
    };
    bound(elf, &options).map_err(|error| Error::Failed(error.to_string()))
}

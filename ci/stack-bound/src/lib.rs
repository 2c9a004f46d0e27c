//! The worst-case stack use of a Cortex-M program, computed from its machine code.
//!
//! Every handler in the vector table is followed instruction by instruction, callees included;
//! the worst handler of each priority counts once, with its exception frame. What has no bound
//! (recursion, an indirect call to an unknown address, a frame of variable size) is an error.
//!
//! ```
//! use stack_bound::{Options, Program, Report};
//!
//! let mut program = Program::new(0x2000_0000..0x2000_1000, &[0x101]);
//! // push {r4, lr}; sub sp, #24; bl helper; add sp, #24; pop {r4, pc}
//! program.add_code(0x100, "main", &[0xB510, 0xB086, 0xF000, 0xF802, 0xB006, 0xBD10])?;
//! // push {r4, lr}; pop {r4, pc}
//! program.add_code(0x10C, "helper", &[0xB510, 0xBD10])?;
//! let report = Report::of(&program, &Options::default())?;
//! assert_eq!(report.worst(), 8 + 24 + 8);
//! assert_eq!(report.levels[0].chain[1], ("helper".to_owned(), 8));
//! # Ok::<(), stack_bound::Error>(())
//! ```
//!
//! For an ELF, see [`bound`].
#![forbid(unsafe_code)]

mod analysis;
mod decode;
mod jump_table;
mod program;
mod report;
mod state;
#[cfg(test)]
mod tests;

use clap::Args;

pub use program::Program;
pub use report::{Level, Report};

/// What the ELF does not say itself.
#[derive(Args, Clone, Debug, Default)]
pub struct Options {
    /// Where the RAM begins and the stack must end, so that an overflow faults
    #[arg(long, value_name = "ADDRESS", value_parser = parse_number)]
    pub ram_start: Option<u32>,
    /// How many priority bits the chip implements: 1 to 8, by default 8, which only raises the bound
    #[arg(long, value_parser = clap::value_parser!(u32).range(1..=8))]
    pub priority_bits: Option<u32>,
    /// A routine of thread mode that runs with every interrupt masked: only NMI and `HardFault`
    /// preempt it; that it does is not checked
    #[arg(long, value_name = "ROUTINE")]
    pub masked: Option<String>,
}

fn parse_number(text: &str) -> Result<u32, std::num::ParseIntError> {
    match text.strip_prefix("0x") {
        Some(hex) => u32::from_str_radix(hex, 16),
        None => text.parse(),
    }
}

/// Why there is no bound.
#[derive(Clone, Debug, PartialEq, Eq, thiserror::Error)]
pub enum Error {
    /// The file is no ELF for a Cortex-M, or lacks symbols; which.
    #[error("unsuitable ELF: {0}")]
    Elf(String),
    /// Capstone cannot be set up.
    #[error("disassembler: {0}")]
    Disassembler(String),
    /// A routine cannot be followed.
    #[error("{routine}: at {at:#010x}: {why}")]
    Unbounded {
        /// The routine's name.
        routine: String,
        /// The address of the instruction.
        at: u32,
        /// Why, and the function it lies in.
        why: String,
    },
    /// A cycle of calls, by name; the first is also the last.
    #[error("recursion: {}", .0.join(" -> "))]
    Recursion(Vec<String>),
    /// A stack overflow would not fault, and why.
    #[error("stack guard: {0}")]
    Guard(String),
}

/// Computes the stack bound of an ELF.
///
/// ```no_run
/// let elf = std::fs::read("firmware.elf")?;
/// let report = stack_bound::bound(&elf, &stack_bound::Options::default())?;
/// println!("{report}");
/// # Ok::<(), Box<dyn std::error::Error>>(())
/// ```
///
/// # Errors
/// Where the ELF is unsuitable, or names what has no bound.
pub fn bound(elf: &[u8], options: &Options) -> Result<Report, Error> {
    Report::of(&Program::from_elf(elf)?, options)
}

//! The worst-case stack use of a Cortex-M program, computed from its machine code.
//!
//! Every handler in the vector table is followed instruction by instruction, callees included;
//! the worst handler of each priority counts once, with its exception frame. What has no bound
//! (recursion, an indirect call to an unknown address, a frame of variable size) is an error.
//!
//! ```
//! use stack_bound::{Options, Program};
//!
//! let mut program = Program::new(0x2000_0000..0x2000_1000, &[0x101]);
//! // push {r4, lr}; sub sp, #24; bl helper; add sp, #24; pop {r4, pc}
//! program.add_code(0x100, "main", &[0xB510, 0xB086, 0xF000, 0xF802, 0xB006, 0xBD10])?;
//! // push {r4, lr}; pop {r4, pc}
//! program.add_code(0x10C, "helper", &[0xB510, 0xBD10])?;
//! let report = program.bound(&Options::default())?;
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

use std::fmt;
use std::ops::Range;

use clap::Args;

pub use program::Program;
pub use report::{Level, Report};

/// What the ELF does not say itself.
#[derive(Args, Clone, Debug, Default)]
pub struct Options {
    /// The addresses reserved for the stack; by default cortex-m-rt's symbols `_stack_end` and
    /// `_stack_start`
    #[arg(long, value_name = "LOW..TOP", value_parser = parse_range)]
    pub stack: Option<Range<u32>>,
    /// Where the RAM begins and the stack must end, so that an overflow faults
    #[arg(long, value_name = "ADDRESS", value_parser = parse_number)]
    pub ram_start: Option<u32>,
    /// The vector table; by default a symbol's address
    #[arg(long, value_name = "ADDRESS", value_parser = parse_number)]
    pub vectors: Option<u32>,
    /// How many priority bits the chip implements: 1 to 8, by default 8, which only raises the bound
    #[arg(long, value_parser = clap::value_parser!(u32).range(1..=8))]
    pub priority_bits: Option<u32>,
    /// An indirect call whose target cannot be derived: the caller's path, all possible callees'
    #[arg(long = "call", value_name = "CALLER=CALLEE,CALLEE", value_parser = parse_call)]
    pub calls: Vec<(String, Vec<String>)>,
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

fn parse_range(text: &str) -> Result<Range<u32>, &'static str> {
    let ends = text.split_once("..");
    let ends = ends.and_then(|(low, top)| parse_number(low).ok().zip(parse_number(top).ok()));
    ends.map(|(low, top)| low..top).ok_or("not LOW..TOP")
}

fn parse_call(text: &str) -> Result<(String, Vec<String>), &'static str> {
    let (caller, callees) = text.split_once('=').ok_or("not CALLER=CALLEE")?;
    let callees = callees.split(',').map(str::to_owned);
    Ok((caller.to_owned(), callees.collect()))
}

/// Why there is no bound.
#[derive(Clone, Debug, PartialEq, Eq)]
pub enum Error {
    /// The file is no ELF for a Cortex-M, or lacks symbols; which.
    Elf(String),
    /// Capstone cannot be set up.
    Disassembler(String),
    /// A routine cannot be followed.
    Unbounded {
        /// The routine's name.
        routine: String,
        /// The address of the instruction.
        at: u32,
        /// Why, and the function it lies in.
        why: String,
    },
    /// A cycle of calls, by name; the first is also the last.
    Recursion(Vec<String>),
    /// A stack overflow would not fault, and why.
    Guard(String),
}

impl fmt::Display for Error {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        match self {
            Self::Elf(why) => write!(f, "unsuitable ELF: {why}"),
            Self::Disassembler(why) => write!(f, "disassembler: {why}"),
            Self::Unbounded { routine, at, why } => write!(f, "{routine}: at {at:#010x}: {why}"),
            Self::Recursion(names) => write!(f, "recursion: {}", names.join(" -> ")),
            Self::Guard(why) => write!(f, "stack guard: {why}"),
        }
    }
}

impl std::error::Error for Error {}

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
    Program::from_elf(elf, options)?.bound(options)
}

impl Program {
    /// Computes the stack bound.
    ///
    /// # Errors
    /// Names what has no bound, or why an overflow would not fault.
    pub fn bound(&self, options: &Options) -> Result<Report, Error> {
        Report::of(self, options)
    }
}

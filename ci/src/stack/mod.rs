//! The worst the stack can come to, computed from the release ELF's machine code: every routine is
//! followed instruction by instruction, and what cannot be followed fails.
//!
//! | module | what |
//! |---|---|
//! | [`program`] | the ELF as the processor finds it |
//! | [`thumb`], [`wide`] | what an instruction does |
//! | [`state`] | what is known before one |
//! | [`routine`] | a routine's own depth, and whom it calls |
//! | [`levels`] | who interrupts whom, and the sum |

mod levels;
mod program;
mod routine;
mod state;
#[cfg(test)]
mod tests;
mod thumb;
mod wide;

pub use levels::Report;

use crate::error::Result;

/// The worst case of the firmware in these bytes.
///
/// # Errors
/// Names what cannot be bounded, or what would let an overflow pass unnoticed.
pub fn worst_case(elf: &[u8]) -> Result<Report> {
    Report::of(&program::Program::of(elf)?)
}

/// Prints the levels with their deepest chains of calls.
pub fn print(report: &Report) {
    for level in &report.levels {
        println!(
            "  {:<18} {:>5} bytes, {} of them the processor's",
            level.name,
            level.bytes(),
            level.frame
        );
        for (name, own) in &level.chain {
            println!("    {own:>6}  {name}");
        }
    }
    println!(
        "  worst case {} of {} bytes ({} if every handler could interrupt every other), {} routines{}",
        report.worst(),
        report.reserved,
        report.nested,
        report.routines,
        if report.float {
            ", floating-point frames"
        } else {
            ""
        },
    );
}

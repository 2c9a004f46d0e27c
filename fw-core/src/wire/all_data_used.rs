//! All data used: takes nothing and fails if anything is left (document, 5.1.5). Last in every
//! chain.

use super::error::Reason;
use super::strategy::{Context, Duties, Fault, Input, Output};
use super::{Command, Report};

/// Accepts only the end of the frame.
#[derive(Debug)]
pub struct AllDataUsed;

// Requirement: DOC-5.1.5-1
#[inline]
fn parse(input: &Input<'_>) -> Result<(), Fault> {
    match input.left() {
        0 => Ok(()),
        left => Err(input.fault(Reason::Long { left })),
    }
}

impl Duties for AllDataUsed {
    const NAME: &'static str = "all data used";
    const BYTES: usize = 0;

    #[inline]
    fn parse_command(
        input: &mut Input<'_>,
        _context: &Context,
        _command: &mut Command,
    ) -> Result<(), Fault> {
        parse(input)
    }

    #[inline]
    fn write_command(_output: &mut Output<'_>, _context: &Context, _command: &Command) {}

    #[inline]
    fn parse_report(
        input: &mut Input<'_>,
        _context: &Context,
        _report: &mut Report,
    ) -> Result<(), Fault> {
        parse(input)
    }

    #[inline]
    fn write_report(_output: &mut Output<'_>, _context: &Context, _report: &Report) {}
}

//! Transmission key: one byte that each end knows of the other (document, 5.1.6).
//!
//! First in every chain, so that a frame of anything else is not read any further.

use super::error::Reason;
use super::strategy::{Context, Duties, Fault, Input, Output};
use super::{Command, Report};

/// Sends the own key, accepts only the other end's.
#[derive(Debug)]
pub struct Key;

// Requirement: DOC-5.1.6-1
#[inline]
fn parse(input: &mut Input<'_>, expected: u8) -> Result<(), Fault> {
    let before = *input;
    let [found] = input.take()?;
    if found == expected {
        Ok(())
    } else {
        Err(before.fault(Reason::Key { expected, found }))
    }
}

impl Duties for Key {
    const NAME: &'static str = "transmission key";
    const BYTES: usize = 1;

    #[inline]
    fn parse_command(
        input: &mut Input<'_>,
        context: &Context,
        _command: &mut Command,
    ) -> Result<(), Fault> {
        parse(input, context.key_from_pi)
    }

    #[inline]
    fn write_command(output: &mut Output<'_>, context: &Context, _command: &Command) {
        output.put([context.key_from_pi]);
    }

    #[inline]
    fn parse_report(
        input: &mut Input<'_>,
        context: &Context,
        _report: &mut Report,
    ) -> Result<(), Fault> {
        parse(input, context.key_from_stm)
    }

    #[inline]
    fn write_report(output: &mut Output<'_>, context: &Context, _report: &Report) {
        output.put([context.key_from_stm]);
    }
}

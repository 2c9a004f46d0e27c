//! Sequence: the sender's own frame counter, and the last counter it accepted from the other end.
//!
//! | byte | both directions |
//! |---|---|
//! | 1 | own counter, wraps from 0xFF to 0x00 |
//! | 2 | last counter accepted from the other end; 0 before the first |
//!
//! A frame is fresh when its counter is 1 to 127 steps ahead of the last one accepted, wrapping;
//! the first frame after a reset always is. A repeated or older frame is rejected.

use super::error::Reason;
use super::strategy::{Context, Duties, Fault, Input, Output};
use super::{Command, Report, Sequence as Counters};

/// Sends and checks the frame counters.
#[derive(Debug)]
pub struct Sequence;

/// Whether counter `a` is strictly newer than `b`: 1 to 127 steps ahead, wrapping.
#[inline]
#[must_use]
pub const fn newer(a: u8, b: u8) -> bool {
    matches!(a.wrapping_sub(b), 1..=0x7F)
}

#[inline]
fn parse(input: &mut Input<'_>, last: Option<u8>) -> Result<Counters, Fault> {
    let before = *input;
    let [own, seen] = input.take()?;
    match last {
        Some(last) if !newer(own, last) => Err(before.fault(Reason::Stale { last, found: own })),
        _ => Ok(Counters { own, seen }),
    }
}

#[inline]
fn write(output: &mut Output<'_>, context: Context) {
    output.put([context.own, context.last.unwrap_or_default()]);
}

impl Duties for Sequence {
    const NAME: &'static str = "sequence";
    const BYTES: usize = 2;
    const TELLS_FRESH: bool = true;

    #[inline]
    fn parse_command(
        input: &mut Input<'_>,
        context: &Context,
        command: &mut Command,
    ) -> Result<(), Fault> {
        command.sequence = parse(input, context.last)?;
        Ok(())
    }

    #[inline]
    fn write_command(output: &mut Output<'_>, context: &Context, _command: &Command) {
        write(output, *context);
    }

    #[inline]
    fn parse_report(
        input: &mut Input<'_>,
        context: &Context,
        report: &mut Report,
    ) -> Result<(), Fault> {
        report.sequence = parse(input, context.last)?;
        Ok(())
    }

    #[inline]
    fn write_report(output: &mut Output<'_>, context: &Context, _report: &Report) {
        write(output, *context);
    }
}

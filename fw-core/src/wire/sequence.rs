//! Sequence: the sender's own frame counter, and the last counter it accepted from the other end.
//!
//! | byte | both directions |
//! |---|---|
//! | 1 | own counter, wraps from 0xFF to 0x00 |
//! | 2 | last counter accepted from the other end; 0 before the first |
//!
//! A frame is fresh when its counter is 1 to 127 steps ahead of the last one accepted, wrapping;
//! the first frame after a reset always is. A repeated or older frame is rejected; four of them in
//! a row that count upwards are no repeats, but an end that begins anew or was cut off for long.

use super::error::Reason;
use super::strategy::{Context, Duties, Fault, Input, Output};
use super::{Command, Report, Sequence as Counters};

/// Sends and checks the frame counters.
#[derive(Debug)]
pub struct Sequence;

/// Whether counter `a` is strictly newer than `b`: 1 to 127 steps ahead, wrapping.
// Requirement: WIRE-sequence-1
#[inline]
#[must_use]
pub const fn newer(a: u8, b: u8) -> bool {
    matches!(a.wrapping_sub(b), 1..=0x7F)
}

/// Stale frames of a row that begin anew.
const ROW: u8 = 4;

/// The stale frames in a row that were right in everything else, each numbered one above the one
/// before it.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub(super) struct Row {
    own: u8,
    frames: u8,
}

impl Row {
    /// No stale frame since the last accepted one.
    pub(super) const NONE: Self = Self { own: 0, frames: 0 };

    /// Adds a stale frame; whether with it the other end begins anew. The number `last` accepted
    /// breaks the row: what ends there is a repeat, or else goes on to what is fresh.
    // Requirement: WIRE-sequence-3
    pub(super) fn begins_anew(&mut self, last: u8, own: u8) -> bool {
        let follows = self.frames > 0 && own == self.own.wrapping_add(1);
        self.frames = match (own == last, follows) {
            (true, _) => 0,
            (false, true) => self.frames.saturating_add(1),
            (false, false) => 1,
        };
        self.own = own;
        self.frames >= ROW
    }
}

// Requirement: WIRE-sequence-6
#[inline]
fn parse(input: &mut Input<'_>, last: Option<u8>) -> Result<Counters, Fault> {
    let before = *input;
    let [own, seen] = input.take()?;
    match last {
        Some(last) if !newer(own, last) => Err(before.fault(Reason::Stale { last, found: own })),
        _ => Ok(Counters { own, seen }),
    }
}

// Requirement: WIRE-sequence-4
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

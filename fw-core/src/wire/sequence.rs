//! Sequence: the sender's own frame counter, and the last counter it accepted from the other end.
//!
//! | byte | both directions |
//! |---|---|
//! | 1 | own counter, wraps from 0xFF to 0x00 |
//! | 2 | last counter accepted from the other end; 0 before the first |
//!
//! A frame is fresh when its counter is 1 to 127 steps ahead of the last one accepted, wrapping;
//! the first frame after a reset always is. A repeated or older frame is rejected; four in a row that
//! count upwards mean that the sender has restarted or was cut off for long.

use super::error::{FieldError, Reason};
use super::strategy::{Context, FrameReader, FrameWriter, Parsed, Strategy};
use super::{Command, Report, Sequence as Counters};

/// Sends and checks the frame counters.
#[derive(Debug)]
pub struct Sequence;

/// Whether counter `a` is strictly newer than `b`: 1 to 127 steps ahead, wrapping.
// Requirement: WIRE-sequence-1
#[inline(always)]
pub const fn newer(a: u8, b: u8) -> bool {
    a.wrapping_sub(b).wrapping_sub(1) < 0x7F
}

/// Stale frames after which the sender is taken as restarted.
const RESTART_AFTER: u8 = 4;

/// Counts stale frames that are right in everything else, each numbered one above the one before:
/// not repeats, but a sender that has restarted or was cut off for long.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub(super) struct ResyncDetector {
    own: u8,
    frames: u8,
}

impl ResyncDetector {
    /// No stale frame since the last accepted one.
    pub(super) const NEW: Self = Self { own: 0, frames: 0 };

    /// Adds a stale frame; true when the sender has restarted. The number `last` accepted resets the
    /// count: it ends a run of repeats, or of numbers that go on to what is fresh.
    // Requirement: WIRE-sequence-3
    pub(super) fn add(&mut self, last: u8, own: u8) -> bool {
        let follows = self.frames > 0 && own == self.own.wrapping_add(1);
        self.frames = match (own == last, follows) {
            (true, _) => 0,
            (false, true) => self.frames.saturating_add(1),
            (false, false) => 1,
        };
        self.own = own;
        self.frames >= RESTART_AFTER
    }
}

// Requirement: WIRE-sequence-6
#[inline(always)]
fn parse(reader: &mut FrameReader<'_>, last: Option<u8>) -> Result<Counters, FieldError> {
    let [own, seen] = reader.take()?;
    match last {
        Some(last) if !newer(own, last) => Err(reader.error(2, Reason::Stale { last, found: own })),
        _ => Ok(Counters { own, seen }),
    }
}

// Requirement: WIRE-sequence-4
#[inline(always)]
fn write(writer: &mut FrameWriter<'_>, context: Context) {
    writer.put([context.own, context.last.unwrap_or_default()]);
}

impl Strategy for Sequence {
    const NAME: &'static str = "sequence";
    const LEN: usize = 2;

    #[inline(always)]
    fn parse_command(
        reader: &mut FrameReader<'_>,
        context: &Context,
        command: &mut Command,
    ) -> Parsed {
        command.sequence = parse(reader, context.last)?;
        Ok(())
    }

    #[inline(always)]
    fn write_command(writer: &mut FrameWriter<'_>, context: &Context, _command: &Command) {
        write(writer, *context);
    }

    #[inline(always)]
    fn parse_report(
        reader: &mut FrameReader<'_>,
        context: &Context,
        report: &mut Report,
    ) -> Parsed {
        report.sequence = parse(reader, context.last)?;
        Ok(())
    }

    #[inline(always)]
    fn write_report(writer: &mut FrameWriter<'_>, context: &Context, _report: &Report) {
        write(writer, *context);
    }
}

//! Both ends of the link: the chain with the sequence numbers and the counters of a side.
//!
//! All or nothing: a rejected frame changes a counter and nothing else; one that is stale and right
//! in everything else also stands in the row that may begin anew.

use super::sequence::Row;
use super::strategy::Context;
use super::{
    parse_command, parse_report, parse_whole, write_command, write_report, Cause, Command,
    FrameError, Mode, Reason, Report, Sequence, MAX_FRAME,
};

/// What both ends need to know to understand each other.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct Setup {
    /// Which chain.
    pub mode: Mode,
    /// The key the STM expects from the Pi.
    pub key_from_pi: u8,
    /// The key the STM sends.
    pub key_from_stm: u8,
    /// Battery cells, 1 ..= 8.
    pub cells: u8,
}

/// Frames of the other end, counted. Counters stop at their largest value.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub struct LinkCounters {
    /// Frames accepted.
    pub accepted: u32,
    /// Frames rejected, in the order of [`Cause::ALL`].
    rejected: [u32; Cause::ALL.len()],
    /// Frames that arrived but had to be dropped unread.
    pub overrun: u32,
    /// Frames the other end numbered that were never accepted; guarded modes only.
    pub missed: u32,
    /// Own frames numbered that the other end had not acknowledged when it sent its last accepted
    /// one; guarded modes only. 1 is the least a full-duplex frame can show, 2 at the STM, which has
    /// numbered its next reply by then.
    pub unacknowledged: u8,
}

impl LinkCounters {
    /// Frames rejected for a cause.
    #[must_use]
    pub fn rejected(&self, cause: Cause) -> u32 {
        self.rejected
            .get(cause as usize)
            .copied()
            .unwrap_or_default()
    }

    /// Frames rejected for any cause.
    #[must_use]
    pub fn rejected_total(&self) -> u32 {
        self.rejected
            .iter()
            .fold(0, |total, &count| total.saturating_add(count))
    }

    /// Every frame that arrived: accepted, rejected or dropped unread.
    #[must_use]
    pub fn frames(&self) -> u32 {
        self.accepted
            .saturating_add(self.rejected_total())
            .saturating_add(self.overrun)
    }

    // Requirement: WIRE-rejected-1, WIRE-log-11
    #[cold]
    pub(crate) fn reject(&mut self, cause: Cause) {
        let count = self.rejected(cause).saturating_add(1);
        // Not written where the cause points to: to a model checker that may change all that stands around
        // the counters, the mode too.
        for (place, slot) in self.rejected.iter_mut().enumerate() {
            if place == cause as usize {
                *slot = count;
            }
        }
    }
}

/// What both ends have in common.
#[derive(Clone, Debug, PartialEq, Eq)]
struct End {
    mode: Mode,
    context: Context,
    stale: Row,
    counters: LinkCounters,
}

impl End {
    const fn new(setup: Setup) -> Self {
        Self {
            mode: setup.mode,
            context: Context {
                key_from_pi: setup.key_from_pi,
                key_from_stm: setup.key_from_stm,
                cells: setup.cells,
                own: 0,
                last: None,
            },
            stale: Row::NONE,
            counters: LinkCounters {
                accepted: 0,
                rejected: [0; Cause::ALL.len()],
                overrun: 0,
                missed: 0,
                unacknowledged: 0,
            },
        }
    }

    #[inline]
    fn advance(&mut self) {
        self.context.own = self.context.own.wrapping_add(1);
    }

    /// Takes over the numbers of a frame that passed its whole chain.
    // Requirement: WIRE-sequence-2
    #[inline]
    fn accept(&mut self, sequence: Sequence) {
        self.counters.accepted = self.counters.accepted.saturating_add(1);
        if !self.mode.tells_fresh() {
            return;
        }
        if let Some(last) = self.context.last {
            let between = sequence.own.wrapping_sub(last).wrapping_sub(1);
            self.counters.missed = self.counters.missed.saturating_add(between.into());
        }
        self.context.last = Some(sequence.own);
        self.stale = Row::NONE;
        self.counters.unacknowledged = self.context.own.wrapping_sub(sequence.seen);
    }

    /// A rejected frame, which `read` reads with another context: what it says if with it the other
    /// end begins anew. Its numbers then count like those of a first frame.
    // Requirement: WIRE-sequence-7
    fn reject<T>(
        &mut self,
        error: FrameError,
        read: impl FnOnce(&Context) -> Result<T, FrameError>,
        sequence: impl FnOnce(&T) -> Sequence,
    ) -> Result<T, FrameError> {
        if let Reason::Stale { last, .. } = error.reason {
            let first = Context {
                last: None,
                ..self.context
            };
            if let Ok(read) = read(&first) {
                let sequence = sequence(&read);
                if self.stale.begins_anew(last, sequence.own) {
                    self.context = first;
                    self.accept(sequence);
                    return Ok(read);
                }
            }
        }
        self.counters.reject(error.reason.cause());
        Err(error)
    }
}

/// The STM's end: receives commands, sends reports.
#[derive(Clone, Debug, PartialEq, Eq)]
pub struct StmLink {
    end: End,
}

impl StmLink {
    /// The link after a reset: nothing sent, nothing accepted.
    #[must_use]
    pub const fn new(setup: Setup) -> Self {
        Self {
            end: End::new(setup),
        }
    }

    /// The mode whose chain it runs.
    #[must_use]
    pub const fn mode(&self) -> Mode {
        self.end.mode
    }

    /// A received frame: what it says, if all of it is right.
    ///
    /// # Errors
    /// The first strategy that failed, and why; counted, and of what it says nothing is taken.
    #[inline]
    pub fn receive(&mut self, frame: &[u8]) -> Result<Command, FrameError> {
        self.receive_clocked(frame, frame.len())
    }

    /// A received frame of which `clocked` bytes crossed the wire while `buffer` had room for
    /// some: the tail of a frame longer than the buffer is known by its length only.
    ///
    /// # Errors
    /// As [`Self::receive`].
    // Requirement: WIRE-chain-1
    #[inline]
    pub fn receive_clocked(
        &mut self,
        buffer: &[u8],
        clocked: usize,
    ) -> Result<Command, FrameError> {
        let frame = buffer.get(..clocked).unwrap_or(buffer);
        let beyond = clocked.saturating_sub(buffer.len());
        match parse_command(self.end.mode, &self.end.context, frame, beyond) {
            Ok(command) => {
                self.end.accept(command.sequence);
                Ok(command)
            }
            Err(error) => self.reject(error, frame, beyond),
        }
    }

    /// The same for a frame that is right, by [`parse_whole`]; nothing, and nothing counted, for any
    /// other: then ask [`Self::receive_clocked`].
    #[inline]
    pub fn receive_whole(&mut self, buffer: &[u8], clocked: usize) -> Option<Command> {
        if clocked != buffer.len() {
            return None;
        }
        let command = parse_whole(self.end.mode, &self.end.context, buffer)?;
        self.end.accept(command.sequence);
        Some(command)
    }

    #[cold]
    #[inline(never)]
    fn reject(
        &mut self,
        error: FrameError,
        frame: &[u8],
        beyond: usize,
    ) -> Result<Command, FrameError> {
        let mode = self.end.mode;
        let read = |context: &_| parse_command(mode, context, frame, beyond);
        self.end.reject(error, read, |command| command.sequence)
    }

    /// Counts frames that arrived but had to be dropped unread.
    pub fn overrun(&mut self, frames: u32) {
        let counters = &mut self.end.counters;
        counters.overrun = counters.overrun.saturating_add(frames);
    }

    /// Writes the reply to the next chip-select, with a new sequence number; returns its length.
    /// The report's own `sequence` is not looked at.
    #[inline]
    pub fn send(&mut self, report: &Report, out: &mut [u8; MAX_FRAME]) -> usize {
        self.advance();
        self.resend(report, out)
    }

    /// Takes the next sequence number: the reply that has the present one went out.
    #[inline]
    pub fn advance(&mut self) {
        self.end.advance();
    }

    /// Writes the reply anew with fresher data and the number it already had, as no chip-select
    /// has taken it yet.
    // Requirement: DOC-5-2, WIRE-sequence-5
    #[inline]
    pub fn resend(&self, report: &Report, out: &mut [u8; MAX_FRAME]) -> usize {
        self.write(0, report, out)
    }

    /// Writes the reply after the one of [`Self::send`], in advance: with the number that the next
    /// `send` will give it.
    #[inline]
    pub fn anticipate(&self, report: &Report, out: &mut [u8; MAX_FRAME]) -> usize {
        self.write(1, report, out)
    }

    fn write(&self, ahead: u8, report: &Report, out: &mut [u8; MAX_FRAME]) -> usize {
        let mut context = self.end.context;
        context.own = context.own.wrapping_add(ahead);
        write_report(self.end.mode, &context, report, out)
    }

    /// Frames received, counted.
    #[must_use]
    pub const fn counters(&self) -> &LinkCounters {
        &self.end.counters
    }
}

/// The Pi's end: sends commands, receives reports.
#[derive(Clone, Debug, PartialEq, Eq)]
pub struct PiLink {
    end: End,
}

impl PiLink {
    /// The link at the program's start: nothing sent, nothing accepted.
    #[must_use]
    pub const fn new(setup: Setup) -> Self {
        Self {
            end: End::new(setup),
        }
    }

    /// The mode whose chain it runs.
    #[must_use]
    pub const fn mode(&self) -> Mode {
        self.end.mode
    }

    /// Writes a command, with a new sequence number; returns its length. The command's own
    /// `sequence` is not looked at.
    // Requirement: DOC-5-2
    pub fn send(&mut self, command: &Command, out: &mut [u8; MAX_FRAME]) -> usize {
        self.end.advance();
        write_command(self.end.mode, &self.end.context, command, out)
    }

    /// A received frame: what it says, if all of it is right.
    ///
    /// # Errors
    /// The first strategy that failed, and why; counted, and of what it says nothing is taken.
    pub fn receive(&mut self, frame: &[u8]) -> Result<Report, FrameError> {
        match parse_report(self.end.mode, &self.end.context, frame, 0) {
            Ok(report) => {
                self.end.accept(report.sequence);
                Ok(report)
            }
            Err(error) => self.reject(error, frame),
        }
    }

    #[cold]
    fn reject(&mut self, error: FrameError, frame: &[u8]) -> Result<Report, FrameError> {
        let mode = self.end.mode;
        let read = |context: &_| parse_report(mode, context, frame, 0);
        self.end.reject(error, read, |report| report.sequence)
    }

    /// Frames received, counted.
    #[must_use]
    pub const fn counters(&self) -> &LinkCounters {
        &self.end.counters
    }
}

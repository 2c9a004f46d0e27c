//! Both ends of the link: the chain with the sequence numbers and the counters of a side.
//!
//! All or nothing: a rejected frame changes a counter and nothing else; a stale one that is right in
//! everything else also counts towards the detection of a restarted sender.

use super::crc::crc16;
use super::handover::{SAME_PREFIX, begin_alike};
use super::sequence::ResyncDetector;
use super::strategy::Context;
use super::{
    Cause, Command, Field, FrameError, MAX_FRAME, Mode, Reason, Report, Sequence, parse_command,
    parse_report, write_command, write_report,
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

impl Setup {
    /// The first board's keys and cells.
    pub const fn first_board(mode: Mode) -> Self {
        Self {
            mode,
            key_from_pi: 0x96,
            key_from_stm: 0x5A,
            cells: 2,
        }
    }

    /// What the strategies know of it, before the first frame.
    pub const fn context(&self) -> Context {
        Context {
            key_from_pi: self.key_from_pi,
            key_from_stm: self.key_from_stm,
            cells: self.cells,
            own: 0,
            last: None,
        }
    }
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
    pub fn rejected(&self, cause: Cause) -> u32 {
        self.rejected
            .get(cause as usize)
            .copied()
            .unwrap_or_default()
    }

    /// Frames rejected for any cause.
    pub fn rejected_total(&self) -> u32 {
        self.rejected
            .iter()
            .fold(0, |total, &count| total.saturating_add(count))
    }

    /// Every frame that arrived: accepted, rejected or dropped unread.
    pub fn frames(&self) -> u32 {
        self.accepted
            .saturating_add(self.rejected_total())
            .saturating_add(self.overrun)
    }

    // Requirement: WIRE-rejected-1, WIRE-log-11
    #[cold]
    pub(crate) fn reject(&mut self, cause: Cause) {
        let count = self.rejected(cause).saturating_add(1);
        // No computed index: CBMC would treat the whole struct as modified.
        for (place, slot) in self.rejected.iter_mut().enumerate() {
            if place == cause as usize {
                *slot = count;
            }
        }
    }
}

/// What both ends have in common.
#[derive(Clone, Debug, PartialEq, Eq)]
struct LinkEndpoint {
    mode: Mode,
    context: Context,
    resync: ResyncDetector,
    counters: LinkCounters,
}

impl LinkEndpoint {
    const fn new(setup: Setup) -> Self {
        Self {
            mode: setup.mode,
            context: setup.context(),
            resync: ResyncDetector::NEW,
            counters: LinkCounters {
                accepted: 0,
                rejected: [0; Cause::ALL.len()],
                overrun: 0,
                missed: 0,
                unacknowledged: 0,
            },
        }
    }

    /// Takes over the numbers of a frame that passed its whole chain; `own` is the number of the
    /// frame that this end sends next or sent last.
    // Requirement: WIRE-sequence-2
    #[inline]
    fn accept(&mut self, sequence: Sequence, own: u8) {
        self.counters.accepted = self.counters.accepted.saturating_add(1);
        if !self.mode.has(Field::Sequence) {
            return;
        }
        if let Some(last) = self.context.last {
            let between = sequence.own.wrapping_sub(last).wrapping_sub(1);
            self.counters.missed = self.counters.missed.saturating_add(between.into());
        }
        self.context.last = Some(sequence.own);
        self.resync = ResyncDetector::NEW;
        self.counters.unacknowledged = own.wrapping_sub(sequence.seen);
    }

    /// Counts a rejected frame. A stale one is parsed once more as if it were the sender's first: right
    /// in everything else, it may show that the sender has restarted, and is accepted then.
    // Requirement: WIRE-sequence-7
    fn reject<T>(
        &mut self,
        error: FrameError,
        own: u8,
        parse: impl FnOnce(Mode, &Context) -> Result<T, FrameError>,
        sequence: impl FnOnce(&T) -> Sequence,
    ) -> Result<T, FrameError> {
        if let Reason::Stale { last, .. } = error.reason {
            let first = Context {
                last: None,
                ..self.context
            };
            if let Ok(value) = parse(self.mode, &first) {
                let sequence = sequence(&value);
                if self.resync.add(last, sequence.own) {
                    self.context = first;
                    self.accept(sequence, own);
                    return Ok(value);
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
    endpoint: LinkEndpoint,
}

impl StmLink {
    /// The link after a reset: nothing accepted.
    pub const fn new(setup: Setup) -> Self {
        Self {
            endpoint: LinkEndpoint::new(setup),
        }
    }

    /// The mode whose chain it runs.
    pub const fn mode(&self) -> Mode {
        self.endpoint.mode
    }

    /// The command of a received frame, if all of it is right. `overflow_len` bytes crossed the wire
    /// after those of `frame`; `reply` is the number of the next reply, see [`Self::encode_reply`].
    ///
    /// # Errors
    /// The first strategy that failed, and why; counted, and nothing of the frame takes effect.
    // Requirement: WIRE-chain-1
    #[inline]
    pub fn receive(
        &mut self,
        frame: &[u8],
        overflow_len: usize,
        reply: u32,
    ) -> Result<Command, FrameError> {
        let endpoint = &mut self.endpoint;
        let received = parse_command(endpoint.mode, &endpoint.context, frame, overflow_len);
        match &received {
            Ok(command) => endpoint.accept(command.sequence, own(reply)),
            Err(error) => return self.reject(*error, frame, overflow_len, reply),
        }
        received
    }

    #[cold]
    #[inline(never)]
    fn reject(
        &mut self,
        error: FrameError,
        frame: &[u8],
        overflow_len: usize,
        reply: u32,
    ) -> Result<Command, FrameError> {
        self.endpoint.reject(
            error,
            own(reply),
            |mode, context| parse_command(mode, context, frame, overflow_len),
            |command| command.sequence,
        )
    }

    /// Counts frames that arrived but had to be dropped unread.
    // Requirement: WIRE-spi-3, WIRE-log-11
    pub fn overrun(&mut self, frames: u32) {
        let counters = &mut self.endpoint.counters;
        counters.overrun = counters.overrun.saturating_add(frames);
    }

    /// Writes reply `number`, counted from 1 after a reset; returns its length. Its sequence number is
    /// the number's lowest byte, so a reply can be written again with fresher data. The report's own
    /// `sequence` is not used.
    // Requirement: DOC-5-2, WIRE-sequence-5
    pub fn encode_reply(&self, number: u32, report: &Report, out: &mut [u8; MAX_FRAME]) -> usize {
        let context = Context {
            own: own(number),
            ..self.endpoint.context
        };
        write_report(self.endpoint.mode, &context, report, out)
    }

    /// In guarded modes gives a reply of `len` bytes the key, sequence and status of one that begins with
    /// `begin`: fresher data, known to the Pi by the same number.
    // Requirement: WIRE-spi-6
    #[inline]
    pub fn keep_begin(&self, begin: [u8; SAME_PREFIX], reply: &mut [u8; MAX_FRAME], len: usize) {
        let alike = reply
            .first_chunk()
            .is_some_and(|own| begin_alike(*own, begin));
        if self.endpoint.mode.has(Field::Status) && !alike {
            let whole = reply.get_mut(..len).unwrap_or_default();
            if let Some((data, crc)) = whole.split_last_chunk_mut() {
                if let Some(first) = data.first_chunk_mut() {
                    *first = begin;
                }
                *crc = crc16(data).to_be_bytes();
            }
        }
    }

    /// Frames received, counted.
    pub const fn counters(&self) -> &LinkCounters {
        &self.endpoint.counters
    }
}

/// The sequence number of a reply.
#[allow(clippy::cast_possible_truncation, reason = "wraps by definition")]
const fn own(number: u32) -> u8 {
    number as u8
}

/// The Pi's end: sends commands, receives reports.
#[derive(Clone, Debug, PartialEq, Eq)]
pub struct PiLink {
    endpoint: LinkEndpoint,
}

impl PiLink {
    /// The link at the program's start: nothing sent, nothing accepted.
    pub const fn new(setup: Setup) -> Self {
        Self {
            endpoint: LinkEndpoint::new(setup),
        }
    }

    /// The mode whose chain it runs.
    pub const fn mode(&self) -> Mode {
        self.endpoint.mode
    }

    /// Writes a command, with a new sequence number; returns its length. The command's own
    /// `sequence` is not used.
    // Requirement: DOC-5-2
    pub fn send(&mut self, command: &Command, out: &mut [u8; MAX_FRAME]) -> usize {
        let context = &mut self.endpoint.context;
        context.own = context.own.wrapping_add(1);
        write_command(self.endpoint.mode, context, command, out)
    }

    /// The report of a received frame, if all of it is right.
    ///
    /// # Errors
    /// The first strategy that failed, and why; counted, and nothing of the frame takes effect.
    pub fn receive(&mut self, frame: &[u8]) -> Result<Report, FrameError> {
        let endpoint = &mut self.endpoint;
        let own = endpoint.context.own;
        match parse_report(endpoint.mode, &endpoint.context, frame, 0) {
            Ok(report) => {
                endpoint.accept(report.sequence, own);
                Ok(report)
            }
            Err(error) => endpoint.reject(
                error,
                own,
                |mode, context| parse_report(mode, context, frame, 0),
                |report| report.sequence,
            ),
        }
    }

    /// Frames received, counted.
    pub const fn counters(&self) -> &LinkCounters {
        &self.endpoint.counters
    }
}

// Requirement: WIRE-spi-3, WIRE-log-11
#[test]
fn counters_at_their_end_stay_there() {
    let setup = Setup::first_board(Mode::GuardedNormal);
    let (mut pi, mut stm) = (PiLink::new(setup), StmLink::new(setup));
    let full = LinkCounters {
        accepted: u32::MAX,
        rejected: [u32::MAX; Cause::ALL.len()],
        overrun: u32::MAX,
        missed: u32::MAX,
        unacknowledged: 2,
    };
    stm.overrun(3);
    assert_eq!((stm.counters().overrun, stm.counters().frames()), (3, 3));
    stm.endpoint.counters = full;
    let mut frame = [0; MAX_FRAME];
    // The second of these frames is lost.
    for arrives in [true, false, true] {
        let len = pi.send(&Command::default(), &mut frame);
        assert!(!arrives || stm.receive(&frame[..len], 0, 2).is_ok());
    }
    stm.overrun(1);
    for cause in Cause::ALL {
        stm.endpoint.counters.reject(cause);
    }
    assert_eq!((stm.counters(), full.frames()), (&full, u32::MAX));
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn sum_of_counters_beyond_their_end_stays_there() {
        for (rejected, overrun) in [(u32::MAX, 0), (0, u32::MAX)] {
            let counters = LinkCounters {
                accepted: 1,
                rejected: [rejected; Cause::ALL.len()],
                overrun,
                missed: 0,
                unacknowledged: 2,
            };
            assert_eq!(counters.frames(), u32::MAX);
            assert_eq!(counters.rejected_total(), rejected);
        }
    }
}

//! T13, every interleaving of the log's writer and its transmitter: the core's own queue between
//! the robot's priority and the DMA of USART1, as `fw-pac/src/uart.rs` and `fw-pac/src/app.rs` use it.
//!
//! The queue is the code's own. The transmitter is a model of `Uart::service`: registers cannot run here.
//! Its steps are that function's accesses to a register or to the queue, one by one; before and
//! after each the DMA may move a byte, end or fail, and its interrupt may become pending. A line enters
//! the queue in one step, for nothing at its priority comes between its bytes; what the DMA has
//! in hand is compared before and after, so it does not matter when within the step it reads.
//!
//! `cargo test -p proofs --test log_model -- --nocapture` shows the way to each broken invariant.

use std::fmt;
use std::hash::{Hash, Hasher};
use std::ptr;

use fw_core::log::{Level, Log};
use proofs::search::{Model, assert_broken, assert_holds};

/// Bytes of the queue: three short lines, or the report of dropped lines and one short line.
const QUEUE: usize = 34;
/// More than any line, even one that has lost its end to the next.
const LONGEST: usize = 2 * QUEUE;
/// Lines written and transfers that fail at most.
const LINES: u8 = 5;
const FAILURES: u8 = 1;

/// A text; all its letters say how many they are.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Hash)]
enum Text {
    Short,
    Long,
}

impl Text {
    fn letters(self) -> &'static str {
        match self {
            Self::Short => "b",
            Self::Long => "jjjjjjjjjj",
        }
    }
}

/// Where `service` is.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Hash)]
enum Step {
    /// About to look whether the transfer in hand has failed.
    AskFailed,
    /// About to look whether it is complete.
    AskComplete,
    /// About to stop the stream.
    Stop,
    /// About to retire what was in hand.
    Retire,
    /// About to clear the stream's flags.
    Clear,
    /// About to see what is pending.
    Look,
    /// About to clear the flags for the transfer of the queue's first so many bytes.
    ClearFor(usize),
    /// About to enable the stream for them.
    Enable(usize),
}

/// What the robot's priority does.
#[derive(Clone, Debug, PartialEq, Eq, Hash)]
enum Handler {
    Idle,
    /// `PendSV`, at its events: a tick, frames.
    Writing,
    /// Within a line: seen only where something may come between, see [`Service::Preempting`].
    WithinLine(Text),
    /// `PendSV`, at its end.
    Servicing(Step),
}

/// The stream: which bytes of memory it moves, how many it has.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Hash)]
struct Transfer {
    /// From the queue's own address.
    offset: usize,
    len: usize,
    moved: usize,
}

/// What the far end of the UART makes of the bytes.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Hash)]
struct Reader {
    line: [u8; LONGEST],
    len: usize,
    /// Whole lines that were written, not reports.
    lines: u8,
    /// Lines reported as dropped.
    reported: u8,
    /// The number that follows, unless lines were dropped; the next one read says how many.
    next: u8,
    /// A transfer failed: one line may have lost its middle,
    doubtful: bool,
    /// and whole ones may be missing before the next.
    lossy: bool,
}

/// A decimal number.
fn decimal(digits: &[u8]) -> Option<u8> {
    std::str::from_utf8(digits).ok()?.parse().ok()
}

impl Reader {
    fn read(&mut self, byte: u8) -> Result<(), String> {
        if byte != b'\n' {
            let Some(slot) = self.line.get_mut(self.len) else {
                return Err("a line without an end".into());
            };
            *slot = byte;
            self.len += 1;
            return Ok(());
        }
        let before = *self;
        let whole = self.whole_line();
        let shown = String::from_utf8_lossy(&before.line[..before.len]).into_owned();
        if !whole {
            if !before.doubtful {
                return Err(format!("a torn line, or one out of its order: {shown:?}"));
            }
            *self = before;
        }
        self.doubtful = false;
        self.line = [0; LONGEST];
        self.len = 0;
        Ok(())
    }

    /// Whether the line is one that was written, with the number that follows.
    fn whole_line(&mut self) -> bool {
        let line = &self.line[..self.len];
        let (Some(level), Some(number), Some(b": "), Some(text)) = (
            line.first(),
            line.get(1..6).and_then(decimal),
            line.get(6..8),
            line.get(8..),
        ) else {
            return false;
        };
        let dropped = match level {
            b'W' => text.strip_suffix(b" lines dropped").and_then(decimal),
            b'I' => [Text::Short, Text::Long]
                .iter()
                .any(|known| known.letters().as_bytes() == text)
                .then_some(0),
            _ => None,
        };
        let Some(dropped) = dropped else {
            return false;
        };
        let expected = self.next + dropped;
        if number < expected || number > expected && !self.lossy {
            return false;
        }
        self.next = number + 1;
        // Two lines' halves may look like one.
        self.lossy &= self.doubtful;
        self.reported += dropped;
        self.lines += u8::from(dropped == 0);
        true
    }
}

#[derive(Clone)]
struct State {
    log: Log<QUEUE>,
    /// `Uart::sending`.
    sending: usize,
    handler: Handler,
    /// The stream's interrupt: where its `service` is.
    interrupt: Option<Step>,
    /// What the writer has of the queue while a line is under way, see [`Service::Preempting`].
    working_copy: Option<Box<Log<QUEUE>>>,
    /// The stream, while it is enabled.
    stream: Option<Transfer>,
    /// Its flags.
    complete: bool,
    failed: bool,
    /// Its interrupt is pending.
    pending: bool,
    reader: Reader,
    written: u8,
    failures: u8,
}

/// Where the queue's next byte stands, from its own address.
fn offset(log: &Log<QUEUE>) -> usize {
    log.pending().as_ptr() as usize - ptr::from_ref(log) as usize
}

/// The byte of a queue so far from its own address, if it is one of those still to be sent.
fn byte_at(log: &Log<QUEUE>, at: usize) -> Option<u8> {
    log.pending().get(at.checked_sub(offset(log))?).copied()
}

impl State {
    /// Everything the future depends on. The numbers of the queue's lines follow from what was written
    /// and read; what is neither pending nor in hand is overwritten before it is read.
    fn essence(&self) -> impl Eq + Hash + '_ {
        let copy = self.working_copy.as_ref();
        let copy = copy.map_or::<&[u8], _>(&[], |copy| copy.pending());
        let log = &self.log;
        (
            (log.pending(), copy, offset(log), log.dropped()),
            (self.sending, &self.handler, self.interrupt, self.stream),
            (self.complete, self.failed, self.pending),
            (&self.reader, self.written, self.failures),
        )
    }
}

impl PartialEq for State {
    fn eq(&self, other: &Self) -> bool {
        self.essence() == other.essence()
    }
}

impl Eq for State {}

impl Hash for State {
    fn hash<H: Hasher>(&self, state: &mut H) {
        self.essence().hash(state);
    }
}

impl fmt::Debug for State {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        write!(
            f,
            "queue {:?}, {} dropped, {} in hand; {:?}, interrupt {:?}{}; ",
            String::from_utf8_lossy(self.log.pending()),
            self.log.dropped(),
            self.sending,
            self.handler,
            self.interrupt,
            if self.pending { " pending" } else { "" },
        )?;
        match self.stream {
            None => write!(f, "stream off")?,
            Some(Transfer { offset, len, moved }) => {
                write!(f, "stream at {moved} of {len} from {offset}")?;
            }
        }
        write!(
            f,
            "{}{}; read {} lines and {:?}",
            if self.complete { " complete" } else { "" },
            if self.failed { " failed" } else { "" },
            self.reader.lines,
            String::from_utf8_lossy(&self.reader.line[..self.reader.len]),
        )
    }
}

#[derive(Clone, Copy, Debug)]
enum Event {
    /// The robot has something to do.
    Begin,
    /// It writes a line.
    Line(Text),
    /// The line is in the queue.
    LineEnd,
    /// It has done everything, and sees to the transmitter.
    End,
    /// `service` goes on.
    Go,
    /// The stream's interrupt is taken.
    Interrupt,
    /// Its `service` goes on.
    GoInterrupt,
    /// The stream moves a byte to the transmitter.
    Move,
    /// The bus refuses the stream an access.
    Refuse,
}

/// The transmitter, as it is or broken on purpose.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
enum Service {
    Right,
    /// What is in hand is retired without asking whether it has left.
    Impatient,
    /// A transfer is started over the one under way.
    Restarting,
    /// The flags of the transfer before stand when the next one starts.
    KeepingFlags,
    /// The stream has no interrupt.
    Unseen,
    /// It has none where a transfer fails.
    HalfSeen,
    /// The stream's interrupt may come within a line: another priority than the robot's. The writer's
    /// view of the queue is as old as the line's beginning.
    Preempting,
    /// Nothing is broken; what is rare counts as broken, and must be come across.
    Wanted,
}

impl Service {
    /// One step of `service`; where it goes on.
    fn serve(self, next: &mut State, step: Step) -> Option<Step> {
        match step {
            Step::AskFailed if next.sending == 0 => Some(Step::Look),
            Step::AskFailed if next.failed => Some(Step::Stop),
            Step::AskFailed => Some(Step::AskComplete),
            Step::AskComplete if next.complete || self == Self::Impatient => Some(Step::Retire),
            Step::AskComplete if self == Self::Restarting => Some(Step::Look),
            Step::AskComplete => None,
            Step::Stop => {
                next.stream = None;
                Some(Step::Retire)
            }
            Step::Retire => {
                next.log.sent(next.sending);
                next.sending = 0;
                Some(Step::Clear)
            }
            Step::Clear => {
                self.clear(next);
                Some(Step::Look)
            }
            Step::Look => {
                let count = next.log.pending().len();
                (count > 0).then_some(Step::ClearFor(count))
            }
            Step::ClearFor(count) => {
                self.clear(next);
                Some(Step::Enable(count))
            }
            Step::Enable(count) => {
                let (offset, moved) = (offset(&next.log), 0);
                next.stream = Some(Transfer {
                    offset,
                    len: count,
                    moved,
                });
                next.sending = count;
                None
            }
        }
    }

    fn clear(self, next: &mut State) {
        if self != Self::KeepingFlags {
            next.complete = false;
            next.failed = false;
        }
    }

    /// A flag that stands raises the interrupt: when the stream ends, and when a handler does.
    fn raise(self, next: &mut State) {
        next.pending |= match self {
            Self::Unseen => false,
            Self::HalfSeen => next.complete,
            _ => next.complete || next.failed,
        };
    }
}

/// What must hold of every step.
fn check(state: &State, next: &State) -> Result<(), String> {
    // Whatever the stream has still to read is as it was when it was handed over.
    if let (Some(_), Some(hand)) = (state.stream, next.stream) {
        for at in hand.offset + hand.moved..hand.offset + hand.len {
            if byte_at(&next.log, at).is_none() {
                return Err("bytes that the stream has in hand are free to be overwritten".into());
            }
            if state.stream == next.stream && byte_at(&state.log, at) != byte_at(&next.log, at) {
                return Err("bytes were changed while the stream had them in hand".into());
            }
        }
    }
    let idle = next.handler == Handler::Idle && next.interrupt.is_none() && !next.pending;
    if idle && next.stream.is_none() {
        // Nothing will happen until the robot has something to do.
        if !next.log.pending().is_empty() {
            return Err("lines wait and nothing will send them".into());
        }
        let (read, dropped) = (next.reader, next.log.dropped());
        let accounted = u32::from(read.lines) + dropped == u32::from(next.written);
        if next.failures == 0 && !(accounted && u32::from(read.reported) == dropped) {
            return Err("a line was neither sent nor counted as dropped".into());
        }
    }
    Ok(())
}

impl Model for Service {
    type State = State;
    type Event = Event;

    fn starts(&self) -> Vec<State> {
        vec![State {
            log: Log::new(),
            sending: 0,
            handler: Handler::Idle,
            interrupt: None,
            working_copy: None,
            stream: None,
            complete: false,
            failed: false,
            pending: false,
            reader: Reader {
                line: [0; LONGEST],
                len: 0,
                lines: 0,
                reported: 0,
                next: 0,
                doubtful: false,
                lossy: false,
            },
            written: 0,
            failures: 0,
        }]
    }

    fn events(&self, state: &State) -> Vec<Event> {
        let mut events = Vec::new();
        // The stream goes on whatever the processor does.
        if state.stream.is_some() {
            events.push(Event::Move);
            if state.failures < FAILURES {
                events.push(Event::Refuse);
            }
        }
        if state.interrupt.is_some() {
            // One priority: what runs at it runs to its end, unless that is what is broken.
            events.push(Event::GoInterrupt);
            return events;
        }
        let between = state.handler == Handler::Idle || *self == Self::Preempting;
        if state.pending && between {
            events.push(Event::Interrupt);
        }
        match state.handler {
            Handler::Idle if state.written < LINES => events.push(Event::Begin),
            Handler::Idle => {}
            Handler::Writing => {
                if state.written < LINES {
                    events.push(Event::Line(Text::Short));
                    events.push(Event::Line(Text::Long));
                }
                events.push(Event::End);
            }
            Handler::WithinLine(_) => events.push(Event::LineEnd),
            Handler::Servicing(_) => events.push(Event::Go),
        }
        events
    }

    fn step(&self, state: &State, event: &Event) -> Result<State, String> {
        let mut next = state.clone();
        let write = |log: &mut Log<QUEUE>, text: Text| {
            log.line(Level::Info, |line| {
                line.text(text.letters());
            });
        };
        match *event {
            Event::Begin => next.handler = Handler::Writing,
            Event::Line(text) if *self == Self::Preempting => {
                next.working_copy = Some(Box::new(next.log.clone()));
                next.handler = Handler::WithinLine(text);
            }
            Event::Line(text) => {
                write(&mut next.log, text);
                next.written += 1;
            }
            Event::LineEnd => {
                if let (Some(mut copy), Handler::WithinLine(text)) =
                    (next.working_copy.take(), state.handler.clone())
                {
                    write(&mut copy, text);
                    next.log = *copy;
                }
                next.written += 1;
                next.handler = Handler::Writing;
            }
            Event::End => next.handler = Handler::Servicing(Step::AskFailed),
            Event::Go => {
                if let Handler::Servicing(step) = state.handler {
                    if let Some(step) = self.serve(&mut next, step) {
                        next.handler = Handler::Servicing(step);
                    } else {
                        next.handler = Handler::Idle;
                        self.raise(&mut next);
                    }
                }
            }
            Event::Interrupt => {
                next.pending = false;
                next.interrupt = Some(Step::AskFailed);
            }
            Event::GoInterrupt => {
                if let Some(step) = state.interrupt {
                    next.interrupt = self.serve(&mut next, step);
                    if next.interrupt.is_none() {
                        self.raise(&mut next);
                    }
                }
            }
            Event::Move => {
                if let Some(stream) = &mut next.stream {
                    let byte = byte_at(&next.log, stream.offset + stream.moved);
                    stream.moved += 1;
                    let done = stream.moved == stream.len;
                    let byte = byte.ok_or("the stream reads what is not in the queue any more")?;
                    next.reader.read(byte)?;
                    if done {
                        next.stream = None;
                        next.complete = true;
                        self.raise(&mut next);
                    }
                }
            }
            Event::Refuse => {
                next.failures += 1;
                next.failed = true;
                next.reader.doubtful = true;
                next.reader.lossy = true;
                next.stream = None;
                self.raise(&mut next);
            }
        }
        check(state, &next)?;
        let read = &next.reader;
        // Dropped, reported, and more lines after that, one across the ring's end; a transfer failed.
        let rare = next.failures > 0 && !read.doubtful && read.reported > 0;
        let after = rare && read.line[0] == b'I' && read.lines >= 2;
        if *self == Self::Wanted && after {
            return Err("a line after a report after a failure".into());
        }
        Ok(next)
    }
}

// Requirement: WIRE-log-2
#[test]
fn log_keeps_lines_in_every_interleaving() {
    assert_holds(&Service::Right, 10_000);
}

#[test]
fn log_search_meets_rare_states() {
    assert_broken(&[(Service::Wanted, "a line after a report")]);
}

#[test]
fn broken_transmitter_is_found() {
    assert_broken(&[
        (Service::Impatient, "free to be overwritten"),
        (Service::Restarting, "torn line"),
        (Service::KeepingFlags, "free to be overwritten"),
        (Service::Unseen, "nothing will send"),
        (Service::HalfSeen, "nothing will send"),
        (Service::Preempting, "free to be overwritten"),
    ]);
}

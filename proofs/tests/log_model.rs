//! T13, every interleaving of the log's writer and its transmitter: the core's own queue and transmitter
//! between the robot's priority and the DMA of USART1, as `fw-pac/src/uart.rs` joins them.
//!
//! The stream's registers are a model: before and after each access the DMA may move a byte, end or fail, and
//! its interrupt may become pending. A line enters the queue in one step, for nothing at its priority comes
//! between its bytes; what the DMA has in hand is compared before and after, so it does not matter when
//! within the step it reads. What it does between two accesses of one call is an event's script.
//!
//! `cargo test -p proofs --test log_model -- --nocapture` shows the way to each broken invariant.

use std::fmt;
use std::hash::{Hash, Hasher};
use std::ptr;

use fw_core::log::{Level, Log};
use fw_core::transmitter::{Stream, Transmitter};
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

/// What the robot's priority does.
#[derive(Clone, Debug, PartialEq, Eq, Hash)]
enum Handler {
    Idle,
    /// `PendSV`, at its events: a tick, frames.
    Writing,
    /// Within a line: seen only where something may come between, see [`Service::Preempting`].
    WithinLine(Text),
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

/// The stream's registers, and the far end.
#[derive(Clone, PartialEq, Eq, Hash)]
struct Dma {
    /// The transfer, while the stream is enabled.
    stream: Option<Transfer>,
    complete: bool,
    failed: bool,
    /// Its interrupt is pending.
    pending: bool,
    reader: Reader,
    failures: u8,
}

impl Dma {
    /// Bytes still to be moved.
    fn rest(&self) -> usize {
        self.stream.map_or(0, |stream| stream.len - stream.moved)
    }

    fn move_byte(&mut self, log: &Log<QUEUE>) -> Result<(), String> {
        let Some(stream) = &mut self.stream else {
            return Ok(());
        };
        let byte = byte_at(log, stream.offset + stream.moved);
        stream.moved += 1;
        if stream.moved == stream.len {
            self.stream = None;
            self.complete = true;
        }
        let byte = byte.ok_or("the stream reads what is not in the queue any more")?;
        self.reader.read(byte)
    }

    fn refuse(&mut self) {
        self.failures += 1;
        self.failed = true;
        self.reader.doubtful = true;
        self.reader.lossy = true;
        self.stream = None;
    }
}

/// The registers while the transmitter uses them.
struct Registers<'a> {
    service: Service,
    dma: &'a mut Dma,
    /// What the stream reads; the queue is unchanged as long as it does.
    memory: &'a Log<QUEUE>,
    /// The queue's address.
    base: usize,
    /// What the DMA does before each access but the first, where it can: nothing, so many bytes, or one
    /// more than there are: an error. Its end is without effect; and how many choices there were.
    script: &'a [usize],
    choices: Vec<usize>,
    accessed: bool,
    broken: Result<(), String>,
}

impl Registers<'_> {
    fn meanwhile(&mut self) {
        // Before the first access it is an event of its own.
        let first = !std::mem::replace(&mut self.accessed, true);
        let rest = self.dma.rest();
        if first || rest == 0 {
            return;
        }
        let choice = self.script.get(self.choices.len()).copied();
        let may_fail = usize::from(self.dma.failures < FAILURES);
        self.choices.push(1 + rest + may_fail);
        match choice.unwrap_or(0) {
            error if error > rest => self.dma.refuse(),
            bytes => {
                for _ in 0..bytes {
                    let moved = self.dma.move_byte(self.memory);
                    self.broken = self.broken.clone().and(moved);
                }
            }
        }
        self.service.raise(self.dma);
    }
}

impl Stream for Registers<'_> {
    fn failed(&mut self) -> bool {
        self.meanwhile();
        self.dma.failed
    }

    fn complete(&mut self) -> bool {
        self.meanwhile();
        self.dma.complete || self.service == Service::Impatient
    }

    fn stop(&mut self) {
        self.meanwhile();
        self.dma.stream = None;
    }

    fn clear(&mut self) {
        self.meanwhile();
        self.service.clear(self.dma);
    }

    fn send(&mut self, bytes: &[u8]) {
        self.meanwhile();
        self.service.clear(self.dma);
        self.dma.stream = Some(Transfer {
            offset: bytes.as_ptr() as usize - self.base,
            len: bytes.len(),
            moved: 0,
        });
    }
}

#[derive(Clone)]
struct State {
    log: Log<QUEUE>,
    transmitter: Transmitter,
    handler: Handler,
    /// What the writer has of the queue while a line is under way, see [`Service::Preempting`].
    working_copy: Option<Box<Log<QUEUE>>>,
    dma: Dma,
    written: u8,
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
            (&self.transmitter, &self.handler, &self.dma, self.written),
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
            "queue {:?}, {} dropped, {:?}; {:?}{}; ",
            String::from_utf8_lossy(self.log.pending()),
            self.log.dropped(),
            self.transmitter,
            self.handler,
            if self.dma.pending {
                ", interrupt pending"
            } else {
                ""
            },
        )?;
        match self.dma.stream {
            None => write!(f, "stream off")?,
            Some(Transfer { offset, len, moved }) => {
                write!(f, "stream at {moved} of {len} from {offset}")?;
            }
        }
        let reader = &self.dma.reader;
        write!(
            f,
            "{}{}; read {} lines and {:?}",
            if self.dma.complete { " complete" } else { "" },
            if self.dma.failed { " failed" } else { "" },
            reader.lines,
            String::from_utf8_lossy(&reader.line[..reader.len]),
        )
    }
}

#[derive(Clone, Debug)]
enum Event {
    /// The robot has something to do.
    Begin,
    /// It writes a line.
    Line(Text),
    /// The line is in the queue.
    LineEnd,
    /// It has done everything, and sees to the transmitter: what the DMA does meanwhile.
    End(Vec<usize>),
    /// The stream's interrupt is taken: what the DMA does meanwhile.
    Interrupt(Vec<usize>),
    /// The stream moves a byte to the transmitter.
    Move,
    /// The bus refuses the stream an access.
    Refuse,
}

/// The registers and the interrupt, as they are or broken on purpose.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
enum Service {
    Right,
    /// A transfer counts as complete at once.
    Impatient,
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
    /// The transmitter's service with a script; how many choices the DMA had each time.
    fn serve(self, next: &mut State, script: &[usize]) -> Result<Vec<usize>, String> {
        let memory = next.log.clone();
        let mut registers = Registers {
            service: self,
            dma: &mut next.dma,
            memory: &memory,
            base: ptr::from_ref(&next.log) as usize,
            script,
            choices: Vec::new(),
            accessed: false,
            broken: Ok(()),
        };
        next.transmitter.service(&mut next.log, &mut registers);
        registers.broken.clone()?;
        let choices = registers.choices;
        self.raise(&mut next.dma);
        Ok(choices)
    }

    /// Every script that makes a difference.
    fn scripts(self, state: &State) -> Vec<Vec<usize>> {
        let (mut scripts, mut script) = (Vec::new(), Vec::new());
        loop {
            let choices = self.serve(&mut state.clone(), &script).unwrap_or_default();
            script.resize(choices.len(), 0);
            scripts.push(script.clone());
            let others = |&at: &usize| script[at] + 1 < choices[at];
            let Some(last) = (0..choices.len()).rev().find(others) else {
                return scripts;
            };
            script[last] += 1;
            script.truncate(last + 1);
        }
    }

    fn clear(self, dma: &mut Dma) {
        if self != Self::KeepingFlags {
            dma.complete = false;
            dma.failed = false;
        }
    }

    /// A flag that stands raises the interrupt: when the stream ends, and when a handler does.
    fn raise(self, dma: &mut Dma) {
        dma.pending |= match self {
            Self::Unseen => false,
            Self::HalfSeen => dma.complete,
            _ => dma.complete || dma.failed,
        };
    }
}

/// What must hold of every step.
fn check(state: &State, next: &State) -> Result<(), String> {
    // Whatever the stream has still to read is as it was when it was handed over.
    if let (Some(_), Some(hand)) = (state.dma.stream, next.dma.stream) {
        for at in hand.offset + hand.moved..hand.offset + hand.len {
            if byte_at(&next.log, at).is_none() {
                return Err("bytes that the stream has in hand are free to be overwritten".into());
            }
            if state.dma.stream == next.dma.stream
                && byte_at(&state.log, at) != byte_at(&next.log, at)
            {
                return Err("bytes were changed while the stream had them in hand".into());
            }
        }
    }
    let idle = next.handler == Handler::Idle && !next.dma.pending;
    if idle && next.dma.stream.is_none() {
        // Nothing will happen until the robot has something to do.
        if !next.log.pending().is_empty() {
            return Err("lines wait and nothing will send them".into());
        }
        let (read, dropped) = (next.dma.reader, next.log.dropped());
        let accounted = u32::from(read.lines) + dropped == u32::from(next.written);
        if next.dma.failures == 0 && !(accounted && u32::from(read.reported) == dropped) {
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
            transmitter: Transmitter::IDLE,
            handler: Handler::Idle,
            working_copy: None,
            dma: Dma {
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
                failures: 0,
            },
            written: 0,
        }]
    }

    fn events(&self, state: &State) -> Vec<Event> {
        let mut events = Vec::new();
        // The stream goes on whatever the processor does.
        if state.dma.stream.is_some() {
            events.push(Event::Move);
            if state.dma.failures < FAILURES {
                events.push(Event::Refuse);
            }
        }
        // One priority: what runs at it runs to its end, unless that is what is broken.
        let between = state.handler == Handler::Idle || *self == Self::Preempting;
        if state.dma.pending && between {
            events.extend(self.scripts(state).into_iter().map(Event::Interrupt));
        }
        match state.handler {
            Handler::Idle if state.written < LINES => events.push(Event::Begin),
            Handler::Idle => {}
            Handler::Writing => {
                if state.written < LINES {
                    events.push(Event::Line(Text::Short));
                    events.push(Event::Line(Text::Long));
                }
                events.extend(self.scripts(state).into_iter().map(Event::End));
            }
            Handler::WithinLine(_) => events.push(Event::LineEnd),
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
        match event {
            Event::Begin => next.handler = Handler::Writing,
            Event::Line(text) if *self == Self::Preempting => {
                next.working_copy = Some(Box::new(next.log.clone()));
                next.handler = Handler::WithinLine(*text);
            }
            Event::Line(text) => {
                write(&mut next.log, *text);
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
            Event::End(script) => {
                self.serve(&mut next, script)?;
                next.handler = Handler::Idle;
            }
            Event::Interrupt(script) => {
                next.dma.pending = false;
                self.serve(&mut next, script)?;
            }
            Event::Move => {
                next.dma.move_byte(&state.log)?;
                self.raise(&mut next.dma);
            }
            Event::Refuse => {
                next.dma.refuse();
                self.raise(&mut next.dma);
            }
        }
        check(state, &next)?;
        let read = &next.dma.reader;
        // Dropped, reported, and more lines after that, one across the ring's end; a transfer failed.
        let rare = next.dma.failures > 0 && !read.doubtful && read.reported > 0;
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
        (Service::KeepingFlags, "free to be overwritten"),
        (Service::Unseen, "nothing will send"),
        (Service::HalfSeen, "nothing will send"),
        (Service::Preempting, "free to be overwritten"),
    ]);
}

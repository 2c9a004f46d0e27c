//! Instruction and time measurements of a run: every event is stamped with the virtual time and the
//! number of instructions retired before it.
//!
//! # Method
//! - Instructions of a function: [`Board::trace`](crate::Board::trace) finds the function in the
//!   ELF's symbol table, decodes its Thumb code and watches its first instruction and every
//!   instruction it returns by (`bx`, `pop {…, pc}`, `ldr pc`); a tail call is followed into the
//!   function it jumps to. [`spans`] pairs each entry with the next return: instructions from entry
//!   to return, both included, with whatever pre-empts the function. Entry to and return from an
//!   exception cost time, but no instruction.
//! - Between a pin and a register: [`Board::trace_chip_select`](crate::Board::trace_chip_select)
//!   records the chip select's edges, [`Board::trace_writes`](crate::Board::trace_writes) every
//!   write to a register.
//! - Memory at a register's accesses: [`Board::trace_memory`](crate::Board::trace_memory).
//! - Instructions per callee: [`Board::profile`](crate::Board::profile) watches every instruction
//!   of the firmware; [`shares`] counts those within the function's runs.
//!
//! The core retires [`Options::mips`](crate::Options::mips) instructions a microsecond of virtual time while
//! it is awake, so a span's virtual time follows from its instructions unless the core sleeps in it.

mod cycles;
mod symbols;
mod thumb;
mod tracer;

pub use cycles::cycles;
pub use symbols::{Function, Instruction, TraceError, TracedFunction, functions};
pub(crate) use tracer::Tracer;

/// What happened.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum EventKind {
    /// The core arrived at a watched instruction, before it executes.
    Reached {
        /// The instruction's address.
        address: u64,
    },
    /// The firmware wrote a traced register.
    Write {
        /// The register's address.
        address: u64,
        /// The value written.
        value: u64,
    },
    /// The Pi's chip select changed: `true` selects.
    ChipSelect(bool),
}

/// Something that happened, and when.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct Event {
    /// What.
    pub kind: EventKind,
    /// Nanoseconds of virtual time.
    pub at_ns: u64,
    /// Instructions retired before it.
    pub instructions: u64,
}

/// A standstill of the core.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct Stall {
    /// The instruction before which the core stands still.
    pub address: u64,
    /// Arrivals before that.
    pub skip: u64,
    /// For how many nanoseconds; 0 once it is over.
    pub ns: u64,
}

impl Stall {
    /// How long the core stands still on its arrival at `address`, nanoseconds.
    pub(crate) fn ns_at(&mut self, address: u64) -> u64 {
        if address != self.address {
            0
        } else if self.skip > 0 {
            self.skip -= 1;
            0
        } else {
            std::mem::take(&mut self.ns)
        }
    }
}

/// Memory at an access of the firmware to a register.
#[derive(Clone, Debug, PartialEq, Eq)]
pub struct Snapshot {
    /// Nanoseconds of virtual time.
    pub at_ns: u64,
    /// The register's address.
    pub register: u64,
    /// Whether it was written, not read …
    pub written: bool,
    /// … and its value.
    pub value: u64,
    /// The address of the accessing instruction.
    pub instruction: u64,
    /// The memory's bytes.
    pub bytes: Vec<u8>,
}

impl Event {
    /// The address of the instruction reached, if this is one.
    fn reached(&self) -> Option<u64> {
        match self.kind {
            EventKind::Reached { address } => Some(address),
            _ => None,
        }
    }
}

/// One run through a function.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub struct Span {
    /// When it was entered, nanoseconds of virtual time.
    pub entered_ns: u64,
    /// Instructions retired before its first.
    pub entered: u64,
    /// Instructions it took, the first and the last included.
    pub instructions: u64,
}

/// The complete runs through `traced` in `events`.
pub fn spans(traced: &TracedFunction, events: &[Event]) -> Vec<Span> {
    let functions = &traced.functions;
    let mut open: Option<(Event, &Function)> = None;
    let mut spans = Vec::new();
    for event in events {
        let Some(address) = event.reached() else {
            continue;
        };
        if address == functions[0].address {
            open = Some((*event, &functions[0]));
        }
        let Some((entry, current)) = open else {
            continue;
        };
        let jump = current.tail_calls.iter().find(|(at, _)| *at == address);
        let callee = jump.and_then(|(_, to)| functions.iter().find(|f| f.address == *to));
        if let Some(callee) = callee {
            open = Some((entry, callee));
        } else if current.returns.contains(&address) {
            open = None;
            spans.push(Span {
                entered_ns: entry.at_ns,
                entered: entry.instructions,
                instructions: event.instructions - entry.instructions + 1,
            });
        }
    }
    spans
}

/// The same runs without the instructions of the runs in `inner` inside them: the function's own
/// cost where the handlers that pre-empt it are traced too.
pub fn exclusive(spans: &[Span], inner: &[Span]) -> Vec<Span> {
    let own = |span: &Span| {
        let range = span.entered + 1..span.entered + span.instructions;
        let inside = inner.iter().filter(|other| range.contains(&other.entered));
        let inside: u64 = inside.map(|other| other.instructions).sum();
        Span {
            instructions: span.instructions.saturating_sub(inside),
            ..*span
        }
    };
    spans.iter().map(own).collect()
}

/// How many of the instructions within `runs` each function executed itself, most first.
pub fn shares(functions: &[Function], runs: &[Span], events: &[Event]) -> Vec<(String, u64)> {
    let mut counts = vec![0; functions.len()];
    let mut runs = runs.iter().peekable();
    for event in events {
        let Some(address) = event.reached() else {
            continue;
        };
        let is_over = |run: &&Span| run.entered + run.instructions <= event.instructions;
        while runs.next_if(is_over).is_some() {}
        if runs
            .peek()
            .is_none_or(|run| event.instructions < run.entered)
        {
            continue;
        }
        let after = functions.partition_point(|function| function.address <= address);
        if let Some(at) = after.checked_sub(1) {
            counts[at] += 1;
        }
    }
    let names = functions.iter().map(|function| short(&function.name));
    let mut shares: Vec<_> = names.zip(counts).filter(|share| share.1 > 0).collect();
    shares.sort_by(|a, b| b.1.cmp(&a.1).then_with(|| a.0.cmp(&b.0)));
    shares
}

/// The last two parts of a path: type and method.
fn short(path: &str) -> String {
    let from = path.rmatch_indices("::").nth(1).map_or(0, |(at, _)| at + 2);
    path[from..].to_owned()
}

#[cfg(test)]
mod tests {
    use super::*;

    fn reached(address: u64, instructions: u64) -> Event {
        Event {
            kind: EventKind::Reached { address },
            at_ns: instructions * 10,
            instructions,
        }
    }

    fn function(name: &str, address: u64, returns: &[u64], tail_calls: &[(u64, u64)]) -> Function {
        Function {
            name: name.into(),
            address,
            returns: returns.to_vec(),
            tail_calls: tail_calls.to_vec(),
            ..Function::default()
        }
    }

    fn span(entered: u64, instructions: u64) -> Span {
        Span {
            entered,
            instructions,
            ..Span::default()
        }
    }

    #[test]
    fn span_covers_entry_to_return() {
        let traced = TracedFunction {
            functions: vec![function("handler", 0x100, &[0x110, 0x11E], &[])],
        };
        let events = [(0x110, 5), (0x100, 10), (0x11E, 19), (0x110, 25)];
        let spans = spans(&traced, &events.map(|(address, nth)| reached(address, nth)));
        assert_eq!(spans.len(), 1);
        assert_eq!(spans[0].instructions, 10);
        assert_eq!(spans[0].entered_ns, 100);
    }

    #[test]
    fn span_of_tail_call_ends_with_callee() {
        let traced = TracedFunction {
            functions: vec![
                function("handler", 0x100, &[], &[(0x11C, 0x200)]),
                function("callee", 0x200, &[0x20E], &[]),
            ],
        };
        let events = [(0x20E, 1), (0x100, 10), (0x11C, 12), (0x20E, 14)];
        let spans = spans(&traced, &events.map(|(address, nth)| reached(address, nth)));
        assert_eq!(spans[0].instructions, 5);
    }

    #[test]
    fn shares_count_own_instructions_within_runs() {
        let functions = [
            function("a::b::caller", 0x100, &[], &[]),
            function("callee", 0x200, &[], &[]),
        ];
        let addresses = [0x204, 0x100, 0x200, 0x202, 0x102, 0x204, 0x100];
        let events: Vec<Event> = (7..)
            .zip(addresses)
            .map(|(nth, address)| reached(address, nth))
            .collect();
        let shares = shares(&functions, &[span(8, 4), span(13, 1)], &events);
        assert_eq!(shares, [("b::caller".into(), 3), ("callee".into(), 2)]);
    }

    #[test]
    fn exclusive_subtracts_preempting_runs() {
        let rest = exclusive(
            &[span(100, 50), span(200, 10)],
            &[span(120, 20), span(300, 5)],
        );
        assert_eq!((rest[0].instructions, rest[1].instructions), (30, 10));
    }
}

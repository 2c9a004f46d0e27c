//! What a run costs: every event is stamped with the virtual time and the count of instructions
//! retired before it.
//!
//! # Method
//! - A function's instructions: [`Board::trace`](crate::Board::trace) finds the function in the
//!   ELF's symbol table, decodes its Thumb code and watches its first instruction and every
//!   instruction it returns by (`bx`, `pop {…, pc}`, `ldr pc`); a tail call is followed into the
//!   function it jumps to. [`spans`] pairs each arrival at the first with the next arrival at one
//!   of the last: instructions from entry to return, both included, with whatever pre-empted the
//!   function on its way. Entry to and return from an exception cost no instruction.
//! - Between a wire and a register: [`Board::follow_select`](crate::Board::follow_select) records
//!   the chip select's edges, [`Board::follow_writes`](crate::Board::follow_writes) every write to
//!   a register.
//! - Where a function's instructions go: [`Board::profile`](crate::Board::profile) watches every
//!   instruction of the firmware; [`shares`] counts those within the function's runs, each for the
//!   function whose code it is. What pre-empts a run is listed beside it.
//!
//! The core retires one instruction for each 10 ns of virtual time while it is awake
//! ([`crate::virtual_board::INSTRUCTIONS_PER_SECOND`]), so a span's virtual time is its instructions'
//! unless the core slept inside it.

mod symbols;
mod thumb;

pub use symbols::{code, Code, Function, NoFunction};

/// What happened.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum What {
    /// The core arrived at a watched instruction, before it runs.
    Arrived {
        /// The instruction's address.
        address: u64,
    },
    /// The firmware wrote a followed register.
    Wrote {
        /// The register's address.
        address: u64,
        /// What it wrote.
        value: u64,
    },
    /// The Pi's chip select changed: `true` selects.
    Select(bool),
}

/// Something that happened, and when.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct Event {
    /// What.
    pub what: What,
    /// Nanoseconds of virtual time.
    pub at_ns: u64,
    /// Instructions retired before it.
    pub instructions: u64,
}

/// One run through a function.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct Span {
    /// When it was entered, nanoseconds of virtual time.
    pub entered_ns: u64,
    /// When it returned.
    pub left_ns: u64,
    /// Instructions retired before its first.
    pub entered: u64,
    /// Instructions it took, the first and the last included.
    pub instructions: u64,
}

/// The runs through `function` that `events` show from beginning to end.
#[must_use]
pub fn spans(function: &Function, events: &[Event]) -> Vec<Span> {
    let mut open: Option<(Event, &Function)> = None;
    let mut spans = Vec::new();
    for event in events {
        let What::Arrived { address } = event.what else {
            continue;
        };
        if address == function.address {
            open = Some((*event, function));
            // A function of one instruction is its own return.
        }
        let Some((entry, current)) = open else {
            continue;
        };
        if let Some(callee) = current.tail_call(address) {
            open = Some((entry, callee));
        } else if current.returns.contains(&address) {
            open = None;
            spans.push(Span {
                entered_ns: entry.at_ns,
                left_ns: event.at_ns,
                entered: entry.instructions,
                instructions: event.instructions - entry.instructions + 1,
            });
        }
    }
    spans
}

/// The same runs without the instructions of the runs in `inner` that lie inside them: what a
/// function takes itself when the handlers that pre-empt it are traced as well.
#[must_use]
pub fn without(spans: &[Span], inner: &[Span]) -> Vec<Span> {
    spans
        .iter()
        .map(|span| {
            let ends = span.entered + span.instructions;
            let inside: u64 = inner
                .iter()
                .filter(|other| span.entered < other.entered && other.entered < ends)
                .map(|other| other.instructions)
                .sum();
            Span {
                instructions: span.instructions.saturating_sub(inside),
                ..*span
            }
        })
        .collect()
}

/// How many of the instructions within `runs` each function executed itself, most first.
#[must_use]
pub fn shares(code: &[Code], runs: &[Span], events: &[Event]) -> Vec<(String, u64)> {
    let mut counts = vec![0; code.len()];
    let mut runs = runs.iter();
    let mut run = runs.next();
    for event in events {
        let What::Arrived { address } = event.what else {
            continue;
        };
        while run.is_some_and(|run| run.entered + run.instructions <= event.instructions) {
            run = runs.next();
        }
        if run.is_none_or(|run| event.instructions < run.entered) {
            continue;
        }
        let after = code.partition_point(|code| code.address <= address);
        if let Some(at) = after.checked_sub(1) {
            counts[at] += 1;
        }
    }
    let names = code.iter().map(|code| code.name.clone());
    let mut shares: Vec<_> = names.zip(counts).filter(|share| share.1 > 0).collect();
    shares.sort_by(|a, b| b.1.cmp(&a.1).then_with(|| a.0.cmp(&b.0)));
    shares
}

#[cfg(test)]
mod tests {
    use super::*;

    fn arrived(address: u64, instructions: u64) -> Event {
        Event {
            what: What::Arrived { address },
            at_ns: instructions * 10,
            instructions,
        }
    }

    #[test]
    fn a_span_runs_from_the_first_instruction_to_the_return() {
        let function = Function {
            name: "handler".into(),
            address: 0x100,
            size: 0x20,
            returns: vec![0x110, 0x11E],
            tail_calls: Vec::new(),
        };
        let events = [
            arrived(0x110, 5),
            arrived(0x100, 10),
            arrived(0x11E, 19),
            arrived(0x110, 25),
        ];
        let spans = spans(&function, &events);
        assert_eq!(spans.len(), 1);
        assert_eq!(spans[0].instructions, 10);
        assert_eq!((spans[0].entered_ns, spans[0].left_ns), (100, 190));
    }

    #[test]
    fn shares_count_each_functions_own_instructions_within_the_runs() {
        let code = |name: &str, address| Code {
            name: name.into(),
            address,
            size: 8,
            instructions: Vec::new(),
        };
        let span = |entered, instructions| Span {
            entered_ns: 0,
            left_ns: 0,
            entered,
            instructions,
        };
        let code = [code("caller", 0x100), code("callee", 0x200)];
        let events: Vec<Event> = [0x204, 0x100, 0x200, 0x202, 0x102, 0x204, 0x100]
            .iter()
            .zip(7..)
            .map(|(address, instructions)| arrived(*address, instructions))
            .collect();
        let shares = shares(&code, &[span(8, 4), span(13, 1)], &events);
        assert_eq!(shares, [("caller".into(), 3), ("callee".into(), 2)]);
    }

    #[test]
    fn what_pre_empts_a_function_can_be_taken_out() {
        let span = |entered, instructions| Span {
            entered_ns: 0,
            left_ns: 0,
            entered,
            instructions,
        };
        let outer = [span(100, 50), span(200, 10)];
        let rest = without(&outer, &[span(120, 20), span(300, 5)]);
        assert_eq!((rest[0].instructions, rest[1].instructions), (30, 10));
    }

    #[test]
    fn a_tail_call_returns_where_its_callee_does() {
        let callee = Function {
            name: "callee".into(),
            address: 0x200,
            size: 0x10,
            returns: vec![0x20E],
            tail_calls: Vec::new(),
        };
        let function = Function {
            name: "handler".into(),
            address: 0x100,
            size: 0x20,
            returns: Vec::new(),
            tail_calls: vec![(0x11C, callee)],
        };
        let events = [
            arrived(0x20E, 1),
            arrived(0x100, 10),
            arrived(0x11C, 12),
            arrived(0x20E, 14),
        ];
        assert_eq!(spans(&function, &events)[0].instructions, 5);
    }
}

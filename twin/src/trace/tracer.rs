//! What is traced of a run, and what it has recorded.

use std::collections::{BTreeSet, HashSet};
use std::ops::Range;

use rigless::emulator::{Access, AccessKind, Host};
use rigless::soc::Width;
use rigless::time::VirtualNanos;

use super::{Event, EventKind, Snapshot, Stall};

/// What an exception costs beside its handler's instructions, nanoseconds: 12 cycles to enter and 10, of up to 12, to
/// return (Cortex-M4 TRM, DDI 0439B, 3.9.1) at 100 MHz, both before the handler's first instruction.
const EXCEPTION_NS: u64 = 220;

/// What is traced, and the events so far.
#[derive(Debug, Default)]
pub struct Tracer {
    /// Registers whose writes are recorded.
    pub registers: Vec<u64>,
    /// Whether the chip select's edges are recorded.
    pub chip_select: bool,
    /// The events.
    pub events: Vec<Event>,
    /// Registers at whose accesses the memory in [`Tracer::memory`] is recorded.
    pub triggers: Vec<u64>,
    /// That memory.
    pub memory: Range<u64>,
    /// The records.
    pub snapshots: Vec<Snapshot>,
    /// Where the core stands still.
    pub stall: Option<Stall>,
    /// Whether the core is held beside that.
    pub held: bool,
    /// First instructions of the exceptions' handlers.
    pub handlers: BTreeSet<u64>,
    /// Instructions at which an arrival is recorded.
    pub instructions: HashSet<u64>,
}

impl Tracer {
    pub fn record(&mut self, kind: EventKind, at: VirtualNanos, instructions: u64) {
        self.events.push(Event {
            kind,
            at_ns: at.0,
            instructions,
        });
    }

    /// How long the core stands still on its arrival at `address`, nanoseconds.
    pub fn stall_ns(&mut self, address: u64) -> u64 {
        let exception = u64::from(self.handlers.contains(&address)) * EXCEPTION_NS;
        exception + self.stall.as_mut().map_or(0, |stall| stall.ns_at(address))
    }

    /// Whether an arrival at `address` matters, a stall aside.
    pub fn watches(&self, address: u64) -> bool {
        self.handlers.contains(&address) || self.instructions.contains(&address)
    }

    /// Records the memory before what the core does after `access`.
    pub fn take_snapshot(&mut self, access: &Access, value: u64, host: &mut dyn Host) {
        let byte = |address| host.read(address, Width::W8).ok();
        let bytes = self.memory.clone().filter_map(byte);
        self.snapshots.push(Snapshot {
            at_ns: access.virtual_time.0,
            register: access.address,
            written: access.kind == AccessKind::Write,
            value,
            instruction: access.program_counter.unwrap_or_default(),
            bytes: bytes.filter_map(|byte| byte.try_into().ok()).collect(),
        });
    }
}

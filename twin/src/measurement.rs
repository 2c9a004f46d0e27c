//! Measurements on a running board: traces ([`crate::trace`] has the method) and memory.

use std::ops::Range;

use rigless::emulator::Watch;
use rigless::soc::Width;

use crate::board::Board;
use crate::trace::{Event, Function, Snapshot, Stall, TraceError, TracedFunction, functions};

#[expect(
    clippy::missing_panics_doc,
    reason = "the type's documentation says when every method panics"
)]
impl Board {
    /// Traces every run through the function `name` from now on: [`crate::trace`].
    ///
    /// # Errors
    /// When the firmware has no such function.
    pub fn trace(&self, name: &str) -> Result<TracedFunction, TraceError> {
        let function = TracedFunction::find(&self.elf, name)?;
        self.watch(function.watched().into_iter().collect());
        Ok(function)
    }

    /// Traces every instruction of the firmware from now on: [`crate::trace::shares`]. Slow.
    ///
    /// # Errors
    /// When the firmware's ELF file cannot be read.
    pub fn profile(&self) -> Result<Vec<Function>, TraceError> {
        let functions = functions(&self.elf)?;
        let all = functions.iter().flat_map(|f| &f.instructions);
        self.watch(all.map(|one| one.address).collect());
        Ok(functions)
    }

    fn watch(&self, instructions: Vec<u64>) {
        self.stopped(move |stopped| {
            for &address in &instructions {
                stopped.session.watch(Watch::Instruction(address));
            }
            stopped.tracer.instructions.extend(instructions);
        });
    }

    /// Traces every write of the firmware to the register at `address` from now on.
    pub fn trace_writes(&self, address: u64) {
        self.stopped(move |stopped| stopped.tracer.registers.push(address));
    }

    /// Traces the chip select from now on.
    pub fn trace_chip_select(&self) {
        self.stopped(|stopped| {
            stopped.mcu().board.selects.clear();
            stopped.tracer.chip_select = true;
        });
    }

    /// Takes the events traced since the last call, in order.
    pub fn take_events(&self) -> Vec<Event> {
        self.stopped(|stopped| std::mem::take(&mut stopped.tracer.events))
    }

    /// Records `memory` at every access of the firmware to `registers` from now on.
    pub fn trace_memory(&self, registers: &[u64], memory: Range<u64>) {
        let triggers = registers.to_vec();
        self.stopped(move |stopped| {
            stopped.tracer.triggers = triggers;
            stopped.tracer.memory = memory;
        });
    }

    /// Takes the records of [`Board::trace_memory`] since the last call, in order.
    #[must_use]
    pub fn take_snapshots(&self) -> Vec<Snapshot> {
        self.stopped(|stopped| std::mem::take(&mut stopped.tracer.snapshots))
    }

    /// Stops the core for `ns` nanoseconds when it has arrived at the instruction at `address` `skip` times
    /// from now and arrives again; the peripherals and the board go on meanwhile. In place of an earlier stall.
    pub fn stall_once(&self, address: u64, skip: u64, ns: u64) {
        self.stopped(move |stopped| {
            let stall = Stall { address, skip, ns };
            let before = stopped.tracer.stall.replace(stall);
            if let Some(before) = before.filter(|one| !stopped.tracer.watches(one.address)) {
                let watch = Watch::Instruction(before.address);
                stopped.session.unwatch(watch);
            }
            stopped.session.watch(Watch::Instruction(address));
        });
    }

    /// The words in memory from `address` on, as a debugger reads them. Panics where there is no
    /// memory.
    pub fn words(&self, address: u64, count: u64) -> Vec<u32> {
        self.stopped(move |stopped| {
            let word = |nth| {
                let word = stopped.host.read(address + 4 * nth, Width::W32);
                let word = word.unwrap_or_else(|error| panic!("{address:#x}: {error}"));
                u32::try_from(word).expect("32 bits")
            };
            (0..count).map(word).collect()
        })
    }

    /// Fills RAM with a byte, to find later what the firmware has overwritten. Panics where there is
    /// no RAM.
    pub fn paint(&self, range: Range<u64>, byte: u8) {
        self.stopped(move |stopped| {
            for address in range {
                let written = stopped.host.write(address, Width::W8, byte.into());
                written.unwrap_or_else(|error| panic!("{address:#x}: {error}"));
            }
        });
    }

    /// How many bytes from the start of a painted range are still unchanged.
    pub fn painted(&self, range: Range<u64>, byte: u8) -> u64 {
        self.stopped(move |stopped| {
            let mut read = |address| stopped.host.read(address, Width::W8).ok();
            let changed = range.clone().find(|&at| read(at) != Some(byte.into()));
            changed.unwrap_or(range.end) - range.start
        })
    }
}

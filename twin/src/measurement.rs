//! Measurements on a running board: [`crate::trace`] says by which method.

use rigless::emulator::Watch;

use crate::board::Board;
use crate::trace::{functions, Event, Function, TraceError, TracedFunction};

impl Board {
    /// Traces every run through the function `name` from now on: [`crate::trace`].
    ///
    /// # Errors
    /// When the firmware has no such function.
    pub fn trace(&self, name: &str) -> Result<TracedFunction, TraceError> {
        let function = TracedFunction::find(&self.elf, name)?;
        self.watch(function.watched());
        Ok(function)
    }

    /// Traces every instruction of the firmware from now on: [`crate::trace::shares`]. Slow.
    ///
    /// # Errors
    /// When the firmware's ELF file cannot be read.
    pub fn profile(&self) -> Result<Vec<Function>, TraceError> {
        let functions = functions(&self.elf)?;
        let all = functions.iter().flat_map(|f| f.instructions.clone());
        self.watch(all.collect());
        Ok(functions)
    }

    fn watch(&self, instructions: Vec<u64>) {
        self.stopped(move |stopped| {
            for address in instructions {
                stopped.session.watch(Watch::Instruction(address));
            }
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
    #[must_use]
    pub fn take_events(&self) -> Vec<Event> {
        self.stopped(|stopped| std::mem::take(&mut stopped.tracer.events))
    }
}

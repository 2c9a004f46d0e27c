//! The Pi's SPI controller with the STM behind its chip select.

use embedded_hal::spi::{Error, ErrorKind, ErrorType, Operation, SpiDevice};

use crate::board::Board;
use crate::components::spi_master::{pack, Step};
use crate::emulator::Ended;

/// The timing of a transfer.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct SpiTiming {
    /// The clock, hertz.
    pub hz: u64,
    /// From the chip select's fall to the first bit, nanoseconds.
    pub setup_ns: u64,
    /// From the last bit to the chip select's rise, nanoseconds.
    pub hold_ns: u64,
    /// Nanoseconds that pass after a transfer before the call returns: what a driver takes at
    /// least before it can begin the next one.
    pub after_ns: u64,
}

impl Default for SpiTiming {
    fn default() -> Self {
        Self {
            hz: 8_000_000,
            setup_ns: 1_000,
            hold_ns: 1_000,
            after_ns: 20_000,
        }
    }
}

/// /dev/spidev0.0.
#[derive(Clone, Debug)]
pub struct Spi {
    board: Board,
    timing: SpiTiming,
}

/// The emulation has ended.
#[derive(Clone, Debug, PartialEq, Eq)]
pub struct SpiError(pub Ended);

impl From<Ended> for SpiError {
    fn from(ended: Ended) -> Self {
        Self(ended)
    }
}

impl std::fmt::Display for SpiError {
    fn fmt(&self, formatter: &mut std::fmt::Formatter<'_>) -> std::fmt::Result {
        self.0.fmt(formatter)
    }
}

impl std::error::Error for SpiError {}

impl Error for SpiError {
    fn kind(&self) -> ErrorKind {
        ErrorKind::Other
    }
}

impl Spi {
    pub(super) fn new(board: Board, timing: SpiTiming) -> Self {
        Self { board, timing }
    }

    fn step(&self, operation: &Operation<'_, u8>) -> Step {
        let hz = self.timing.hz;
        match operation {
            Operation::Read(into) => Step::bytes(&vec![0; into.len()], hz),
            Operation::Write(bytes) => Step::bytes(bytes, hz),
            Operation::Transfer(read, write) => {
                let mut bytes = write.to_vec();
                bytes.resize(read.len().max(write.len()), 0);
                Step::bytes(&bytes, hz)
            }
            Operation::TransferInPlace(bytes) => Step::bytes(bytes, hz),
            Operation::DelayNs(ns) => Step::Wait(u64::from(*ns)),
        }
    }
}

/// The clocks an operation takes.
fn bits(operation: &Operation<'_, u8>) -> usize {
    8 * match operation {
        Operation::Read(into) => into.len(),
        Operation::Write(bytes) => bytes.len(),
        Operation::Transfer(read, write) => read.len().max(write.len()),
        Operation::TransferInPlace(bytes) => bytes.len(),
        Operation::DelayNs(_) => 0,
    }
}

impl ErrorType for Spi {
    type Error = SpiError;
}

impl SpiDevice for Spi {
    fn transaction(&mut self, operations: &mut [Operation<'_, u8>]) -> Result<(), SpiError> {
        let mut steps = vec![Step::Select(true), Step::Wait(self.timing.setup_ns)];
        steps.extend(operations.iter().map(|operation| self.step(operation)));
        steps.extend([
            Step::Wait(self.timing.hold_ns),
            Step::Select(false),
            Step::Wait(self.timing.after_ns),
        ]);
        let disturbance = self.board.next_disturbance();
        if let Some(disturbance) = disturbance {
            disturbance.on_the_way_out(&mut steps);
        }
        let clocks: usize = operations.iter().map(|operation| bits(operation)).sum();
        let mut miso = self.board.spi_raw(steps)?;
        if let Some(disturbance) = disturbance {
            disturbance.on_the_way_back(&mut miso);
        }
        // A line nobody clocks any more reads low.
        miso.resize(clocks, false);
        let mut answer = pack(&miso).into_iter();
        for operation in operations {
            match operation {
                Operation::Read(into) | Operation::TransferInPlace(into) => {
                    for byte in into.iter_mut() {
                        *byte = answer.next().unwrap_or_default();
                    }
                }
                Operation::Transfer(read, write) => {
                    for at in 0..read.len().max(write.len()) {
                        let byte = answer.next().unwrap_or_default();
                        if let Some(slot) = read.get_mut(at) {
                            *slot = byte;
                        }
                    }
                }
                Operation::Write(bytes) => answer.by_ref().take(bytes.len()).for_each(drop),
                Operation::DelayNs(_) => {}
            }
        }
        Ok(())
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::Options;

    #[test]
    fn a_transfer_takes_its_time_and_nobody_answers_a_silent_wire() {
        let board = Board::new(&[], Options::default()).unwrap();
        board.hold_reset(true).unwrap();
        let before = board.now_ns();
        let mut bytes = [0xA5; 19];
        board.spi().transfer_in_place(&mut bytes).unwrap();
        assert_eq!(bytes, [0; 19]);
        let took = board.now_ns() - before;
        let wires = 1_000 + 19 * 1_000 + 1_000 + 20_000;
        assert!((wires..wires + 20).contains(&took), "{took}");
    }
}

//! The Pi's SPI controller with the STM behind its chip select.

use embedded_hal::spi::{Error, ErrorKind, ErrorType, Operation, SpiDevice};

use crate::board::Board;
use crate::components::spi_master::{SpiStep, pack};
use crate::emulator::EmulationEnded;

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
    pub(super) board: Board,
    pub(super) timing: SpiTiming,
}

impl Error for EmulationEnded {
    fn kind(&self) -> ErrorKind {
        ErrorKind::Other
    }
}

impl Spi {
    fn step(&self, operation: &Operation<'_, u8>) -> SpiStep {
        let hz = self.timing.hz;
        match operation {
            Operation::Read(into) => SpiStep::bytes(&vec![0; into.len()], hz),
            Operation::Write(bytes) => SpiStep::bytes(bytes, hz),
            Operation::Transfer(read, write) => {
                let mut bytes = write.to_vec();
                bytes.resize(read.len().max(write.len()), 0);
                SpiStep::bytes(&bytes, hz)
            }
            Operation::TransferInPlace(bytes) => SpiStep::bytes(bytes, hz),
            Operation::DelayNs(ns) => SpiStep::Wait(u64::from(*ns)),
        }
    }
}

impl ErrorType for Spi {
    type Error = EmulationEnded;
}

impl SpiDevice for Spi {
    fn transaction(&mut self, operations: &mut [Operation<'_, u8>]) -> Result<(), EmulationEnded> {
        let mut steps = vec![SpiStep::Select(true), SpiStep::Wait(self.timing.setup_ns)];
        steps.extend(operations.iter().map(|operation| self.step(operation)));
        steps.extend([
            SpiStep::Wait(self.timing.hold_ns),
            SpiStep::Select(false),
            SpiStep::Wait(self.timing.after_ns),
        ]);
        let received = pack(&self.board.try_spi_steps(steps)?);
        let mut received = received.into_iter();
        for operation in operations {
            match operation {
                Operation::Read(into) | Operation::TransferInPlace(into) => {
                    into.fill_with(|| received.next().unwrap_or_default());
                }
                Operation::Transfer(read, write) => {
                    let skipped = write.len().saturating_sub(read.len());
                    read.fill_with(|| received.next().unwrap_or_default());
                    received.by_ref().take(skipped).for_each(drop);
                }
                Operation::Write(bytes) => received.by_ref().take(bytes.len()).for_each(drop),
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
    fn transfer_takes_wire_time_and_undriven_miso_reads_zero() {
        let board = Board::new(&[], Options::default()).unwrap();
        board.hold_reset(true);
        let before = board.now_ns();
        let mut bytes = [0xA5; 19];
        board.spi().transfer_in_place(&mut bytes).unwrap();
        assert_eq!(bytes, [0; 19]);
        let elapsed = board.now_ns() - before;
        let wires = 1_000 + 19 * 1_000 + 1_000 + 20_000;
        assert!((wires..wires + 20).contains(&elapsed), "{elapsed}");
    }
}

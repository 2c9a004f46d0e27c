//! The Pi's I2C controller, byte by byte in virtual time.

use embedded_hal::i2c::{
    Error, ErrorKind, ErrorType, I2c as I2cTrait, NoAcknowledgeSource, Operation,
};

use crate::board::Board;
use crate::components::i2c_bus::{I2cBus, I2cController::Pi};
use crate::emulator::EmulationEnded;

/// Nanoseconds of a bit at 400 kHz.
const BIT_NS: u64 = 2_500;
/// A byte and its acknowledge.
const BYTE_NS: u64 = 9 * BIT_NS;

/// /dev/i2c-1.
#[derive(Clone, Debug)]
pub struct I2c(pub(super) Board);

/// A transfer failed.
#[derive(Clone, Debug, PartialEq, Eq, thiserror::Error)]
pub enum I2cError {
    /// No device at the address, or the EEPROM is busy with a write.
    #[error("the address is not acknowledged")]
    NoAddress,
    /// The EEPROM refused a byte: it is write-protected.
    #[error("a data byte is not acknowledged")]
    NoData,
    /// A device holds the data line low.
    #[error("the bus is held low")]
    Held,
    /// The emulation has ended.
    #[error(transparent)]
    Ended(#[from] EmulationEnded),
}

impl Error for I2cError {
    fn kind(&self) -> ErrorKind {
        match self {
            Self::NoAddress => ErrorKind::NoAcknowledge(NoAcknowledgeSource::Address),
            Self::NoData => ErrorKind::NoAcknowledge(NoAcknowledgeSource::Data),
            Self::Held => ErrorKind::Bus,
            Self::Ended(_) => ErrorKind::Other,
        }
    }
}

impl I2c {
    /// Lets virtual time pass, then acts on the bus.
    fn after<T: Send + 'static>(
        &self,
        ns: u64,
        act: impl FnOnce(&mut I2cBus, u64) -> T + Send + 'static,
    ) -> Result<T, I2cError> {
        self.0.try_run_ns(ns)?;
        Ok(self.0.try_stopped(|stopped| stopped.i2c_bus(act))?)
    }

    fn start(&self, address: u8, read: bool) -> Result<(), I2cError> {
        let start =
            move |bus: &mut I2cBus, now| (bus.is_sda_held(Pi), bus.start(Pi, now, address, read));
        match self.after(BIT_NS + BYTE_NS, start)? {
            (true, _) => Err(I2cError::Held),
            (_, true) => Ok(()),
            (_, false) => Err(I2cError::NoAddress),
        }
    }

    fn transfer(&self, operation: &mut Operation<'_>) -> Result<(), I2cError> {
        match operation {
            Operation::Read(buffer) => {
                for byte in buffer.iter_mut() {
                    *byte = self.after(BYTE_NS, |bus, _| bus.read(Pi))?;
                }
            }
            Operation::Write(bytes) => {
                for &byte in *bytes {
                    if !self.after(BYTE_NS, move |bus, _| bus.write(Pi, byte))? {
                        return Err(I2cError::NoData);
                    }
                }
            }
        }
        Ok(())
    }
}

impl ErrorType for I2c {
    type Error = I2cError;
}

impl I2cTrait for I2c {
    fn transaction(
        &mut self,
        address: u8,
        operations: &mut [Operation<'_>],
    ) -> Result<(), I2cError> {
        let mut direction = None;
        let mut outcome = Ok(());
        for operation in operations {
            let read = matches!(operation, Operation::Read(_));
            if direction != Some(read) {
                direction = Some(read);
                outcome = self.start(address, read);
            }
            outcome = outcome.and_then(|()| self.transfer(operation));
            if outcome.is_err() {
                break;
            }
        }
        self.after(BIT_NS, |bus, now| bus.stop(Pi, now))?;
        outcome
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::Options;
    use crate::components::eeprom::{ADDRESS, WRITE_CYCLE_NS};
    use crate::hal::Line;
    use embedded_hal::digital::OutputPin;

    /// A board in reset whose EEPROM is connected to the Pi.
    fn board() -> Board {
        let board = Board::new(&[], Options::default()).unwrap();
        board.hold_reset(true);
        board.switch_i2c(Pi);
        board
    }

    #[test]
    fn pi_reads_and_writes_eeprom_while_it_is_connected() {
        let board = board();
        let mut i2c = board.i2c();
        board.pin(Line::Select).set_low().unwrap();
        assert_eq!(i2c.write(ADDRESS, &[]), Err(I2cError::NoAddress));
        board.pin(Line::Select).set_high().unwrap();
        assert_eq!(i2c.write(ADDRESS, &[0, 4, 7]), Err(I2cError::NoData));
        board.pin(Line::WriteProtect).set_low().unwrap();
        i2c.write(ADDRESS, &[0, 4, 7, 8]).unwrap();
        assert_eq!(i2c.write(ADDRESS, &[]), Err(I2cError::NoAddress), "busy");
        board.try_run_ns(WRITE_CYCLE_NS).unwrap();
        let mut bytes = [0; 3];
        i2c.write_read(ADDRESS, &[0, 4], &mut bytes).unwrap();
        assert_eq!(bytes, [7, 8, 0xFF]);
    }

    #[test]
    fn byte_takes_nine_bits_of_virtual_time() {
        let board = board();
        let before = board.now_ns();
        board.i2c().write(ADDRESS, &[0, 0]).unwrap();
        assert_eq!(board.now_ns() - before, 3 * BYTE_NS + 2 * BIT_NS);
    }

    #[test]
    fn held_bus_is_reported() {
        let board = board();
        board.i2c_bus(|bus, _| bus.sda_held = 9);
        assert_eq!(board.i2c().write(ADDRESS, &[0, 0]), Err(I2cError::Held));
    }
}

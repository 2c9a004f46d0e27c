//! The Pi's I2C controller, byte by byte in virtual time.

use embedded_hal::i2c::{
    Error, ErrorKind, ErrorType, I2c as I2cTrait, NoAcknowledgeSource, Operation,
};

use crate::board::Board;
use crate::components::i2c_bus::Side;
use crate::emulator::Ended;

/// Nanoseconds of a bit at 400 kHz.
const BIT_NS: u64 = 2_500;
/// A byte and its acknowledge.
const BYTE_NS: u64 = 9 * BIT_NS;

/// /dev/i2c-1.
#[derive(Clone, Debug)]
pub struct I2c {
    board: Board,
}

/// A transfer failed.
#[derive(Clone, Debug, PartialEq, Eq)]
pub enum I2cError {
    /// Nobody at the address, or the EEPROM is busy with a write.
    NoAddress,
    /// The EEPROM refused a byte: it is write-protected.
    NoData,
    /// Somebody holds the data line low.
    Held,
    /// The emulation has ended.
    Ended(Ended),
}

impl From<Ended> for I2cError {
    fn from(ended: Ended) -> Self {
        Self::Ended(ended)
    }
}

impl std::fmt::Display for I2cError {
    fn fmt(&self, formatter: &mut std::fmt::Formatter<'_>) -> std::fmt::Result {
        match self {
            Self::NoAddress => write!(formatter, "the address is not acknowledged"),
            Self::NoData => write!(formatter, "a data byte is not acknowledged"),
            Self::Held => write!(formatter, "the bus is held low"),
            Self::Ended(ended) => ended.fmt(formatter),
        }
    }
}

impl std::error::Error for I2cError {}

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
    pub(super) fn new(board: Board) -> Self {
        Self { board }
    }

    fn start(&self, address: u8, read: bool) -> Result<(), I2cError> {
        self.board.try_run_ns(BIT_NS + BYTE_NS)?;
        let (held, acknowledged) = self.board.i2c_bus(move |bus, now| {
            (
                bus.is_stuck(Side::Pi),
                bus.start(Side::Pi, now, address, read),
            )
        })?;
        match (held, acknowledged) {
            (true, _) => Err(I2cError::Held),
            (_, true) => Ok(()),
            (_, false) => Err(I2cError::NoAddress),
        }
    }

    fn bytes(&self, operation: &mut Operation<'_>) -> Result<(), I2cError> {
        match operation {
            Operation::Read(buffer) => {
                for byte in buffer.iter_mut() {
                    self.board.try_run_ns(BYTE_NS)?;
                    *byte = self.board.i2c_bus(|bus, _| bus.read(Side::Pi))?;
                }
            }
            Operation::Write(bytes) => {
                for &byte in *bytes {
                    self.board.try_run_ns(BYTE_NS)?;
                    if !self
                        .board
                        .i2c_bus(move |bus, _| bus.write(Side::Pi, byte))?
                    {
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
            outcome = outcome.and_then(|()| self.bytes(operation));
            if outcome.is_err() {
                break;
            }
        }
        self.board.try_run_ns(BIT_NS)?;
        self.board.i2c_bus(|bus, now| bus.stop(Side::Pi, now))?;
        outcome
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::components::eeprom::{ADDRESS, WRITE_CYCLE_NS};
    use crate::Options;
    use embedded_hal::digital::OutputPin;

    /// A board whose microcontroller is out of the way.
    fn board() -> Board {
        let board = Board::new(&[], Options::default()).unwrap();
        board.hold_reset(true).unwrap();
        board
    }

    #[test]
    fn the_pi_reads_and_writes_while_the_switch_is_its() {
        let board = board();
        let mut i2c = board.i2c();
        assert_eq!(i2c.write(ADDRESS, &[]), Err(I2cError::NoAddress));
        board.pin_select().set_high().unwrap();
        assert_eq!(i2c.write(ADDRESS, &[0, 4, 7]), Err(I2cError::NoData));
        board.pin_wp().set_low().unwrap();
        i2c.write(ADDRESS, &[0, 4, 7, 8]).unwrap();
        assert_eq!(i2c.write(ADDRESS, &[]), Err(I2cError::NoAddress), "busy");
        board.try_run_ns(WRITE_CYCLE_NS).unwrap();
        let mut bytes = [0; 3];
        i2c.write_read(ADDRESS, &[0, 4], &mut bytes).unwrap();
        assert_eq!(bytes, [7, 8, 0xFF]);
    }

    #[test]
    fn a_byte_takes_nine_bits_of_virtual_time() {
        let board = board();
        board.pin_select().set_high().unwrap();
        let before = board.now_ns();
        board.i2c().write(ADDRESS, &[0, 0]).unwrap();
        assert_eq!(board.now_ns() - before, 3 * BYTE_NS + 2 * BIT_NS);
    }

    #[test]
    fn a_held_bus_is_an_error_of_its_own() {
        let board = board();
        board.pin_select().set_high().unwrap();
        board.faults().hold_i2c().unwrap();
        assert_eq!(board.i2c().write(ADDRESS, &[0, 0]), Err(I2cError::Held));
    }
}

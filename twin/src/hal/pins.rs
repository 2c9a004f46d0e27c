//! The Pi's GPIO lines to the board.

use embedded_hal::digital::{Error, ErrorKind, ErrorType, InputPin, OutputPin};

use crate::board::Board;
use crate::emulation::Ended;

/// Which line.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Line {
    /// The microcontroller's NRST, pulled up.
    Reset,
    /// The I2C switch, pulled down.
    Select,
    /// The EEPROM's WP, pulled up.
    WriteProtect,
    /// The firmware's READY, pulled down. An input: writing it is an error.
    Ready,
}

/// A line.
#[derive(Clone, Debug)]
pub struct Pin {
    board: Board,
    line: Line,
    driven: bool,
}

impl Pin {
    pub(super) fn new(board: Board, line: Line) -> Self {
        Self {
            board,
            line,
            driven: !matches!(line, Line::Select | Line::Ready),
        }
    }

    fn drive(&mut self, high: bool) -> Result<(), PinError> {
        match self.line {
            Line::Reset => {
                // Only the edges count: a line that stays low resets once.
                if self.driven != high {
                    self.board.hold_reset(!high)?;
                }
            }
            Line::Select => self.board.give_eeprom_to_pi(high)?,
            Line::WriteProtect => self.board.i2c_bus(move |bus, _| {
                if let Some(eeprom) = &mut bus.eeprom {
                    eeprom.protect(high);
                }
            })?,
            Line::Ready => return Err(PinError::IsAnInput),
        }
        self.driven = high;
        Ok(())
    }
}

/// A line cannot be driven.
#[derive(Clone, Debug, PartialEq, Eq)]
pub enum PinError {
    /// READY is the board's to drive.
    IsAnInput,
    /// The emulation has ended.
    Ended(Ended),
}

impl From<Ended> for PinError {
    fn from(ended: Ended) -> Self {
        Self::Ended(ended)
    }
}

impl std::fmt::Display for PinError {
    fn fmt(&self, formatter: &mut std::fmt::Formatter<'_>) -> std::fmt::Result {
        match self {
            Self::IsAnInput => write!(formatter, "the line is an input of the Pi"),
            Self::Ended(ended) => ended.fmt(formatter),
        }
    }
}

impl std::error::Error for PinError {}

impl Error for PinError {
    fn kind(&self) -> ErrorKind {
        ErrorKind::Other
    }
}

impl ErrorType for Pin {
    type Error = PinError;
}

impl OutputPin for Pin {
    fn set_low(&mut self) -> Result<(), PinError> {
        self.drive(false)
    }

    fn set_high(&mut self) -> Result<(), PinError> {
        self.drive(true)
    }
}

impl InputPin for Pin {
    fn is_high(&mut self) -> Result<bool, PinError> {
        match self.line {
            Line::Ready => Ok(self
                .board
                .try_with(|scene| scene.session.board().robot.is_ready())?),
            _ => Ok(self.driven),
        }
    }

    fn is_low(&mut self) -> Result<bool, PinError> {
        self.is_high().map(|high| !high)
    }
}

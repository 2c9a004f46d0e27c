//! The Pi's GPIO lines to the board.

use embedded_hal::digital::{Error, ErrorKind, ErrorType, InputPin, OutputPin};

use crate::board::Board;
use crate::components::eeprom::Eeprom;
use crate::components::i2c_bus::Side;
use crate::emulator::Ended;

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
}

impl Pin {
    pub(super) fn new(board: Board, line: Line) -> Self {
        Self { board, line }
    }

    fn drive(&self, high: bool) -> Result<(), PinError> {
        match self.line {
            Line::Reset => self.board.hold_reset(!high)?,
            Line::Select => self.board.give_eeprom_to_pi(high)?,
            Line::WriteProtect => self.board.i2c_bus(move |bus, _| {
                if let Some(eeprom) = &mut bus.eeprom {
                    eeprom.protect(high);
                }
            })?,
            Line::Ready => return Err(PinError::IsAnInput),
        }
        Ok(())
    }

    fn level(&self) -> Result<bool, Ended> {
        let line = self.line;
        self.board.try_with(move |scene| {
            let robot = &scene.session.board().robot;
            let bus = robot.around.i2c.lock();
            match line {
                Line::Reset => !robot.around.reset_low,
                Line::Select => bus.owner() == Side::Pi,
                Line::WriteProtect => bus.eeprom.as_ref().is_none_or(Eeprom::is_protected),
                Line::Ready => robot.is_ready(),
            }
        })
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
        Ok(self.level()?)
    }

    fn is_low(&mut self) -> Result<bool, PinError> {
        self.is_high().map(|high| !high)
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::Options;

    #[test]
    fn the_lines_rest_where_the_board_pulls_them() {
        let board = Board::new(&[], Options::default()).unwrap();
        assert!(board.pin_reset().is_high().unwrap());
        assert!(board.pin_select().is_low().unwrap());
        assert!(board.pin_wp().is_high().unwrap());
        assert!(board.pin_ready().is_low().unwrap());
        assert_eq!(board.pin_ready().set_high(), Err(PinError::IsAnInput));
    }

    #[test]
    fn a_reset_line_held_low_stops_the_core_once_and_two_handles_are_one_line() {
        let board = Board::new(&[], Options::default()).unwrap();
        board.pin_reset().set_low().unwrap();
        board.pin_reset().set_low().unwrap();
        let before = board.instructions();
        board.run_us(1000);
        assert_eq!(board.instructions(), before);
        assert!(board.pin_reset().is_low().unwrap());
        board.pin_reset().set_high().unwrap();
        let pins = board
            .resets()
            .into_iter()
            .filter(|reset| reset.cause == crate::ResetBy::Pin);
        assert_eq!(pins.count(), 1);
    }
}

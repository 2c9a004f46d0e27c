//! The Pi's GPIO lines to the board.

use embedded_hal::digital::{Error, ErrorKind, ErrorType, InputPin, OutputPin};

use crate::board::Board;
use crate::components::i2c_bus::I2cController;
use crate::emulator::EmulationEnded;

/// Which line.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Line {
    /// GPIO 0, the microcontroller's NRST, pulled up: low holds it in reset.
    Reset,
    /// GPIO 4, the I2C switch, pulled down: high connects the EEPROM to the Pi.
    Select,
    /// GPIO 17, the EEPROM's WP, pulled up: high protects it from writing.
    WriteProtect,
    /// GPIO 22, the firmware's READY, pulled down. An input: writing it is an error.
    Ready,
}

/// A line.
#[derive(Clone, Debug)]
pub struct Pin {
    pub(super) board: Board,
    pub(super) line: Line,
}

impl Pin {
    fn drive(&self, high: bool) -> Result<(), PinError> {
        let line = self.line;
        if line == Line::Ready {
            return Err(PinError::IsAnInput);
        }
        self.board.try_stopped(move |stopped| match line {
            Line::Reset => stopped.hold_reset(!high),
            Line::Select if high => stopped.switch_i2c(I2cController::Pi),
            Line::Select => stopped.switch_i2c(I2cController::Stm),
            Line::WriteProtect | Line::Ready => stopped.i2c_bus(|bus, _| {
                if let Some(eeprom) = &mut bus.eeprom {
                    eeprom.write_protected = high;
                }
            }),
        })?;
        Ok(())
    }
}

/// A line cannot be driven or read.
#[derive(Clone, Debug, PartialEq, Eq, thiserror::Error)]
pub enum PinError {
    /// READY is the board's to drive.
    #[error("the line is an input of the Pi")]
    IsAnInput,
    /// The emulation has ended.
    #[error(transparent)]
    Ended(#[from] EmulationEnded),
}

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
        let line = self.line;
        let level = self.board.try_stopped(move |stopped| {
            let mcu = stopped.mcu();
            let bus = mcu.board.i2c.lock();
            match line {
                Line::Reset => !mcu.board.reset_low,
                Line::Select => bus.controller() == I2cController::Pi,
                Line::WriteProtect => bus.eeprom.as_ref().is_none_or(|part| part.write_protected),
                Line::Ready => mcu.is_ready(),
            }
        })?;
        Ok(level)
    }

    fn is_low(&mut self) -> Result<bool, PinError> {
        self.is_high().map(|high| !high)
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::{Options, ResetSource};

    #[test]
    fn lines_rest_at_their_pulls_and_ready_is_input() {
        let board = Board::new(&[], Options::default()).unwrap();
        for (line, level) in [
            (Line::Reset, true),
            (Line::Select, false),
            (Line::WriteProtect, true),
            (Line::Ready, false),
        ] {
            assert_eq!(board.pin(line).is_high(), Ok(level), "{line:?}");
        }
        let driven = board.pin(Line::Ready).set_high();
        assert_eq!(driven, Err(PinError::IsAnInput));
    }

    #[test]
    fn reset_line_held_low_stops_core_and_resets_once() {
        let board = Board::new(&[], Options::default()).unwrap();
        board.pin(Line::Reset).set_low().unwrap();
        board.pin(Line::Reset).set_low().unwrap();
        let before = board.instructions();
        board.run_us(1000);
        assert_eq!(board.instructions(), before);
        assert_eq!(board.pin(Line::Reset).is_low(), Ok(true));
        board.pin(Line::Reset).set_high().unwrap();
        assert_eq!(board.resets(), [ResetSource::Pin]);
    }
}

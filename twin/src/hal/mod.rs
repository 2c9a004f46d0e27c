//! The Pi's end of the wires as embedded-hal 1.0 sees it. Virtual time passes only inside transfers
//! and delays.

mod gpio;
mod i2c;
mod spi;

use embedded_hal::delay::DelayNs;

pub use gpio::{Line, Pin, PinError};
pub use i2c::{I2c, I2cError};
pub use spi::{Spi, SpiTiming};

use crate::board::Board;

impl Board {
    /// /dev/spidev0.0: mode 0, 8 MHz, chip select by the controller.
    pub fn spi(&self) -> Spi {
        self.spi_with(SpiTiming::default())
    }

    /// The same with other timing.
    pub fn spi_with(&self, timing: SpiTiming) -> Spi {
        let board = self.clone();
        Spi { board, timing }
    }

    /// /dev/i2c-1 at 400 kHz: the EEPROM, while the switch connects it to the Pi.
    pub fn i2c(&self) -> I2c {
        I2c(self.clone())
    }

    /// One of the Pi's GPIO lines.
    pub fn pin(&self, line: Line) -> Pin {
        let board = self.clone();
        Pin { board, line }
    }

    /// A delay in virtual time.
    pub fn delay(&self) -> Delay {
        Delay(self.clone())
    }
}

/// Lets virtual time pass.
#[derive(Clone, Debug)]
pub struct Delay(Board);

impl DelayNs for Delay {
    /// # Panics
    /// When the emulation has ended: the trait has no error.
    fn delay_ns(&mut self, ns: u32) {
        let run = self.0.try_run_ns(u64::from(ns));
        run.unwrap_or_else(|ended| panic!("{ended}"));
    }
}

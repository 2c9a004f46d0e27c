//! The Pi's end of the wires as embedded-hal 1.0 sees it. Virtual time passes inside transfers and
//! delays alone.

mod delay;
mod gpio;
mod i2c;
mod spi;

pub use delay::Delay;
pub use gpio::{Line, Pin, PinError};
pub use i2c::{I2c, I2cError};
pub use spi::{Spi, SpiError, SpiTiming};

use crate::board::Board;

impl Board {
    /// /dev/spidev0.0: mode 0, 8 MHz, chip select by the controller.
    #[must_use]
    pub fn spi(&self) -> Spi {
        self.spi_with(SpiTiming::default())
    }

    /// The same with other timing.
    #[must_use]
    pub fn spi_with(&self, timing: SpiTiming) -> Spi {
        Spi::new(self.clone(), timing)
    }

    /// /dev/i2c-1 at 400 kHz: the EEPROM, while the switch gives it to the Pi.
    #[must_use]
    pub fn i2c(&self) -> I2c {
        I2c::new(self.clone())
    }

    /// GPIO 0: low holds the microcontroller in reset, high lets it go.
    #[must_use]
    pub fn pin_reset(&self) -> Pin {
        Pin::new(self.clone(), Line::Reset)
    }

    /// GPIO 4: high gives the EEPROM to the Pi.
    #[must_use]
    pub fn pin_select(&self) -> Pin {
        Pin::new(self.clone(), Line::Select)
    }

    /// GPIO 17: high protects the EEPROM from writing.
    #[must_use]
    pub fn pin_wp(&self) -> Pin {
        Pin::new(self.clone(), Line::WriteProtect)
    }

    /// GPIO 22: high once the firmware is configured.
    #[must_use]
    pub fn pin_ready(&self) -> Pin {
        Pin::new(self.clone(), Line::Ready)
    }

    /// Virtual time to wait in.
    #[must_use]
    pub fn delay(&self) -> Delay {
        Delay::new(self.clone())
    }
}

//! The wires between the Pi and the board, as embedded-hal handles: the same code drives the real
//! buses, the virtual board and the doubles of the tests.

use crate::error::Error;
use crate::ground_truth::Tape;
use crate::uart::Source;
use embedded_hal::delay::DelayNs;
use embedded_hal::digital::{InputPin, OutputPin};
use embedded_hal::i2c::I2c;
use embedded_hal::spi::SpiDevice;
use std::fmt::Debug;
use std::sync::atomic::{AtomicBool, Ordering};
use std::sync::Arc;

/// A monotonic clock. On the virtual board it shows virtual time, which only passes while the host
/// waits or transfers.
pub trait Clock {
    /// Microseconds since some fixed instant.
    fn micros(&mut self) -> u64;
}

/// The types of one machine's handles.
pub trait Wires {
    /// SPI device 0, mode 0: one transaction is one chip-select is one frame.
    type Spi: SpiDevice;
    /// The EEPROM's bus.
    type I2c: I2c;
    /// NRST: low holds the STM in reset, high *releases* the line (open drain), it never drives it.
    type Reset: OutputPin;
    /// SELECT: high = the Pi has the EEPROM's bus.
    type Select: OutputPin;
    /// `WP_EEPROM`: high = write-protected.
    type Protect: OutputPin;
    /// `STM_READY`: high = configured.
    type Ready: InputPin;
    /// Waiting.
    type Delay: DelayNs;
    /// Time.
    type Clock: Clock;
}

/// One machine: the handles of [`Wires`].
// Requirement: DOC-3.2-2
pub struct Machine<W: Wires> {
    /// The frame link.
    pub spi: W::Spi,
    /// The EEPROM's bus.
    pub i2c: W::I2c,
    /// NRST, open drain.
    pub reset: W::Reset,
    /// The I2C switch.
    pub select: W::Select,
    /// Write protection.
    pub protect: W::Protect,
    /// Whether the STM is configured.
    pub ready: W::Ready,
    /// Waiting.
    pub delay: W::Delay,
    /// Time.
    pub clock: W::Clock,
    /// The STM's log.
    pub uart: Box<dyn Source>,
    /// Who measures on the floor, where nobody need be asked.
    pub tape: Option<Box<dyn Tape>>,
    /// Raised by Ctrl-C: every wait and every loop looks at it.
    pub interrupt: Interrupt,
}

impl<W: Wires> Machine<W> {
    /// Brings the lines this end drives to their place of rest: EEPROM protected, its bus with the
    /// STM, reset released. A host-link that was killed may have left them elsewhere.
    ///
    /// # Errors
    /// [`Error::Pin`] names the line that cannot be driven.
    pub fn rest(&mut self) -> Result<(), Error> {
        persist(|| self.protect.set_high()).map_err(|cause| Error::Pin {
            net: "WP_EEPROM",
            cause,
        })?;
        persist(|| self.select.set_low()).map_err(|cause| Error::Pin {
            net: "SELECT",
            cause,
        })?;
        persist(|| self.reset.set_high()).map_err(|cause| Error::Pin {
            net: "RESET",
            cause,
        })
    }
}

/// How often a line or a bus is tried before its failure counts.
const ATTEMPTS: usize = 3;

/// Tries `act` up to three times: one disturbed system call must not leave a line where it is.
pub(crate) fn persist<T, E: Debug>(mut act: impl FnMut() -> Result<T, E>) -> Result<T, String> {
    let mut last = String::new();
    for _ in 0..ATTEMPTS {
        match act() {
            Ok(value) => return Ok(value),
            Err(cause) => last = format!("{cause:?}"),
        }
    }
    Err(last)
}

/// A flag that a signal handler raises and every loop of this crate looks at.
#[derive(Clone, Debug, Default)]
pub struct Interrupt(Arc<AtomicBool>);

impl Interrupt {
    /// A flag that is not raised.
    #[must_use]
    pub fn new() -> Self {
        Self::default()
    }

    /// Asks whatever runs to end in an orderly way.
    pub fn raise(&self) {
        self.0.store(true, Ordering::Relaxed);
    }

    /// # Errors
    /// [`Error::Interrupted`] once the flag is raised.
    pub fn check(&self) -> Result<(), Error> {
        if self.0.load(Ordering::Relaxed) {
            return Err(Error::Interrupted);
        }
        Ok(())
    }
}

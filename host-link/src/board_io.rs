//! The lines and buses between the Pi and the board, behind embedded-hal traits: the same code drives
//! the Pi's own buses, the virtual board and the mock of the tests.

use crate::error::Error;
use embedded_hal::digital::{InputPin, OutputPin};
use embedded_hal::i2c::{self, I2c};
use embedded_hal::spi::{self, SpiDevice};
use std::fmt::Debug;
use std::sync::Arc;
use std::sync::atomic::{AtomicBool, Ordering};

/// Drives a line high (`true`) or low.
pub type OutputLine = Box<dyn FnMut(bool) -> Result<(), IoError>>;
/// Whether a line is high.
pub type InputLine = Box<dyn FnMut() -> Result<bool, IoError>>;

/// Everything that connects the Pi with one board.
// Requirement: DOC-3.2-2
pub struct BoardIo {
    /// SPI device 0, mode 0: one transaction is one chip-select is one frame.
    pub spi: Box<dyn SpiDevice<Error = IoError>>,
    /// The EEPROM's bus.
    pub i2c: Box<dyn I2c<Error = IoError>>,
    /// NRST: low holds the STM in reset, high *releases* the line (open drain), it never drives it.
    pub reset: OutputLine,
    /// SELECT of the I2C switch: high = the Pi has the EEPROM's bus.
    pub select: OutputLine,
    /// `WP_EEPROM`: high = write-protected.
    pub protect: OutputLine,
    /// `STM_READY`: high = configured.
    pub ready: InputLine,
    /// Waits so many microseconds.
    pub delay: Box<dyn FnMut(u32)>,
    /// Microseconds since some fixed instant. On the virtual board they only pass while the host waits or
    /// transfers.
    pub clock: Box<dyn FnMut() -> u64>,
    /// Whether the clock goes on while the host works.
    pub real_time: bool,
    /// The bytes of the STM's UART log that came since the last call; never waits.
    pub log: Box<dyn FnMut() -> Result<Vec<u8>, Error>>,
    /// Raised by Ctrl-C: every wait and every loop checks it.
    pub interrupt: Interrupt,
}

impl BoardIo {
    /// Drives the output lines to their idle levels: EEPROM protected, its bus with the STM, reset
    /// released. A process that was killed may have left them elsewhere.
    ///
    /// # Errors
    /// [`Error::Pin`] names the line that cannot be driven.
    pub fn set_idle(&mut self) -> Result<(), Error> {
        self.set_protect(true)?;
        self.set_select(false)?;
        self.set_reset(false)
    }

    /// Sets (`true`) or lifts the EEPROM's write protection.
    ///
    /// # Errors
    /// [`Error::Pin`].
    pub fn set_protect(&mut self, protected: bool) -> Result<(), Error> {
        retry("WP_EEPROM", || (self.protect)(protected))
    }

    /// Switches the EEPROM's bus to the Pi (`true`) or to the STM.
    ///
    /// # Errors
    /// [`Error::Pin`].
    pub fn set_select(&mut self, selected: bool) -> Result<(), Error> {
        retry("SELECT", || (self.select)(selected))
    }

    /// Holds the STM in reset (`true`) or releases it.
    ///
    /// # Errors
    /// [`Error::Pin`].
    pub fn set_reset(&mut self, held: bool) -> Result<(), Error> {
        retry("RESET", || (self.reset)(!held))
    }

    /// Whether `STM_READY` is high.
    ///
    /// # Errors
    /// [`Error::Pin`].
    pub fn is_ready(&mut self) -> Result<bool, Error> {
        retry("STM_READY", || (self.ready)())
    }
}

/// Tries `act` up to three times: one disturbed system call must not leave a line where it is.
fn retry<T>(net: &'static str, mut act: impl FnMut() -> Result<T, IoError>) -> Result<T, Error> {
    let outcome = act().or_else(|_| act()).or_else(|_| act());
    outcome.map_err(|cause| Error::Pin(net, cause.to_string()))
}

/// A driver's error as text: drivers of all kinds share one [`BoardIo`].
#[derive(Clone, Debug, PartialEq, Eq, thiserror::Error)]
#[error("{0}")]
pub struct IoError(String);

impl IoError {
    /// The text of a driver's error.
    pub fn new(cause: impl Debug) -> Self {
        Self(format!("{cause:?}"))
    }
}

/// An error of a kind that embedded-hal does not name, and the drivers that fail with it.
macro_rules! erased {
    ($($bus:ident),+) => {$(
        impl $bus::Error for IoError {
            fn kind(&self) -> $bus::ErrorKind {
                $bus::ErrorKind::Other
            }
        }

        impl<T: $bus::ErrorType> $bus::ErrorType for Erased<T> {
            type Error = IoError;
        }
    )+};
}

erased!(i2c, spi);

/// The line of an output pin.
pub fn output(mut pin: impl OutputPin + 'static) -> OutputLine {
    Box::new(move |high| pin.set_state(high.into()).map_err(IoError::new))
}

/// The line of an input pin.
pub fn input(mut pin: impl InputPin + 'static) -> InputLine {
    Box::new(move || pin.is_high().map_err(IoError::new))
}

/// A driver with its error type replaced by [`IoError`].
pub struct Erased<T>(T);

/// Makes a field of [`BoardIo`] of any driver of I2C or SPI.
pub fn erase<T>(driver: T) -> Box<Erased<T>> {
    Box::new(Erased(driver))
}

impl<T: I2c> I2c for Erased<T> {
    fn transaction(
        &mut self,
        address: u8,
        operations: &mut [i2c::Operation<'_>],
    ) -> Result<(), IoError> {
        let outcome = self.0.transaction(address, operations);
        outcome.map_err(IoError::new)
    }
}

impl<T: SpiDevice> SpiDevice for Erased<T> {
    fn transaction(&mut self, operations: &mut [spi::Operation<'_, u8>]) -> Result<(), IoError> {
        self.0.transaction(operations).map_err(IoError::new)
    }
}

/// A flag that a signal handler raises and every loop of this crate checks.
#[derive(Clone, Debug, Default)]
pub struct Interrupt(Arc<AtomicBool>);

impl Interrupt {
    /// A flag that is not raised.
    pub fn new() -> Self {
        Self::default()
    }

    /// The flag itself, for a signal handler.
    pub fn flag(&self) -> Arc<AtomicBool> {
        Arc::clone(&self.0)
    }

    /// Requests an orderly end of whatever runs.
    pub fn raise(&self) {
        self.0.store(true, Ordering::Relaxed);
    }

    /// Raises the flag when the guard is dropped, also by a panic.
    pub fn raised_on_drop(&self) -> impl Drop + Send + use<> {
        struct Raise(Interrupt);
        impl Drop for Raise {
            fn drop(&mut self) {
                self.0.raise();
            }
        }
        Raise(self.clone())
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

#[test]
fn line_disturbed_twice_is_driven_and_three_times_an_error() {
    for (disturbed, is_driven) in [(2, true), (3, false)] {
        let mut tries = 0..disturbed;
        let outcome = retry("SELECT", || match tries.next() {
            Some(_) => Err(IoError::new("injected")),
            None => Ok(()),
        });
        assert_eq!(outcome.is_ok(), is_driven, "{disturbed}");
    }
}

#[test]
fn interrupt_guard_raises_when_dropped() {
    let interrupt = Interrupt::new();
    let guard = interrupt.raised_on_drop();
    assert_eq!(interrupt.check(), Ok(()));
    drop(guard);
    // Every loop ends, not only the first that checks it.
    for _ in 0..2 {
        assert_eq!(interrupt.check(), Err(Error::Interrupted));
    }
}

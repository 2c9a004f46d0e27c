//! The lines and buses between the Pi and the board, behind embedded-hal traits: the same code drives
//! the Pi's own buses, the virtual board and the mock of the tests.

use crate::error::Error;
use crate::uart::LogSource;
use embedded_hal::delay::DelayNs;
use embedded_hal::digital::{self, InputPin, OutputPin};
use embedded_hal::i2c::{self, I2c};
use embedded_hal::spi::{self, SpiDevice};
use std::fmt::Debug;
use std::sync::Arc;
use std::sync::atomic::{AtomicBool, Ordering};

/// A monotonic clock, or a function as one. On the virtual board it shows virtual time, which only passes
/// while the host waits or transfers.
pub trait Clock {
    /// Microseconds since some fixed instant.
    fn micros(&mut self) -> u64;

    /// Whether it goes on while the host works.
    fn goes_on(&self) -> bool {
        true
    }
}

impl<F: FnMut() -> u64> Clock for F {
    fn micros(&mut self) -> u64 {
        self()
    }
}

/// An output line whose driver is not known here.
pub type DynOutput = dyn OutputPin<Error = IoError>;
/// An input line whose driver is not known here.
pub type DynInput = dyn InputPin<Error = IoError>;

/// Everything that connects the Pi with one board.
// Requirement: DOC-3.2-2
pub struct BoardIo {
    /// SPI device 0, mode 0: one transaction is one chip-select is one frame.
    pub spi: Box<dyn SpiDevice<Error = IoError>>,
    /// The EEPROM's bus.
    pub i2c: Box<dyn I2c<Error = IoError>>,
    /// NRST: low holds the STM in reset, high *releases* the line (open drain), it never drives it.
    pub reset: Box<DynOutput>,
    /// SELECT of the I2C switch: high = the Pi has the EEPROM's bus.
    pub select: Box<DynOutput>,
    /// `WP_EEPROM`: high = write-protected.
    pub protect: Box<DynOutput>,
    /// `STM_READY`: high = configured.
    pub ready: Box<DynInput>,
    /// Waiting.
    pub delay: Box<dyn DelayNs>,
    /// Time.
    pub clock: Box<dyn Clock>,
    /// The STM's UART log.
    pub log: Box<dyn LogSource>,
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
        drive(&mut *self.protect, "WP_EEPROM", protected)
    }

    /// Switches the EEPROM's bus to the Pi (`true`) or to the STM.
    ///
    /// # Errors
    /// [`Error::Pin`].
    pub fn set_select(&mut self, selected: bool) -> Result<(), Error> {
        drive(&mut *self.select, "SELECT", selected)
    }

    /// Holds the STM in reset (`true`) or releases it.
    ///
    /// # Errors
    /// [`Error::Pin`].
    pub fn set_reset(&mut self, held: bool) -> Result<(), Error> {
        drive(&mut *self.reset, "RESET", !held)
    }

    /// Whether `STM_READY` is high.
    ///
    /// # Errors
    /// [`Error::Pin`].
    pub fn is_ready(&mut self) -> Result<bool, Error> {
        retry("STM_READY", || self.ready.is_high())
    }
}

fn drive(line: &mut DynOutput, net: &'static str, high: bool) -> Result<(), Error> {
    retry(net, || line.set_state(high.into()))
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

erased!(digital, i2c, spi);

/// A line behind a function.
struct FunctionLine<F>(F);

impl<F> digital::ErrorType for FunctionLine<F> {
    type Error = IoError;
}

impl<F: FnMut(bool) -> Result<(), IoError>> OutputPin for FunctionLine<F> {
    fn set_low(&mut self) -> Result<(), IoError> {
        self.0(false)
    }

    fn set_high(&mut self) -> Result<(), IoError> {
        self.0(true)
    }
}

impl<F: FnMut() -> Result<bool, IoError>> InputPin for FunctionLine<F> {
    fn is_high(&mut self) -> Result<bool, IoError> {
        self.0()
    }

    fn is_low(&mut self) -> Result<bool, IoError> {
        self.0().map(|high| !high)
    }
}

/// A line that `set` drives high (`true`) or low.
pub fn output(set: impl FnMut(bool) -> Result<(), IoError> + 'static) -> Box<DynOutput> {
    Box::new(FunctionLine(set))
}

/// A line of which `is_high` reads the level.
pub fn input(is_high: impl FnMut() -> Result<bool, IoError> + 'static) -> Box<DynInput> {
    Box::new(FunctionLine(is_high))
}

/// A driver with its error type replaced by [`IoError`].
pub struct Erased<T>(T);

/// Makes a field of [`BoardIo`] of any embedded-hal driver.
pub fn erase<T>(driver: T) -> Box<Erased<T>> {
    Box::new(Erased(driver))
}

impl<T: OutputPin> OutputPin for Erased<T> {
    fn set_low(&mut self) -> Result<(), IoError> {
        self.0.set_low().map_err(IoError::new)
    }

    fn set_high(&mut self) -> Result<(), IoError> {
        self.0.set_high().map_err(IoError::new)
    }
}

impl<T: InputPin> InputPin for Erased<T> {
    fn is_high(&mut self) -> Result<bool, IoError> {
        self.0.is_high().map_err(IoError::new)
    }

    fn is_low(&mut self) -> Result<bool, IoError> {
        self.0.is_low().map_err(IoError::new)
    }
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

#[test]
fn erased_line_keeps_its_level() {
    let level = std::rc::Rc::new(std::cell::Cell::new(false));
    let driven = level.clone();
    let mut line = erase(FunctionLine(move |high: bool| {
        driven.set(high);
        Ok(())
    }));
    for high in [true, false] {
        line.set_state(high.into()).unwrap();
        assert_eq!(level.get(), high);
        let mut line = erase(FunctionLine(move || Ok(high)));
        assert_eq!((line.is_high(), line.is_low()), (Ok(high), Ok(!high)));
    }
}

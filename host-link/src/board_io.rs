//! The lines and buses between the Pi and the board, as functions that are made of embedded-hal drivers: the same
//! code drives the Pi's own buses, the virtual board and the mock of the tests.

use crate::error::Error;
use embedded_hal::delay::DelayNs;
use embedded_hal::digital::{InputPin, OutputPin};
use embedded_hal::i2c;
use embedded_hal::spi::{Operation, SpiDevice};
use std::fmt::Debug;
use std::sync::Arc;
use std::sync::atomic::{AtomicBool, Ordering};

/// Transfers a frame within one chip-select: what is sent, what comes back, and the wait before the first clock,
/// nanoseconds.
pub type Spi = dyn FnMut(&[u8], &mut [u8], u32) -> Result<(), IoError>;
/// Writes to an address, then reads as many bytes as are asked for, if any.
pub type I2c = dyn FnMut(u8, &[u8], &mut [u8]) -> Result<(), IoError>;
/// Drives a line high (`true`) or low.
pub type OutputLine = Box<dyn FnMut(bool) -> Result<(), IoError>>;
/// Whether a line is high.
pub type InputLine = Box<dyn FnMut() -> Result<bool, IoError>>;

/// Everything that connects the Pi with one board.
// Requirement: DOC-3.2-2
pub struct BoardIo {
    /// SPI device 0, mode 0.
    pub spi: Box<Spi>,
    /// The EEPROM's bus.
    pub i2c: Box<I2c>,
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
    /// The bytes of the STM's UART log that came since the last call, at so many baud; never waits.
    pub log: Box<dyn FnMut(u32) -> Result<Vec<u8>, Error>>,
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

/// The frames of an SPI device.
pub fn spi(mut device: impl SpiDevice + 'static) -> Box<Spi> {
    Box::new(move |out, back, setup_ns| {
        let mut frame = [Operation::DelayNs(setup_ns), Operation::Transfer(back, out)];
        device.transaction(&mut frame).map_err(IoError::new)
    })
}

/// The transfers of an I2C bus.
pub fn i2c(mut bus: impl i2c::I2c + 'static) -> Box<I2c> {
    Box::new(move |address, write, read| {
        let done = if read.is_empty() {
            bus.write(address, write)
        } else {
            bus.write_read(address, write, read)
        };
        done.map_err(IoError::new)
    })
}

/// The wait of a delay.
pub fn delay(mut delay: impl DelayNs + 'static) -> Box<dyn FnMut(u32)> {
    Box::new(move |us| delay.delay_us(us))
}

/// The line of an output pin.
pub fn output(mut pin: impl OutputPin + 'static) -> OutputLine {
    Box::new(move |high| pin.set_state(high.into()).map_err(IoError::new))
}

/// The line of an input pin.
pub fn input(mut pin: impl InputPin + 'static) -> InputLine {
    Box::new(move || pin.is_high().map_err(IoError::new))
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
fn interrupt_is_raised_by_its_guard_and_its_flag() {
    let interrupt = Interrupt::new();
    let guard = interrupt.raised_on_drop();
    assert_eq!(interrupt.check(), Ok(()));
    drop(guard);
    // Every loop ends, not only the first that checks it.
    for _ in 0..2 {
        assert_eq!(interrupt.check(), Err(Error::Interrupted));
    }
    let signalled = Interrupt::new();
    signalled.flag().store(true, Ordering::Relaxed);
    assert_eq!(signalled.check(), Err(Error::Interrupted));
}

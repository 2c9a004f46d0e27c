//! The EEPROM's bus is taken from the STM and given back on every path: success, error, Ctrl-C and
//! panic. The guard is the only way to the chip, and dropping it restores everything.

use super::chip;
use crate::board_io::{persist, Machine, Wires};
use crate::error::Error;
use crate::reset;
use embedded_hal::delay::DelayNs;
use embedded_hal::digital::{InputPin, OutputPin};

/// What the bus is taken for.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Purpose {
    /// Nothing changes: afterwards the STM is reset only if it was not ready, because then it may
    /// have been reading its configuration when the bus went away.
    Read,
    /// The configuration changes: afterwards the STM is reset and `STM_READY` awaited.
    Write {
        /// How long to await `STM_READY`, milliseconds.
        ready_timeout_ms: u32,
    },
}

/// After SELECT has changed, microseconds: a byte on the wires at 100 kHz ends.
const SETTLE_US: u32 = 200;

/// The taken bus. [`Bus::give_back`] returns it and tells how that went; dropping it does the same
/// in silence.
pub struct Bus<'m, W: Wires> {
    machine: &'m mut Machine<W>,
    purpose: Purpose,
    reset_due: bool,
    given_back: bool,
}

/// Takes the bus, runs `work`, gives the bus back. Returns what `work` returned and, after a
/// [`Purpose::Write`], the milliseconds until `STM_READY`.
///
/// # Errors
/// Those of `work`; [`Error::Pin`] if the bus cannot be taken; [`Error::NotRestored`] if it cannot be
/// given back (it carries the error of `work`, if any); [`Error::NotReady`].
pub fn with<W: Wires, T>(
    machine: &mut Machine<W>,
    purpose: Purpose,
    work: impl FnOnce(&mut Bus<'_, W>) -> Result<T, Error>,
) -> Result<(T, Option<u32>), Error> {
    let mut bus = Bus::take(machine, purpose)?;
    let outcome = work(&mut bus);
    match (outcome, bus.give_back()) {
        (Ok(value), Ok(ready_ms)) => Ok((value, ready_ms)),
        (Err(first), Err(Error::NotRestored { step, cause, .. })) => Err(Error::NotRestored {
            step,
            cause,
            first: Some(Box::new(first)),
        }),
        (Err(first), _) => Err(first),
        (Ok(_), Err(error)) => Err(error),
    }
}

impl<'m, W: Wires> Bus<'m, W> {
    /// Makes sure the EEPROM is protected, then switches its bus to the Pi.
    ///
    /// # Errors
    /// [`Error::Pin`]; everything is restored by then.
    // Requirement: DOC-6-6
    pub fn take(machine: &'m mut Machine<W>, purpose: Purpose) -> Result<Self, Error> {
        let reset_due = match purpose {
            Purpose::Write { .. } => true,
            Purpose::Read => !persist(|| machine.ready.is_high()).map_err(|cause| Error::Pin {
                net: "STM_READY",
                cause,
            })?,
        };
        // From here on the guard exists, so every early return restores.
        let bus = Self {
            machine,
            purpose,
            reset_due,
            given_back: false,
        };
        persist(|| bus.machine.protect.set_high()).map_err(|cause| Error::Pin {
            net: "WP_EEPROM",
            cause,
        })?;
        persist(|| bus.machine.select.set_high()).map_err(|cause| Error::Pin {
            net: "SELECT",
            cause,
        })?;
        bus.machine.delay.delay_us(SETTLE_US);
        Ok(bus)
    }

    /// Reads `out.len()` bytes from `address` on.
    ///
    /// # Errors
    /// [`Error::Eeprom`], [`Error::Interrupted`].
    pub fn read(&mut self, address: u16, out: &mut [u8]) -> Result<(), Error> {
        chip::read(self.machine, address, out)
    }

    /// Lifts the write protection.
    ///
    /// # Errors
    /// [`Error::Pin`].
    pub fn unprotect(&mut self) -> Result<(), Error> {
        persist(|| self.machine.protect.set_low()).map_err(|cause| Error::Pin {
            net: "WP_EEPROM",
            cause,
        })
    }

    /// Sets the write protection.
    ///
    /// # Errors
    /// [`Error::Pin`].
    pub fn protect(&mut self) -> Result<(), Error> {
        persist(|| self.machine.protect.set_high()).map_err(|cause| Error::Pin {
            net: "WP_EEPROM",
            cause,
        })
    }

    /// Writes one burst from `address` on (at most 32 bytes inside a 32-byte boundary), waits for its
    /// write cycle and reads it back.
    ///
    /// # Errors
    /// [`Error::Eeprom`], [`Error::Verify`], [`Error::Interrupted`].
    pub fn write_burst(&mut self, address: usize, data: &[u8]) -> Result<(), Error> {
        let address = u16::try_from(address).unwrap_or(u16::MAX);
        chip::write_burst(self.machine, address, data)
    }

    /// Protection set, bus with the STM, STM reset and ready awaited, as the purpose asks.
    ///
    /// # Errors
    /// [`Error::NotRestored`] names the first step that failed (the others were done all the same),
    /// [`Error::NotReady`].
    pub fn give_back(mut self) -> Result<Option<u32>, Error> {
        self.restore()
    }

    // Requirement: DOC-6-2
    fn restore(&mut self) -> Result<Option<u32>, Error> {
        let machine = &mut *self.machine;
        let protect = persist(|| machine.protect.set_high());
        let select = persist(|| machine.select.set_low());
        let reset = if self.reset_due {
            reset::pulse(machine).map_err(|error| error.to_string())
        } else {
            Ok(())
        };
        // Not before: a panic on the way here makes the drop try once more.
        self.given_back = true;
        let steps = [
            ("setting the write protection", protect),
            ("returning the EEPROM's bus to the STM", select),
            ("resetting the STM", reset),
        ];
        for (step, result) in steps {
            result.map_err(|cause| Error::NotRestored {
                step,
                cause,
                first: None,
            })?;
        }
        match self.purpose {
            Purpose::Write { ready_timeout_ms } => {
                reset::await_ready(machine, ready_timeout_ms).map(Some)
            }
            Purpose::Read => Ok(None),
        }
    }
}

impl<W: Wires> Drop for Bus<'_, W> {
    fn drop(&mut self) {
        if !self.given_back {
            // Only on the way out of an error or a panic, which is what will be reported.
            let _ = self.restore();
        }
    }
}

//! Guard of the EEPROM's bus: taken from the STM and returned on every path (success, error, Ctrl-C,
//! panic).

use crate::board_io::BoardIo;
use crate::error::Error;
use crate::reset;

/// What the bus is taken for.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(super) enum BusAccess {
    /// Nothing changes: afterwards the STM is reset only if it was not ready, because then it may
    /// have been reading its configuration when the bus went away.
    Read,
    /// The configuration changes: afterwards the STM is reset and `STM_READY` awaited.
    Write {
        /// How long to await `STM_READY`, milliseconds.
        ready_timeout_ms: u32,
    },
}

/// Wait after a change of SELECT, microseconds: a byte in transfer at 100 kHz ends.
const SETTLE_US: u32 = 200;

/// The taken bus: dropping it returns it without a report.
struct EepromBus<'b> {
    io: &'b mut BoardIo,
    access: BusAccess,
    reset_due: bool,
    released: bool,
}

/// Takes the bus, runs `work`, gives the bus back. Returns what `work` returned and, after a
/// [`BusAccess::Write`], the milliseconds until `STM_READY`.
///
/// # Errors
/// Those of `work`; [`Error::Pin`] if the bus cannot be taken; [`Error::NotRestored`] if it cannot be
/// given back (it carries the error of `work`, if any); [`Error::NotReady`].
pub(super) fn with<T>(
    io: &mut BoardIo,
    access: BusAccess,
    work: impl FnOnce(&mut BoardIo) -> Result<T, Error>,
) -> Result<(T, Option<u32>), Error> {
    let mut bus = EepromBus::acquire(io, access)?;
    let outcome = work(bus.io);
    match (outcome, bus.restore()) {
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

impl<'b> EepromBus<'b> {
    /// Makes sure the EEPROM is protected, then switches its bus to the Pi; an error restores everything.
    // Requirement: DOC-6-6
    fn acquire(io: &'b mut BoardIo, access: BusAccess) -> Result<Self, Error> {
        let reset_due = access != BusAccess::Read || !io.is_ready()?;
        // From here on the guard exists, so every early return restores.
        let bus = Self {
            io,
            access,
            reset_due,
            released: false,
        };
        bus.io.set_protect(true)?;
        bus.io.set_select(true)?;
        (bus.io.delay)(SETTLE_US);
        Ok(bus)
    }

    /// Sets the protection, returns the bus to the STM, resets the STM and awaits `STM_READY`, as the access
    /// asks. [`Error::NotRestored`] names the first step that failed; the others are done all the same.
    // Requirement: DOC-6-2
    fn restore(&mut self) -> Result<Option<u32>, Error> {
        let protect = self.io.set_protect(true);
        let select = self.io.set_select(false);
        let pulse = self.reset_due.then(|| reset::pulse(self.io));
        // Not before: after a panic on the way here the drop tries once more.
        self.released = true;
        let steps = [
            ("setting the write protection", protect),
            ("returning the EEPROM's bus to the STM", select),
            ("resetting the STM", pulse.unwrap_or(Ok(()))),
        ];
        for (step, result) in steps {
            result.map_err(|error| Error::NotRestored {
                step,
                cause: error.to_string(),
                first: None,
            })?;
        }
        match self.access {
            BusAccess::Write { ready_timeout_ms } => {
                reset::await_ready(self.io, ready_timeout_ms).map(Some)
            }
            BusAccess::Read => Ok(None),
        }
    }
}

impl Drop for EepromBus<'_> {
    fn drop(&mut self) {
        if !self.released {
            // Only on the way out of an error or a panic, which is what will be reported.
            let _ = self.restore();
        }
    }
}

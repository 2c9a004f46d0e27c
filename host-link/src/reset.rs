//! Resetting the STM and waiting for it (board: RESET low 100 ms, then released; `STM_READY`).

use crate::board_io::{persist, Machine, Wires};
use crate::error::Error;
use embedded_hal::delay::DelayNs;
use embedded_hal::digital::{InputPin, OutputPin};

/// How long RESET is held low, milliseconds.
pub const RESET_MS: u32 = 100;

/// How long `STM_READY` is awaited unless told otherwise, milliseconds. Boot takes some 50 ms.
pub const READY_TIMEOUT_MS: u32 = 1000;

/// Between two looks at `STM_READY`, milliseconds.
const LOOK_MS: u32 = 1;

/// Holds RESET low for [`RESET_MS`], then releases it.
///
/// # Errors
/// [`Error::Pin`] if the line cannot be driven; it was tried to release it in any case.
// Requirement: DOC-6-3, WIRE-ready-3
pub fn pulse<W: Wires>(machine: &mut Machine<W>) -> Result<(), Error> {
    let low = persist(|| machine.reset.set_low());
    if low.is_ok() {
        machine.delay.delay_ms(RESET_MS);
    }
    let released = persist(|| machine.reset.set_high());
    low.and(released).map_err(|cause| Error::Pin {
        net: "RESET",
        cause,
    })
}

/// Waits until `STM_READY` is high; returns the milliseconds that took.
///
/// # Errors
/// [`Error::NotReady`] after `timeout_ms`, [`Error::Interrupted`] by Ctrl-C, [`Error::Pin`] if the
/// line cannot be read.
// Requirement: WIRE-ready-3
pub fn await_ready<W: Wires>(machine: &mut Machine<W>, timeout_ms: u32) -> Result<u32, Error> {
    let mut waited = 0;
    loop {
        if persist(|| machine.ready.is_high()).map_err(|cause| Error::Pin {
            net: "STM_READY",
            cause,
        })? {
            return Ok(waited);
        }
        if waited >= timeout_ms {
            return Err(Error::NotReady { waited_ms: waited });
        }
        machine.interrupt.check()?;
        machine.delay.delay_ms(LOOK_MS);
        waited += LOOK_MS;
    }
}

/// [`pulse`], then [`await_ready`].
///
/// # Errors
/// Those of the two.
pub fn restart<W: Wires>(machine: &mut Machine<W>, timeout_ms: u32) -> Result<u32, Error> {
    pulse(machine)?;
    await_ready(machine, timeout_ms)
}

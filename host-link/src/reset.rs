//! Reset of the STM (RESET low for 100 ms, then released) and the wait for `STM_READY`.

use crate::board_io::BoardIo;
use crate::error::Error;

/// How long RESET is held low, milliseconds.
pub const RESET_MS: u32 = 100;

/// Default time-out of `STM_READY`, milliseconds. Boot takes some 50 ms.
pub const READY_TIMEOUT_MS: u32 = 1000;

/// Polling period of `STM_READY`, milliseconds.
const POLL_MS: u32 = 1;

/// Holds RESET low for [`RESET_MS`], then releases it.
///
/// # Errors
/// [`Error::Pin`] if the line cannot be driven; releasing it is tried in any case.
// Requirement: DOC-6-3, WIRE-ready-3
pub fn pulse(io: &mut BoardIo) -> Result<(), Error> {
    let held = io.set_reset(true);
    if held.is_ok() {
        (io.delay)(1000 * RESET_MS);
    }
    let released = io.set_reset(false);
    held.and(released)
}

/// Waits until `STM_READY` is high; returns the milliseconds that took.
///
/// # Errors
/// [`Error::NotReady`] after `timeout_ms`, [`Error::Interrupted`] by Ctrl-C, [`Error::Pin`] if the
/// line cannot be read.
// Requirement: WIRE-ready-3
pub fn await_ready(io: &mut BoardIo, timeout_ms: u32) -> Result<u32, Error> {
    let mut waited = 0;
    while !io.is_ready()? {
        if waited >= timeout_ms {
            return Err(Error::NotReady(waited));
        }
        io.interrupt.check()?;
        (io.delay)(1000 * POLL_MS);
        waited += POLL_MS;
    }
    Ok(waited)
}

/// [`pulse`], then [`await_ready`].
///
/// # Errors
/// Those of the two.
pub fn restart(io: &mut BoardIo, timeout_ms: u32) -> Result<u32, Error> {
    pulse(io)?;
    await_ready(io, timeout_ms)
}

// Requirement: WIRE-ready-3
#[test]
fn reset_line_that_cannot_be_held_is_released() {
    use crate::mock_board::{injected, mock_board};
    use std::{cell::Cell, rc::Rc};

    let (_, mut io) = mock_board(&fw_core::eeprom::Image::FIRST_BOARD, None);
    let released = Rc::new(Cell::new(false));
    let level = Rc::clone(&released);
    io.reset = Box::new(move |high| {
        level.set(high);
        high.then_some(()).ok_or_else(injected)
    });
    assert!(pulse(&mut io).is_err() && released.get());
}

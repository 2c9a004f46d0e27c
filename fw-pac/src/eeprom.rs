//! Reads the configuration's image from the EEPROM at boot, however long the Pi holds the bus and
//! whatever state it left it in.

use crate::board::SELECT;
use crate::gpio::Pull;
use crate::i2c::{self, Error};
use crate::time;
use core::cell::UnsafeCell;
use fw_core::eeprom::{Image, IMAGE_LEN};
use fw_core::log::{Level, Log};

/// A0–A2 to ground (document, figure 2.3).
// Requirement: WIRE-eeprom-7
const DEVICE: u8 = 0x50;
/// A write cycle of the Pi's may still be under way, during which the part answers nothing: 5 ms.
const ATTEMPTS: u32 = 12;
/// Between two attempts, microseconds.
const PAUSE: u32 = 1_000;

struct Buffer(UnsafeCell<Image>);

// SAFETY: only `read` uses it, and `read` takes itself off by `&mut` of boot's one log.
unsafe impl Sync for Buffer {}

static IMAGE: Buffer = Buffer(UnsafeCell::new([0; IMAGE_LEN]));

/// The image, or why there is none. `idle` is called all along, to feed the watchdog and to drain
/// the log.
///
/// # Errors
/// The last attempt's, after every attempt failed.
///
/// # Safety
/// To be called by boot alone, once: the image is one static buffer.
// Requirement: DOC-2.1-1, DOC-2.3-4
pub unsafe fn read(log: &mut Log, mut idle: impl FnMut(&mut Log)) -> Result<&'static Image, Error> {
    SELECT.input(Pull::Down);
    i2c::start();
    let mut announced = false;
    let mut recovered = false;
    let mut attempts = 0;
    loop {
        if SELECT.is_high() {
            if !announced {
                log.line(Level::Info, |line| {
                    line.text("the Pi has the EEPROM, waiting");
                });
                announced = true;
            }
            idle(log);
            time::doze(PAUSE);
            attempts = 0;
            continue;
        }
        // SAFETY: the caller's promise; the slice of the attempt before is gone.
        let image = unsafe { &mut *IMAGE.0.get() };
        let result = i2c::read(DEVICE, 0, image, || idle(log));
        if SELECT.is_high() {
            // Taken away in mid-read: whatever came, came from nowhere.
            continue;
        }
        let Err(error) = result else {
            // SAFETY: the stream has been stopped; from here on the image is only read.
            return Ok(unsafe { &*IMAGE.0.get() });
        };
        attempts += 1;
        if attempts >= ATTEMPTS {
            return Err(error);
        }
        if error != Error::NoAcknowledge {
            if !recovered {
                recovered = true;
                log.line(Level::Warn, |line| {
                    line.text("I2C stuck, clocking the slave out");
                });
            }
            i2c::recover();
        }
        idle(log);
        time::doze(PAUSE);
    }
}

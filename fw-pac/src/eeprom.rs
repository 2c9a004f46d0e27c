//! Reads the configuration from the EEPROM at boot, however long the Pi holds the bus and whatever state
//! it leaves the bus in.

use crate::board::SELECT;
use crate::gpio::Pull;
use crate::i2c::{self, Error};
use crate::time;
use fw_core::eeprom::{Image, SPANS};
use fw_core::log::{Level, Log};

/// A0–A2 to ground (document, figure 2.3).
// Requirement: WIRE-eeprom-7
const DEVICE: u8 = 0x50;
/// A write cycle may be under way, during which the part does not acknowledge: 5 ms.
const ATTEMPTS: u32 = 12;
/// Between two attempts, microseconds.
const PAUSE: u32 = 1_000;

/// Fills the image. `idle` is called all along, to feed the watchdog and to drain the log.
///
/// # Errors
/// The last attempt's, after every attempt failed.
// Requirement: DOC-2.1-1, DOC-2.3-4
pub fn read(image: &mut Image, log: &mut Log, mut idle: impl FnMut(&mut Log)) -> Result<(), Error> {
    SELECT.input(Pull::PullDown);
    i2c::start();
    let mut announced = false;
    let mut recovered = false;
    let mut attempts = 0;
    loop {
        if SELECT.is_high() {
            if !announced {
                log.text(Level::Info, "the Pi has the EEPROM, waiting");
                announced = true;
            }
            idle(log);
            time::sleep(PAUSE);
            attempts = 0;
            continue;
        }
        let result = read_spans(image, || idle(log));
        if SELECT.is_high() {
            // The bus was taken away in mid-read: the bytes are worthless.
            continue;
        }
        let Err(error) = result else {
            return Ok(());
        };
        attempts += 1;
        if attempts >= ATTEMPTS {
            return Err(error);
        }
        if error != Error::NoAcknowledge {
            if !recovered {
                recovered = true;
                log.text(Level::Warn, "I2C stuck, clocking it free");
            }
            i2c::recover();
        }
        idle(log);
        time::sleep(PAUSE);
    }
}

/// Reads the defined bytes and nothing else: 22.5 µs each, and 0.2 ms for each span.
fn read_spans(image: &mut Image, mut idle: impl FnMut()) -> Result<(), Error> {
    for span in &SPANS {
        let start = usize::from(span.address);
        let bytes = image.0.get_mut(start..start + usize::from(span.len));
        i2c::read(DEVICE, span.address, bytes.unwrap_or_default(), &mut idle)?;
    }
    Ok(())
}

//! I2C1, master, 400 kHz, at boot: one blocking read by DMA, with a time-out on every step, and the
//! recovery of a bus that a slave holds. After boot the interface is the gyroscope's.
//!
//! BERR does not end a transfer: a master may see it without a cause (ES0287, 2.10), and where a bus error is
//! real the step's time-out ends it.

use crate::board::{SCL, SDA};
use crate::clock::APB1_MHZ;
use crate::dma::{Stream, control};
use crate::gpio::{Driver, Pull};
use crate::registers::Registers;
use crate::time;
use stm32f4::stm32f411::{I2C1, i2c1};

type Dma = Stream<1, 0>;

/// Why a read failed.
#[derive(Clone, Copy, PartialEq, Eq)]
pub enum Error {
    /// SDA or SCL is held low.
    Busy,
    /// No acknowledge of the device's address or of a byte of the register's.
    NoAcknowledge,
    /// A step took longer than it can, or the interface lost the bus.
    Stuck,
}

/// One step of a transfer is at most two bytes, 45 µs at 400 kHz; a slave may stretch it.
const STEP: u32 = 1_000;

/// Between two polls of the DMA, microseconds.
const POLL: u32 = 100;

/// Writes CR2: the bus clock of the peripheral, and what `bits` enables.
pub fn enable(bits: impl FnOnce(&mut i2c1::cr2::W) -> &mut i2c1::cr2::W) {
    // SAFETY: 50 MHz is within 2 ..= 50 (RM0383, 18.6.2).
    I2C1::registers()
        .cr2()
        .write(|w| bits(unsafe { w.freq().bits(APB1_MHZ) }));
}

/// Resets the interface and sets it up: fast mode, tlow/thigh 2.
pub fn start() {
    let i2c = I2C1::registers();
    SCL.alternate(4, Driver::OpenDrain, Pull::Floating);
    SDA.alternate(4, Driver::OpenDrain, Pull::Floating);
    i2c.cr1().write(|w| w.swrst().set_bit());
    i2c.cr1().reset();
    enable(|w| w);
    // 3 × 42 periods of 20 ns: 397 kHz.
    // SAFETY: at least 1 in fast mode (RM0383, 18.6.8).
    i2c.ccr().write(|w| unsafe {
        w.f_s().set_bit();
        w.ccr().bits(42)
    });
    // 300 ns of rise time, in periods, plus one.
    i2c.trise().write(|w| w.trise().set(16));
    i2c.cr1().write(|w| w.pe().set_bit());
}

/// Fills `into` from `register` (two address bytes) of the device at `device` (7 bits). `idle` is
/// called all along the DMA's part.
///
/// # Errors
/// See [`Error`]; the bus has been given a STOP where the interface still could.
// Requirement: DOC-6-1
pub fn read(device: u8, register: u16, into: &mut [u8], idle: impl FnMut()) -> Result<(), Error> {
    let result = transfer(device, register, into, idle);
    Dma::stop();
    if end() {
        result
    } else {
        result.and(Err(Error::Stuck))
    }
}

/// STOP; whether the bus is free after it.
pub fn end() -> bool {
    let i2c = I2C1::registers();
    i2c.cr1().modify(|_, w| w.stop().set_bit());
    enable(|w| w);
    time::wait(STEP, || i2c.sr2().read().busy().bit_is_clear())
}

fn transfer(
    device: u8,
    register: u16,
    into: &mut [u8],
    mut idle: impl FnMut(),
) -> Result<(), Error> {
    let i2c = I2C1::registers();
    if !time::wait(STEP, || i2c.sr2().read().busy().bit_is_clear()) {
        return Err(Error::Busy);
    }
    // Requirement: DOC-6-8
    let [high, low] = register.to_be_bytes();
    address(device << 1)?;
    for byte in [high, low] {
        step(|sr| sr.tx_e().bit_is_set())?;
        i2c.dr().write(|w| w.dr().set(byte));
    }
    step(|sr| sr.btf().bit_is_set())?;

    let count = u16::try_from(into.len()).map_err(|_| Error::Stuck)?;
    Dma::connect(i2c.dr().as_ptr());
    // SAFETY: `into` is borrowed exclusively until `read` has stopped the stream.
    unsafe {
        Dma::receive(
            into.as_mut_ptr(),
            count,
            control::channel(1) | control::VERY_HIGH,
        );
    }
    // LAST: the interface refuses the acknowledge of the DMA's last byte by itself.
    enable(|w| w.dmaen().set_bit().last().set_bit());
    address(device << 1 | 1)?;
    // 22.5 µs a byte, and as much again for stretching.
    let limit = u32::from(count) * 45 + STEP;
    let mut outcome = Ok(());
    let ended = time::wait(limit, || {
        idle();
        time::sleep(POLL);
        let sr = i2c.sr1().read();
        if Dma::failed() || sr.arlo().bit_is_set() {
            outcome = Err(Error::Stuck);
        }
        Dma::complete() || outcome.is_err()
    });
    outcome.and(if ended { Ok(()) } else { Err(Error::Stuck) })
}

/// START and the address byte, up to its acknowledge. A START that does not come leaves the interface disabled:
/// CR1 must not be written before it has (RM0383, 18.6.1).
///
/// # Errors
/// See [`Error`].
pub fn address(byte: u8) -> Result<(), Error> {
    let i2c = I2C1::registers();
    i2c.cr1().modify(|_, w| {
        w.ack().set_bit();
        w.start().set_bit()
    });
    step(|sr| sr.sb().bit_is_set()).inspect_err(|_| i2c.cr1().reset())?;
    i2c.dr().write(|w| w.dr().set(byte));
    step(|sr| sr.addr().bit_is_set())?;
    // SR1 has been read with ADDR set; reading SR2 clears it.
    let _ = i2c.sr2().read();
    Ok(())
}

/// Waits for a flag or an error.
fn step(reached: impl Fn(&i2c1::sr1::R) -> bool) -> Result<(), Error> {
    let i2c = I2C1::registers();
    let mut outcome = Err(Error::Stuck);
    time::wait(STEP, || {
        let sr = i2c.sr1().read();
        if sr.af().bit_is_set() {
            outcome = Err(Error::NoAcknowledge);
        } else if sr.arlo().bit_is_set() {
            outcome = Err(Error::Stuck);
        } else if reached(&sr) {
            outcome = Ok(());
        } else {
            return false;
        }
        true
    });
    if outcome == Err(Error::NoAcknowledge) {
        i2c.sr1().modify(|_, w| w.af().clear_bit());
    }
    outcome
}

/// Frees a bus on which a slave was interrupted in mid-byte: clocks it until it releases SDA, nine
/// times at most, then a STOP (UM10204, 3.1.16), then restarts the interface.
pub fn recover() {
    I2C1::registers().cr1().reset();
    SCL.high();
    SDA.high();
    SCL.output(Driver::OpenDrain);
    SDA.output(Driver::OpenDrain);
    half_period();
    for _ in 0..9 {
        if SDA.is_high() {
            break;
        }
        SCL.low();
        half_period();
        SCL.high();
        half_period();
    }
    SCL.low();
    half_period();
    SDA.low();
    half_period();
    SCL.high();
    half_period();
    SDA.high();
    half_period();
    start();
}

/// 5 µs: 100 kHz.
fn half_period() {
    time::wait(5, || false);
}

impl Error {
    /// Text for the log.
    pub const fn reason(self) -> &'static str {
        match self {
            Self::Busy => "I2C held low",
            Self::NoAcknowledge => "EEPROM 0x50 does not answer",
            Self::Stuck => "I2C transfer stuck",
        }
    }
}

//! The MPU6050 on I2C1 after boot: carries out one order of the core in the background of a tick.
//!
//! Nobody waits for the bus. [`begin`] sets START and returns; the interface's events feed the address
//! and the register, the DMA takes the bytes that come, its end sets STOP; [`take`] says at the next
//! tick what became of it. What is still under way by then is given up. All of it runs at the
//! robot's priority: the interface holds the clock low until it is served, so a tick or a frame that
//! comes first delays the transfer and nothing else.
//!
//! A line that is held is clocked out by hand, one edge a tick.

use crate::board::{SCL, SDA};
use crate::clock::APB1_MHZ;
use crate::dma::{control, Stream};
use crate::gpio::Driver;
use crate::i2c;
use core::cell::UnsafeCell;
use fw_core::sensing::mpu6050::{BusRequest, BusResult, ADDRESS};
use stm32f4::stm32f411::{self as pac, interrupt};

type Dma = Stream<1, 0>;

/// What the interface does next.
#[derive(Clone, Copy, PartialEq, Eq)]
enum Phase {
    /// Nothing is under way.
    Idle,
    /// START is set: then the address, to write.
    Select,
    /// The address is out: then the register's.
    Point,
    /// The register's address is out: then its value.
    Value,
    /// The value is out: then STOP.
    End,
    /// The register's address is out: then START again.
    Turn,
    /// START is set again: then the address, to read.
    Reselect,
    /// The address is out: then the DMA takes over.
    Receive,
    /// The DMA has it.
    Data,
}

/// The transfer under way, or the last one's outcome.
struct Transfer {
    phase: Phase,
    register: u8,
    value: u8,
    count: u8,
    outcome: BusResult,
}

struct Shared {
    transfer: UnsafeCell<Transfer>,
    bytes: UnsafeCell<[u8; 2]>,
}

// SAFETY: everything in this module runs at the robot's priority, which does not preempt itself; the
// DMA has `bytes` from `Phase::Receive` until its stream is stopped.
unsafe impl Sync for Shared {}

static SHARED: Shared = Shared {
    transfer: UnsafeCell::new(Transfer {
        phase: Phase::Idle,
        register: 0,
        value: 0,
        count: 0,
        outcome: BusResult::Done,
    }),
    bytes: UnsafeCell::new([0; 2]),
};

/// CR2 with its frequency and nothing enabled, or these.
fn enable(bits: impl FnOnce(&mut pac::i2c1::cr2::W) -> &mut pac::i2c1::cr2::W) {
    // SAFETY: 50 MHz, as at boot.
    i2c::registers()
        .cr2()
        .write(|w| bits(unsafe { w.freq().bits(APB1_MHZ) }));
}

/// What became of the order of the last tick; what is still under way is given up.
///
/// # Safety
/// At the robot's priority alone.
pub unsafe fn take() -> BusResult {
    // SAFETY: the caller's promise.
    let transfer = unsafe { &mut *SHARED.transfer.get() };
    if transfer.phase != Phase::Idle {
        enable(|w| w);
        Dma::stop();
        transfer.phase = Phase::Idle;
        transfer.outcome = BusResult::Timeout;
    }
    core::mem::take(&mut transfer.outcome)
}

/// Begins what the core ordered; [`take`] came before.
///
/// # Safety
/// At the robot's priority alone.
pub unsafe fn begin(order: BusRequest) {
    // SAFETY: the caller's promise.
    let transfer = unsafe { &mut *SHARED.transfer.get() };
    match order {
        BusRequest::Idle => {}
        BusRequest::Write { register, value } => start(transfer, register, value, 0),
        BusRequest::Read { register, count } => start(transfer, register, 0, count.clamp(1, 2)),
        BusRequest::DriveLines { clock, data } => {
            i2c::registers().cr1().reset();
            SCL.set(clock);
            SDA.set(data);
            SCL.output(Driver::OpenDrain);
            SDA.output(Driver::OpenDrain);
        }
        BusRequest::ReleaseLines => i2c::start(),
    }
}

fn start(transfer: &mut Transfer, register: u8, value: u8, count: u8) {
    let i2c = i2c::registers();
    if i2c.sr2().read().busy().bit_is_set() {
        transfer.outcome = BusResult::Timeout;
        return;
    }
    *transfer = Transfer {
        phase: Phase::Select,
        register,
        value,
        count,
        outcome: BusResult::Done,
    };
    i2c.sr1().reset();
    enable(|w| w.itevten().set_bit().iterren().set_bit());
    i2c.cr1().modify(|_, w| w.ack().set_bit().start().set_bit());
}

/// STOP, and the interface is quiet.
fn end(transfer: &mut Transfer, outcome: BusResult) {
    i2c::registers().cr1().modify(|_, w| w.stop().set_bit());
    enable(|w| w);
    transfer.phase = Phase::Idle;
    transfer.outcome = outcome;
}

#[interrupt]
fn I2C1_EV() {
    // SAFETY: the robot's priority.
    let transfer = unsafe { &mut *SHARED.transfer.get() };
    let i2c = i2c::registers();
    let status = i2c.sr1().read();
    let put = |byte: u8| i2c.dr().write(|w| w.dr().set(byte));
    let (selected, addressed, sent) = (
        status.sb().bit_is_set(),
        status.addr().bit_is_set(),
        status.btf().bit_is_set(),
    );
    transfer.phase = match transfer.phase {
        Phase::Select if selected => {
            put(ADDRESS << 1);
            Phase::Point
        }
        Phase::Point if addressed => {
            // SR1 has been read with ADDR set; reading SR2 clears it.
            let _ = i2c.sr2().read();
            put(transfer.register);
            if transfer.count == 0 {
                Phase::Value
            } else {
                Phase::Turn
            }
        }
        Phase::Value if sent => {
            put(transfer.value);
            Phase::End
        }
        Phase::End if sent => {
            end(transfer, BusResult::Done);
            Phase::Idle
        }
        Phase::Turn if sent => {
            i2c.cr1().modify(|_, w| w.start().set_bit());
            Phase::Reselect
        }
        Phase::Reselect if selected => {
            put(ADDRESS << 1 | 1);
            Phase::Receive
        }
        Phase::Receive if addressed => {
            receive(transfer.count);
            let _ = i2c.sr2().read();
            Phase::Data
        }
        // An event that is on its way out: START and STOP take effect a moment after they are set.
        phase => phase,
    };
}

/// Hands the bytes to come to the DMA; ADDR still stands and holds the clock.
fn receive(count: u8) {
    let i2c = i2c::registers();
    // SAFETY: the buffer is static, two bytes long, and nobody's but the DMA's until it is stopped.
    unsafe {
        Dma::start(
            i2c.dr().as_ptr() as u32,
            SHARED.bytes.get() as u32,
            u16::from(count),
            control::channel(1) | control::READ | control::MEDIUM | control::TCIE | control::TEIE,
        );
    }
    // A single byte is refused by the program, the last of several by the interface (RM0383, 18.3.8).
    if count == 1 {
        i2c.cr1().modify(|_, w| w.ack().clear_bit());
    }
    enable(|w| {
        w.dmaen().set_bit();
        w.last().set_bit();
        w.iterren().set_bit()
    });
}

#[interrupt]
fn DMA1_STREAM0() {
    // SAFETY: the robot's priority.
    let transfer = unsafe { &mut *SHARED.transfer.get() };
    let whole = Dma::complete();
    Dma::stop();
    Dma::clear();
    if transfer.phase != Phase::Data {
        return;
    }
    // SAFETY: the stream is stopped.
    let [high, low] = unsafe { *SHARED.bytes.get() };
    let bytes = [high, if transfer.count == 1 { 0 } else { low }];
    end(
        transfer,
        if whole {
            BusResult::Bytes(bytes)
        } else {
            BusResult::Timeout
        },
    );
}

#[interrupt]
fn I2C1_ER() {
    // SAFETY: the robot's priority.
    let transfer = unsafe { &mut *SHARED.transfer.get() };
    let i2c = i2c::registers();
    let refused = i2c.sr1().read().af().bit_is_set();
    // Every error flag is cleared by a 0.
    i2c.sr1().reset();
    Dma::stop();
    if transfer.phase == Phase::Idle {
        return;
    }
    end(
        transfer,
        if refused {
            BusResult::Nack
        } else {
            BusResult::Timeout
        },
    );
}

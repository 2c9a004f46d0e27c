//! The MPU6050 on I2C1 after boot: carries out one bus request of the core in the background of a tick.
//!
//! Nothing waits for the bus. [`Gyro::begin`] sets START and returns; the interface's events send the
//! address and the register, the DMA takes the received bytes, its end sets STOP; [`Gyro::take`] returns
//! the result at the next tick and aborts what is still under way. All of it runs at the robot's
//! priority: the interface stretches the clock until it is served, so a tick or a frame only delays it.
//!
//! The recovery of a held bus takes one edge a tick.

use crate::board::{SCL, SDA};
use crate::dma::{Buffer, Stream, control};
use crate::gpio::Driver;
use crate::i2c;
use crate::registers::Registers;
use fw_core::sensing::mpu6050::{ADDRESS, BusRequest, BusResult};
use stm32f4::stm32f411::I2C1;

type Dma = Stream<1, 0>;

static RECEIVED: Buffer<2> = Buffer::new();

/// The step that the next event completes.
#[derive(Clone, Copy, PartialEq, Eq)]
enum Phase {
    /// No transfer.
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
    RepeatStart,
    /// START is set again: then the address, to read.
    Reselect,
    /// The address is out: then the DMA takes over.
    Receive,
    /// The DMA has it.
    Data,
}

/// The transfer under way, or the last one's result.
pub struct Gyro {
    phase: Phase,
    register: u8,
    value: u8,
    count: u8,
    result: BusResult,
}

impl Gyro {
    /// No transfer yet.
    pub const IDLE: Self = Self {
        phase: Phase::Idle,
        register: 0,
        value: 0,
        count: 0,
        result: BusResult::Done,
    };

    /// The result of the last tick's request; a transfer still under way is aborted.
    pub fn take(&mut self) -> BusResult {
        if self.phase != Phase::Idle {
            i2c::enable(|w| w);
            Dma::stop();
            self.phase = Phase::Idle;
            self.result = BusResult::Timeout;
        }
        core::mem::take(&mut self.result)
    }

    /// Begins a request of the core; [`Self::take`] came before.
    pub fn begin(&mut self, request: BusRequest) {
        match request {
            BusRequest::Idle => {}
            BusRequest::Write { register, value } => self.start(register, value, 0),
            BusRequest::Read { register, count } => self.start(register, 0, count.clamp(1, 2)),
            BusRequest::DriveLines { clock, data } => {
                I2C1::registers().cr1().reset();
                SCL.set(clock);
                SDA.set(data);
                SCL.output(Driver::OpenDrain);
                SDA.output(Driver::OpenDrain);
            }
            BusRequest::ReleaseLines => i2c::start(),
        }
    }

    fn start(&mut self, register: u8, value: u8, count: u8) {
        let i2c = I2C1::registers();
        if i2c.sr2().read().busy().bit_is_set() {
            self.result = BusResult::Timeout;
            return;
        }
        *self = Self {
            phase: Phase::Select,
            register,
            value,
            count,
            result: BusResult::Done,
        };
        i2c.sr1().reset();
        i2c::enable(|w| w.itevten().set_bit().iterren().set_bit());
        i2c.cr1().modify(|_, w| w.ack().set_bit().start().set_bit());
    }

    /// Sends STOP and disables the interface's interrupts.
    fn end(&mut self, result: BusResult) {
        I2C1::registers().cr1().modify(|_, w| w.stop().set_bit());
        i2c::enable(|w| w);
        self.phase = Phase::Idle;
        self.result = result;
    }

    /// I2C1's event interrupt.
    pub fn on_event(&mut self) {
        let i2c = I2C1::registers();
        let status = i2c.sr1().read();
        let put = |byte: u8| i2c.dr().write(|w| w.dr().set(byte));
        let (selected, addressed, sent) = (
            status.sb().bit_is_set(),
            status.addr().bit_is_set(),
            status.btf().bit_is_set(),
        );
        self.phase = match self.phase {
            Phase::Select if selected => {
                put(ADDRESS << 1);
                Phase::Point
            }
            Phase::Point if addressed => {
                // SR1 has been read with ADDR set; reading SR2 clears it.
                let _ = i2c.sr2().read();
                put(self.register);
                if self.count == 0 {
                    Phase::Value
                } else {
                    Phase::RepeatStart
                }
            }
            Phase::Value if sent => {
                put(self.value);
                Phase::End
            }
            Phase::End if sent => {
                self.end(BusResult::Done);
                Phase::Idle
            }
            Phase::RepeatStart if sent => {
                i2c.cr1().modify(|_, w| w.start().set_bit());
                Phase::Reselect
            }
            Phase::Reselect if selected => {
                put(ADDRESS << 1 | 1);
                Phase::Receive
            }
            Phase::Receive if addressed => {
                receive(self.count);
                let _ = i2c.sr2().read();
                Phase::Data
            }
            // A late event: START and STOP take effect a moment after they are set.
            phase => phase,
        };
    }

    /// The DMA's interrupt: every byte has come, or the transfer failed.
    pub fn on_received(&mut self) {
        let whole = Dma::complete();
        Dma::stop();
        Dma::clear();
        if self.phase != Phase::Data {
            return;
        }
        let [high, low] = RECEIVED.get();
        self.end(if whole {
            BusResult::Bytes([high, if self.count == 1 { 0 } else { low }])
        } else {
            BusResult::Timeout
        });
    }

    /// I2C1's error interrupt.
    pub fn on_error(&mut self) {
        let i2c = I2C1::registers();
        let status = i2c.sr1().read();
        let (refused, lost) = (status.af().bit_is_set(), status.arlo().bit_is_set());
        // Every error flag is cleared by a 0.
        i2c.sr1().reset();
        // BERR alone has no cause here (ES0287, 2.10): the transfer goes on.
        if self.phase != Phase::Idle && (refused || lost) {
            Dma::stop();
            self.end(if refused {
                BusResult::Nack
            } else {
                BusResult::Timeout
            });
        }
    }
}

/// Starts the DMA for the bytes that follow; ADDR is still set and stretches the clock.
fn receive(count: u8) {
    let i2c = I2C1::registers();
    Dma::connect(i2c.dr().as_ptr());
    Dma::fill(
        &RECEIVED,
        u16::from(count),
        control::channel(1) | control::MEDIUM | control::TCIE | control::TEIE,
    );
    // A single byte is refused by the program, the last of several by the interface (RM0383, 18.3.8).
    if count == 1 {
        i2c.cr1().modify(|_, w| w.ack().clear_bit());
    }
    i2c::enable(|w| w.dmaen().set_bit().last().set_bit().iterren().set_bit());
}

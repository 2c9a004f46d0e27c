//! `rigless`'s I2C controller with five additions.
//!
//! - The last byte of a DMA reception. With `LAST` set (RM0383 section 18.3.8, 18.6.2 bit 12) the
//!   hardware answers the byte that ends the stream's count with a NACK. The part sets
//!   [`I2cPeripheral::next_is_last`] from the stream's count.
//! - A bus held low by a device. `BUSY` is set (section 18.6.7 bit 1: on detection of `SDA` or `SCL`
//!   low) and a requested start waits until the line is released.
//! - A clock stretched by a device: what comes next comes when it is released (section 18.3.3).
//! - A spurious `BERR` (ES0287 section 2.10): the flag and its interrupt; the transfer goes on.
//! - A lost arbitration (section 18.3.4): `ARLO` and its interrupt, the lines are released, `MSL` is cleared.
//!   `BUSY` stays until `PE` is cleared, since the interface sees no STOP, and sends none as a slave.

use rigless::device::{Device, DeviceContext, Level, RegisterFile, RequestChange};
use rigless::soc::stm32f427::generated::i2c3::{Register, cr1, cr2, sr1, sr2};
use rigless::soc::stm32f427::peripherals::i2c::I2c;
use rigless::soc::{FieldSpec, RegisterSpec};
use rigless::time::{EventId, VirtualNanos};

/// An I2C controller.
#[derive(Debug)]
pub struct I2cPeripheral {
    /// `rigless`'s model of everything else.
    pub inner: I2c,
    /// The byte that ends next is the last of the stream, and is not acknowledged.
    pub next_is_last: bool,
    held_low: bool,
    /// What waits while a device stretches the clock.
    stretched: Option<Vec<EventId>>,
    /// The arbitration was lost since `PE` was set.
    lost: bool,
    /// The error line, raised by `BERR` and `ARLO`.
    error: Level,
}

/// The error line's position among the instance's interrupts.
const ERROR: usize = 1;

impl I2cPeripheral {
    /// The controller of an interface whose bus runs at `clock_hz`.
    pub fn with_clock(clock_hz: u64) -> Self {
        Self {
            inner: I2c::with_clock(clock_hz),
            next_is_last: false,
            held_low: false,
            stretched: None,
            lost: false,
            error: Level::Low,
        }
    }

    /// Whether there was an arbitration to lose: another master drives `SDA` low.
    pub fn lose_arbitration(
        &mut self,
        registers: &mut RegisterFile,
        context: &mut DeviceContext<'_>,
    ) -> bool {
        if !sr2::MSL.is_set(registers.get(Register::Sr2)) {
            return false;
        }
        // Clearing `PE` ends the transfer where it is.
        let control = cr1::STOP.set(cr1::START.set(registers.get(Register::Cr1), 0), 0);
        for control in [cr1::PE.set(control, 0), control] {
            registers.set(Register::Cr1, control);
            self.inner.write(Register::Cr1, control, registers, context);
        }
        self.lost = true;
        self.set_busy(registers);
        self.raise(sr1::ARLO, registers, context);
        true
    }

    /// Sets `BERR`, whatever is on the bus.
    pub fn raise_bus_error(
        &mut self,
        registers: &mut RegisterFile,
        context: &mut DeviceContext<'_>,
    ) {
        self.raise(sr1::BERR, registers, context);
    }

    fn raise(
        &mut self,
        flag: &FieldSpec,
        registers: &mut RegisterFile,
        context: &mut DeviceContext<'_>,
    ) {
        let status = registers.get(Register::Sr1);
        registers.set(Register::Sr1, flag.set(status, 1));
        self.update_error_line(registers, context);
    }

    fn update_error_line(&mut self, registers: &RegisterFile, context: &mut DeviceContext<'_>) {
        let status = registers.get(Register::Sr1);
        let raised = (sr1::BERR.is_set(status) || sr1::ARLO.is_set(status))
            && cr2::ITERREN.is_set(registers.get(Register::Cr2));
        let error = Level::from(raised);
        if std::mem::replace(&mut self.error, error) != error {
            context.interrupt(ERROR, error);
        }
    }

    /// Whether the controller receives by DMA with `LAST` set: then the stream's count decides how
    /// the next byte is acknowledged.
    pub fn uses_last(registers: &RegisterFile) -> bool {
        let control = registers.get(Register::Cr2);
        cr2::LAST.is_set(control) && cr2::DMAEN.is_set(control)
    }

    /// Whether a received byte waits in `DR`.
    pub fn has_byte(registers: &RegisterFile) -> bool {
        sr1::RXNE.is_set(registers.get(Register::Sr1))
    }

    /// A device holds `SDA` or `SCL` low, or releases it: then a pending start is made.
    pub fn hold_low(
        &mut self,
        held: bool,
        registers: &mut RegisterFile,
        context: &mut DeviceContext<'_>,
    ) {
        if self.held_low == held {
            return;
        }
        self.held_low = held;
        self.set_busy(registers);
        let status = registers.get(Register::Sr2);
        if held || sr2::MSL.is_set(status) {
            return;
        }
        registers.set(Register::Sr2, sr2::BUSY.set(status, 0));
        let waiting = registers.get(Register::Cr1);
        if cr1::START.is_set(waiting) {
            for control in [cr1::START.set(waiting, 0), waiting] {
                registers.set(Register::Cr1, control);
                self.inner.write(Register::Cr1, control, registers, context);
            }
        }
    }

    /// A device stretches the clock, or releases it.
    pub fn stretch(
        &mut self,
        stretched: bool,
        registers: &mut RegisterFile,
        context: &mut DeviceContext<'_>,
    ) {
        let waiting = std::mem::replace(&mut self.stretched, stretched.then(Vec::new));
        for event in waiting.into_iter().flatten() {
            self.on_event(event, registers, context);
        }
    }

    fn set_busy(&self, registers: &mut RegisterFile) {
        if (self.held_low || self.lost) && cr1::PE.is_set(registers.get(Register::Cr1)) {
            let status = registers.get(Register::Sr2);
            registers.set(Register::Sr2, sr2::BUSY.set(status, 1));
        }
    }
}

impl Device for I2cPeripheral {
    type Register = Register;

    fn layout(&self) -> &'static [RegisterSpec] {
        Device::layout(&self.inner)
    }

    fn read(
        &mut self,
        register: Register,
        registers: &mut RegisterFile,
        context: &mut DeviceContext<'_>,
    ) -> Option<u64> {
        self.set_busy(registers);
        self.inner.read(register, registers, context)
    }

    fn peek(&self, register: Register, registers: &RegisterFile, now: VirtualNanos) -> Option<u64> {
        self.inner.peek(register, registers, now)
    }

    fn write(
        &mut self,
        register: Register,
        value: u64,
        registers: &mut RegisterFile,
        context: &mut DeviceContext<'_>,
    ) {
        self.lost &= cr1::PE.is_set(registers.get(Register::Cr1));
        self.set_busy(registers);
        self.inner.write(register, value, registers, context);
        self.set_busy(registers);
        self.update_error_line(registers, context);
    }

    fn on_event(
        &mut self,
        event: EventId,
        registers: &mut RegisterFile,
        context: &mut DeviceContext<'_>,
    ) {
        if let Some(waiting) = &mut self.stretched {
            waiting.push(event);
            return;
        }
        let control = registers.get(Register::Cr1);
        if self.next_is_last && cr1::ACK.is_set(control) {
            // The hardware's NACK leaves the software's ACK bit unchanged.
            registers.set(Register::Cr1, cr1::ACK.set(control, 0));
            self.inner.on_event(event, registers, context);
            let after = registers.get(Register::Cr1);
            registers.set(Register::Cr1, cr1::ACK.set(after, 1));
        } else {
            self.inner.on_event(event, registers, context);
        }
    }

    fn on_request(
        &mut self,
        request: RequestChange,
        registers: &mut RegisterFile,
        context: &mut DeviceContext<'_>,
    ) {
        self.inner.on_request(request, registers, context);
    }

    fn on_clock(&mut self, hz: u64, registers: &mut RegisterFile, context: &mut DeviceContext<'_>) {
        self.inner.on_clock(hz, registers, context);
    }

    fn on_access(
        &mut self,
        token: u64,
        value: u64,
        registers: &mut RegisterFile,
        context: &mut DeviceContext<'_>,
    ) {
        self.inner.on_access(token, value, registers, context);
    }

    fn reset(&mut self) {
        self.next_is_last = false;
        self.stretched = self.stretched.take().map(|_| Vec::new());
        (self.lost, self.error) = (false, Level::Low);
        self.inner.reset();
    }

    fn reset_line(&mut self, registers: &mut RegisterFile, context: &mut DeviceContext<'_>) {
        self.next_is_last = false;
        self.lost = false;
        self.stretched = self.stretched.take().map(|_| Vec::new());
        self.inner.reset_line(registers, context);
    }
}

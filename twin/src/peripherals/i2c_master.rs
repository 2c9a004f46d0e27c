//! `rigless`'s I2C controller with six additions.
//!
//! - A START or STOP takes a period of SCL, about what a fast bus demands between STOP and START, and before and
//!   behind START (UM10204, table 10); requested during a byte it comes at its end. Until it has come the program
//!   must not write CR1 (RM0383 section 18.6.1, the note to its bits), but may disable or reset the interface.
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
use rigless::soc::stm32f427::generated::i2c3::{Register, ccr, cr1, cr2, sr1, sr2};
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
    /// PCLK1.
    clock_hz: u64,
    /// The end of the START or STOP under way.
    condition: Option<EventId>,
    /// `START` and `STOP` as they were left: neither has come.
    requested: u64,
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

/// `CR1` without `START` and `STOP`.
fn without_conditions(control: u64) -> u64 {
    cr1::STOP.set(cr1::START.set(control, 0), 0)
}

impl I2cPeripheral {
    /// The controller of an interface whose bus runs at `clock_hz`.
    pub fn with_clock(clock_hz: u64) -> Self {
        Self {
            inner: I2c::with_clock(clock_hz),
            next_is_last: false,
            clock_hz,
            condition: None,
            requested: 0,
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
        let control = without_conditions(registers.get(Register::Cr1));
        self.condition = None;
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

    /// `CR1` as the program writes it: a START or STOP begins.
    fn write_control(
        &mut self,
        control: u64,
        registers: &mut RegisterFile,
        context: &mut DeviceContext<'_>,
    ) {
        if !cr1::PE.is_set(control) || cr1::SWRST.is_set(control) {
            self.condition = None;
            return self.inner.write(Register::Cr1, control, registers, context);
        }
        if self.requested != 0 {
            let reason = "written before START or STOP has come, RM0383 18.6.1";
            context.tell("CR1", reason);
        }
        let rest = without_conditions(control);
        registers.set(Register::Cr1, rest);
        self.inner.write(Register::Cr1, rest, registers, context);
        if control != rest {
            registers.set(Register::Cr1, control);
            let end = VirtualNanos(context.now().0 + self.scl_period_ns(registers));
            self.condition.get_or_insert_with(|| context.schedule(end));
        }
    }

    fn note_requests(&mut self, registers: &RegisterFile) {
        let control = registers.get(Register::Cr1);
        self.requested = control ^ without_conditions(control);
    }

    /// A period of SCL, section 18.6.8.
    fn scl_period_ns(&self, registers: &RegisterFile) -> u64 {
        let value = registers.get(Register::Ccr);
        let parts = match (ccr::F_S.is_set(value), ccr::DUTY.is_set(value)) {
            (false, _) => 2,
            (true, false) => 3,
            (true, true) => 25,
        };
        parts * ccr::CCR.get(value) * 1_000_000_000 / self.clock_hz.max(1)
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
        if register == Register::Cr1 {
            self.write_control(value, registers, context);
        } else {
            self.inner.write(register, value, registers, context);
        }
        self.set_busy(registers);
        self.note_requests(registers);
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
        if self.condition == Some(event) {
            self.condition = None;
            self.inner.write(Register::Cr1, control, registers, context);
        } else if self.next_is_last && cr1::ACK.is_set(control) {
            // The hardware's NACK leaves the software's ACK bit unchanged.
            registers.set(Register::Cr1, cr1::ACK.set(control, 0));
            self.inner.on_event(event, registers, context);
            let after = registers.get(Register::Cr1);
            registers.set(Register::Cr1, cr1::ACK.set(after, 1));
        } else {
            self.inner.on_event(event, registers, context);
        }
        self.note_requests(registers);
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
        self.clock_hz = hz;
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
        (self.condition, self.requested) = (None, 0);
        self.inner.reset();
    }

    fn reset_line(&mut self, registers: &mut RegisterFile, context: &mut DeviceContext<'_>) {
        self.next_is_last = false;
        self.lost = false;
        (self.condition, self.requested) = (None, 0);
        self.stretched = self.stretched.take().map(|_| Vec::new());
        self.inner.reset_line(registers, context);
    }
}

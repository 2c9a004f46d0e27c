//! `rigless`'s I2C controller with two things it leaves out.
//!
//! - The last byte of a DMA reception. With `LAST` set (RM0383 section 18.3.8, 18.6.2 bit 12) the
//!   hardware answers the byte that ends the stream's count with a NACK. The part reads the count
//!   off the stream and says so through [`I2cMaster::next_is_last`].
//! - A bus somebody holds low. `BUSY` stands (section 18.6.7 bit 1: set on detection of `SDA` or
//!   `SCL` low) and a requested start waits for it, until the line is released.

use rigless::device::{Device, DeviceContext, RegisterFile, RequestChange};
use rigless::soc::stm32f427::generated::i2c3::{cr1, cr2, sr1, sr2, Register};
use rigless::soc::stm32f427::peripherals::i2c::I2c;
use rigless::soc::RegisterSpec;
use rigless::time::{EventId, VirtualNanos};

/// An I2C controller.
#[derive(Debug)]
pub struct I2cMaster {
    /// `rigless`'s model, which does everything else.
    pub inner: I2c,
    last: bool,
    held_low: bool,
}

impl I2cMaster {
    /// The controller of an interface whose bus runs at `clock_hz`.
    #[must_use]
    pub fn with_clock(clock_hz: u64) -> Self {
        Self {
            inner: I2c::with_clock(clock_hz),
            last: false,
            held_low: false,
        }
    }

    /// Whether the controller receives by DMA with `LAST` set, and has a byte to hand over: then
    /// what the stream has left decides how the next one is answered.
    #[must_use]
    pub fn receives_to_the_last(registers: &RegisterFile) -> bool {
        let control = registers.get(Register::Cr2);
        cr2::LAST.is_set(control) && cr2::DMAEN.is_set(control)
    }

    /// Whether a received byte waits in `DR`.
    #[must_use]
    pub fn has_byte(registers: &RegisterFile) -> bool {
        sr1::RXNE.is_set(registers.get(Register::Sr1))
    }

    /// The byte that ends next is the last of the stream, and is not acknowledged.
    pub fn next_is_last(&mut self, last: bool) {
        self.last = last;
    }

    /// Somebody holds `SDA` or `SCL` low, or no longer does: then a start that waited is made.
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
        self.show_busy(registers);
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

    fn show_busy(&self, registers: &mut RegisterFile) {
        if self.held_low && cr1::PE.is_set(registers.get(Register::Cr1)) {
            let status = registers.get(Register::Sr2);
            registers.set(Register::Sr2, sr2::BUSY.set(status, 1));
        }
    }
}

impl Device for I2cMaster {
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
        self.show_busy(registers);
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
        self.show_busy(registers);
        self.inner.write(register, value, registers, context);
        self.show_busy(registers);
    }

    fn on_event(
        &mut self,
        event: EventId,
        registers: &mut RegisterFile,
        context: &mut DeviceContext<'_>,
    ) {
        let control = registers.get(Register::Cr1);
        if self.last && cr1::ACK.is_set(control) {
            // The hardware's NACK leaves the software's ACK bit alone.
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
        self.last = false;
        self.inner.reset();
    }

    fn reset_line(&mut self, registers: &mut RegisterFile, context: &mut DeviceContext<'_>) {
        self.last = false;
        self.inner.reset_line(registers, context);
    }
}

#[cfg(test)]
mod tests {
    use crate::soc::fixture::Bench;
    use rigless::soc::stm32f427::peripherals::i2c::Pattern;

    const RCC: u64 = 0x4002_3800;
    const I2C1: u64 = 0x4000_5400;
    const CR1: u64 = I2C1;
    const CR2: u64 = I2C1 + 4;
    const DR: u64 = I2C1 + 0x10;
    const SR1: u64 = I2C1 + 0x14;
    const SR2: u64 = I2C1 + 0x18;
    const CCR: u64 = I2C1 + 0x1C;
    const PE: u64 = 1;
    const START: u64 = 1 << 8;
    const STOP: u64 = 1 << 9;
    const ACK: u64 = 1 << 10;
    const DMAEN: u64 = 1 << 11;
    const LAST: u64 = 1 << 12;
    const SB: u64 = 1;
    const BUSY: u64 = 1 << 1;
    const STREAM: u64 = 0x4002_6010;

    fn bench() -> Bench {
        let mut bench = Bench::new();
        bench.part.i2c[0]
            .inner
            .attach(Pattern::answering(0x50, [1, 2, 3, 4]));
        bench.write(RCC + 0x30, 1 << 21);
        bench.write(RCC + 0x40, 1 << 21);
        bench.write(CR2, 16);
        bench.write(CCR, 0x50);
        bench.write(CR1, PE | ACK);
        bench
    }

    #[test]
    fn the_last_byte_of_a_dma_reception_is_not_acknowledged_and_nothing_follows_it() {
        let mut bench = bench();
        for (offset, value) in [
            (4, 3),
            (8, DR),
            (12, Bench::RAM),
            (0, 1 << 25 | 1 << 10 | 1),
        ] {
            bench.write(STREAM + offset, value);
        }
        bench.write(CR2, 16 | DMAEN | LAST);
        bench.write(CR1, PE | ACK | START);
        assert_ne!(bench.read(SR1) & SB, 0);
        bench.write(DR, 0x50 << 1 | 1);
        bench.run(100_000);
        bench.read(SR1);
        bench.read(SR2);
        bench.run(1_000_000);
        assert_eq!(bench.ram[..4], [1, 2, 3, 0]);
        let chip: &mut Pattern = bench.part.i2c[0].inner.chip_mut(0).unwrap();
        assert_eq!(chip.lasts(), [false, false, true]);
        assert_ne!(bench.read(CR1) & ACK, 0, "the program's own bit stays");
        bench.write(CR1, PE | ACK | STOP);
        assert_eq!(bench.read(SR2) & BUSY, 0);
    }

    #[test]
    fn a_start_waits_while_somebody_holds_the_bus() {
        let mut bench = bench();
        bench.hold_i2c1_low(true);
        assert_ne!(bench.read(SR2) & BUSY, 0);
        bench.write(CR1, PE | ACK | START);
        assert_eq!(bench.read(SR1) & SB, 0);
        bench.hold_i2c1_low(false);
        assert_ne!(bench.read(SR1) & SB, 0);
    }
}

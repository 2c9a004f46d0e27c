//! The part's peripherals as seen from the board, beside its pins' levels.

use rigless::device::{DeviceContext, Level, RegisterFile};
use rigless::soc::stm32f427::generated as g;
use rigless::soc::stm32f427::peripherals::tim::Channel;
use rigless::time::VirtualNanos;

use super::Stm32f411;
use crate::peripherals::spi_slave::SpiSlave;

impl Stm32f411 {
    /// Puts `level` on the input of a channel (1 to 4) of TIM2 (0) or TIM3 (1).
    ///
    /// # Panics
    /// When there is no such channel or timer.
    pub fn drive_timer(&mut self, now: VirtualNanos, nth: usize, channel: u8, level: Level) {
        let channel = Channel::new(channel).expect("a timer has four channels");
        let (registers, mut context) = self.bus.drive(now, self.slots.tim[nth]);
        self.tim[nth].drive_input(channel, level, registers, &mut context);
    }

    /// The share of the time that a channel (1 to 4) of TIM4 is high, 0..=1; none while its output is off.
    ///
    /// # Panics
    /// When there is no such channel.
    pub fn pwm_duty(&self, now: VirtualNanos, channel: u8) -> Option<f64> {
        self.pwm.duty(now, channel, self.block(self.slots.pwm))
    }

    /// The level TIM1 puts out on a channel (1 to 4); `None` while it drives none, as until its outputs'
    /// own switch is on (RM0383 section 12.4.18, MOE).
    ///
    /// # Panics
    /// When there is no such channel.
    pub fn tim1_output(&self, channel: u8) -> Option<Level> {
        let channel = Channel::new(channel).expect("a timer has four channels");
        self.tim1.output(channel, self.block(self.slots.tim1))
    }

    /// Drives an input of the SPI slave.
    pub fn drive_spi<T>(
        &mut self,
        now: VirtualNanos,
        input: impl FnOnce(&mut SpiSlave, &mut RegisterFile, &mut DeviceContext<'_>) -> T,
    ) -> T {
        let (registers, mut context) = self.bus.drive(now, self.slots.spi);
        input(&mut self.spi, registers, &mut context)
    }

    /// The SPI slave's registers.
    pub fn spi_registers(&self) -> &RegisterFile {
        self.block(self.slots.spi)
    }

    /// A device on I2C1's bus holds a line low, or releases it.
    pub fn hold_i2c1_low(&mut self, now: VirtualNanos, held: bool) {
        let (registers, mut context) = self.bus.drive(now, self.slots.i2c1);
        self.i2c[0].hold_low(held, registers, &mut context);
    }

    /// A device on I2C1's bus stretches the clock, or releases it.
    pub fn stretch_i2c1(&mut self, now: VirtualNanos, stretched: bool) {
        let (registers, mut context) = self.bus.drive(now, self.slots.i2c1);
        self.i2c[0].stretch(stretched, registers, &mut context);
    }

    /// I2C1 sees a bus error that is none.
    pub fn raise_i2c1_bus_error(&mut self, now: VirtualNanos) {
        let (registers, mut context) = self.bus.drive(now, self.slots.i2c1);
        self.i2c[0].raise_bus_error(registers, &mut context);
    }

    /// I2C1 loses the arbitration; whether it was master.
    pub fn lose_i2c1_arbitration(&mut self, now: VirtualNanos) -> bool {
        let (registers, mut context) = self.bus.drive(now, self.slots.i2c1);
        self.i2c[0].lose_arbitration(registers, &mut context)
    }

    /// The crystal stops for good.
    pub fn fail_crystal(&mut self, now: VirtualNanos) {
        let (registers, mut context) = self.bus.drive(now, self.slots.rcc);
        self.rcc.fail_hse(registers, &mut context);
        self.rcc.attach_crystals(0, 0);
        let error = &mut self.bus.drive(now, self.slots.i2c1).1;
        error.interrupt(1, Level::High);
    }

    /// The bit rate USART1 is set to, RM0383 section 19.3.4, or zero while it is off.
    pub fn usart1_baud(&self) -> u64 {
        let registers = self.block(self.slots.usart1);
        let clocks = self.block(self.slots.rcc);
        let divider = registers.get(g::usart6::Register::Brr) & 0xFFFF;
        let over8 = registers.get(g::usart6::Register::Cr1) >> 15 & 1 != 0;
        let sixteenths = if over8 {
            (divider >> 3) * 16 / 2 + (divider & 7)
        } else {
            divider
        };
        self.rcc.pclk2(clocks).checked_div(sixteenths).unwrap_or(0)
    }
}

//! GPIO pins: configuration at boot, single-access set, clear and read afterwards.
//!
//! Running code writes BSRR and reads IDR, both single accesses. The read-modify-write of the other
//! registers happens at boot, in the robot's priority (the two I2C pins during bus recovery) and in the
//! final safe state.

use crate::registers::Registers;
use stm32f4::stm32f411::gpioh::moder::MODE as Mode;
use stm32f4::stm32f411::{GPIOA, GPIOB, GPIOC, gpioh};

/// Output stage: push-pull, or open drain, which drives low only.
pub use stm32f4::stm32f411::gpioh::otyper::OUTPUT_TYPE as Driver;
/// Internal pull resistor, about 40 kΩ.
pub use stm32f4::stm32f411::gpioh::pupdr::PULL as Pull;

/// A GPIO port of the 64-pin package.
#[derive(Clone, Copy)]
pub enum Port {
    /// GPIOA.
    A,
    /// GPIOB.
    B,
    /// GPIOC.
    C,
}

/// One pin.
#[derive(Clone, Copy)]
pub struct Pin {
    port: Port,
    bit: u8,
}

impl Pin {
    /// Pin `bit` (0 ..= 15) of `port`.
    pub const fn new(port: Port, bit: u8) -> Self {
        Self { port, bit }
    }

    /// The bit number; the mask shows the compiler that it is in range.
    #[inline]
    const fn bit(self) -> u8 {
        self.bit & 15
    }

    #[inline]
    fn registers(self) -> &'static gpioh::RegisterBlock {
        let address = match self.port {
            Port::A => core::ptr::from_ref(GPIOA::registers()).cast(),
            Port::B => core::ptr::from_ref(GPIOB::registers()).cast(),
            Port::C => GPIOC::ptr(),
        };
        // SAFETY: all ports have one layout; the PAC types them apart for their reset values alone.
        unsafe { &*address }
    }

    /// Drives the pin high (releases it, open drain).
    #[inline]
    pub fn high(self) {
        self.registers()
            .bsrr()
            .write(|w| w.bs(self.bit()).set_bit());
    }

    /// Drives the pin low.
    #[inline]
    pub fn low(self) {
        self.registers()
            .bsrr()
            .write(|w| w.br(self.bit()).set_bit());
    }

    /// Drives the pin to `level`.
    #[inline]
    pub fn set(self, level: bool) {
        if level {
            self.high();
        } else {
            self.low();
        }
    }

    /// The level on the pin, whatever its function.
    #[inline]
    pub fn is_high(self) -> bool {
        self.registers().idr().read().bits() >> self.bit() & 1 != 0
    }

    /// Makes the pin an input.
    pub fn input(self, pull: Pull) {
        self.pull(pull);
        self.mode(Mode::Input);
    }

    /// Makes the pin an output; set its level first.
    pub fn output(self, driver: Driver) {
        self.driver(driver);
        self.mode(Mode::Output);
    }

    /// Connects the pin to alternate function `function` (0 ..= 15), RM0383 figure 17.
    pub fn alternate(self, function: u8, driver: Driver, pull: Pull) {
        self.driver(driver);
        self.pull(pull);
        let port = self.registers();
        let (field, function) = (self.bit() & 7, function & 15);
        if self.bit() < 8 {
            port.afrl().modify(|_, w| w.afr(field).set(function));
        } else {
            port.afrh().modify(|_, w| w.afr(field).set(function));
        }
        self.mode(Mode::Alternate);
    }

    /// Disconnects the digital side, for the ADC.
    pub fn analog(self) {
        self.pull(Pull::Floating);
        self.mode(Mode::Analog);
    }

    /// Sets the edge rate to "fast": a few nanoseconds, for the SPI's data output.
    pub fn fast(self) {
        let port = self.registers();
        port.ospeedr()
            .modify(|_, w| w.ospeedr(self.bit()).high_speed());
    }

    #[inline]
    fn mode(self, mode: Mode) {
        let port = self.registers();
        port.moder()
            .modify(|_, w| w.moder(self.bit()).variant(mode));
    }

    fn pull(self, pull: Pull) {
        let port = self.registers();
        port.pupdr()
            .modify(|_, w| w.pupdr(self.bit()).variant(pull));
    }

    fn driver(self, driver: Driver) {
        let port = self.registers();
        port.otyper()
            .modify(|_, w| w.ot(self.bit()).variant(driver));
    }
}

//! Pins: one word of configuration each, and single-instruction set, clear and read.

use stm32f4::stm32f411 as pac;

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

/// What holds an input when nobody drives it.
#[derive(Clone, Copy)]
pub enum Pull {
    /// The board or the other end does.
    None = 0b00,
    /// About 40 kΩ to 3.3 V.
    Up = 0b01,
    /// About 40 kΩ to ground.
    Down = 0b10,
}

/// How an output drives.
#[derive(Clone, Copy)]
pub enum Driver {
    /// High and low.
    PushPull = 0,
    /// Low only.
    OpenDrain = 1,
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
        Self {
            port,
            bit: bit & 15,
        }
    }

    /// All ports share one layout; the PAC types them apart for their reset values alone.
    #[inline]
    fn registers(self) -> &'static pac::gpioh::RegisterBlock {
        let address = match self.port {
            Port::A => pac::GPIOA::ptr().cast(),
            Port::B => pac::GPIOB::ptr().cast(),
            Port::C => pac::GPIOC::ptr(),
        };
        // SAFETY: the port's registers are at this address for as long as the part is powered.
        // Running code writes BSRR and reads IDR, both single accesses; the read-modify-write of the
        // others happens at boot, at the robot's priority (the two I2C pins, when a bus that is held
        // is clocked out), and in the final safe state.
        unsafe { &*address }
    }

    /// Drives the pin high (releases it, open drain).
    #[inline]
    pub fn high(self) {
        // SAFETY: every value of BSRR is defined; a set bit sets its pin and no other.
        self.registers()
            .bsrr()
            .write(|w| unsafe { w.bits(1 << self.bit) });
    }

    /// Drives the pin low.
    #[inline]
    pub fn low(self) {
        // SAFETY: every value of BSRR is defined; bit 16 + n clears pin n and no other.
        self.registers()
            .bsrr()
            .write(|w| unsafe { w.bits(0x1_0000 << self.bit) });
    }

    /// High or low.
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
        self.registers().idr().read().bits() >> self.bit & 1 != 0
    }

    /// Makes the pin an input.
    pub fn input(self, pull: Pull) {
        self.pull(pull);
        self.mode(0b00);
    }

    /// Makes the pin an output; set its level first.
    pub fn output(self, driver: Driver) {
        self.driver(driver);
        self.mode(0b01);
    }

    /// Hands the pin to alternate function `function` (0 ..= 15), RM0383 figure 17.
    pub fn alternate(self, function: u8, driver: Driver, pull: Pull) {
        let shift = u32::from(self.bit & 7) * 4;
        let field = |old: u32| old & !(0xF << shift) | u32::from(function & 15) << shift;
        self.driver(driver);
        self.pull(pull);
        let port = self.registers();
        // SAFETY: both registers are sixteen whole fields of four bits, each value a function.
        unsafe {
            if self.bit < 8 {
                port.afrl().modify(|r, w| w.bits(field(r.bits())));
            } else {
                port.afrh().modify(|r, w| w.bits(field(r.bits())));
            }
        }
        self.mode(0b10);
    }

    /// Disconnects the digital side for the ADC.
    pub fn analog(self) {
        self.pull(Pull::None);
        self.mode(0b11);
    }

    /// Edges of a few nanoseconds, for the SPI's data out.
    pub fn fast(self) {
        // SAFETY: sixteen whole fields of two bits.
        self.registers()
            .ospeedr()
            .modify(|r, w| unsafe { w.bits(self.pair(r.bits(), 0b10)) });
    }

    #[inline]
    fn mode(self, mode: u32) {
        // SAFETY: sixteen whole fields of two bits.
        self.registers()
            .moder()
            .modify(|r, w| unsafe { w.bits(self.pair(r.bits(), mode)) });
    }

    fn pull(self, pull: Pull) {
        // SAFETY: sixteen whole fields of two bits; 0b11 is reserved and `Pull` cannot say it.
        self.registers()
            .pupdr()
            .modify(|r, w| unsafe { w.bits(self.pair(r.bits(), pull as u32)) });
    }

    fn driver(self, driver: Driver) {
        // SAFETY: sixteen single bits.
        self.registers().otyper().modify(|r, w| unsafe {
            w.bits(r.bits() & !(1 << self.bit) | (driver as u32) << self.bit)
        });
    }

    #[inline]
    fn pair(self, old: u32, value: u32) -> u32 {
        let shift = u32::from(self.bit) * 2;
        old & !(0b11 << shift) | value << shift
    }
}

//! The part's pins as seen from the board: the levels on them, and their configuration.

use rigless::device::{Level, RegisterFile};
use rigless::soc::stm32f427::generated::gpioa::Register;
use rigless::soc::stm32f427::generated::rcc::Register::Bdcr;
use rigless::soc::stm32f427::peripherals::gpio::{self, Gpio};
use rigless::time::VirtualNanos;

use super::Stm32f411;
use crate::pin::Pin;

/// `RCC_BDCR`'s bit 0.
const LSEON: u64 = 1;

fn gpio(pin: Pin) -> gpio::Pin {
    gpio::Pin::new(pin.number).expect("a port has sixteen pins")
}

/// What a pin is configured to be, RM0383 section 8.4.1.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Role {
    /// A digital input.
    Input,
    /// A digital output.
    Output,
    /// The alternate function with this number.
    Function(u8),
    /// Analog.
    Analog,
}

impl Stm32f411 {
    /// Puts `level` on a pin from outside, or lets it float.
    pub fn drive_pin(&mut self, now: VirtualNanos, pin: Pin, level: Option<Level>) {
        let (registers, mut context) = self.bus.drive(now, self.slots.gpio[pin.port]);
        self.gpio[pin.port].drive(gpio(pin), level, registers, &mut context);
    }

    /// What the pin is configured to be.
    pub fn role(&self, pin: Pin) -> Role {
        let registers = self.port(pin);
        match registers.get(Register::Moder) >> (pin.number * 2) & 3 {
            0 => Role::Input,
            1 => Role::Output,
            2 => Role::Function(Gpio::function(gpio(pin), registers).unwrap_or_default()),
            _ => Role::Analog,
        }
    }

    /// The pin's `PUPDR` code: 0 without a pull, 1 with its pull-up.
    pub fn pull(&self, pin: Pin) -> u64 {
        self.port(pin).get(Register::Pupdr) >> (pin.number * 2) & 3
    }

    /// Whether its output only pulls low.
    pub(super) fn is_open_drain(&self, pin: Pin) -> bool {
        self.port(pin).get(Register::Otyper) >> pin.number & 1 != 0
    }

    /// The fastest square wave that its output follows at 2.7 V and 30 to 50 pF, hertz: DS10314 6.3.16.
    pub(super) fn fastest(&self, pin: Pin) -> u64 {
        match self.port(pin).get(Register::Ospeedr) >> (pin.number * 2) & 3 {
            0 => 4_000_000,
            1 => 25_000_000,
            2 => 50_000_000,
            _ => 100_000_000,
        }
    }

    /// The level the firmware drives on a pin, `None` where it drives none: the low-speed oscillator has PC14
    /// and PC15 while it is on (RM0383, 8.3.13).
    pub fn output(&self, pin: Pin) -> Option<Level> {
        let lse_is_on = self.block(self.slots.rcc).get(Bdcr) & LSEON != 0;
        let taken = lse_is_on && pin.port == 2 && pin.number >= 14;
        if taken || self.role(pin) != Role::Output {
            return None;
        }
        let high = self.port(pin).get(Register::Odr) >> pin.number & 1 != 0;
        (!(high && self.is_open_drain(pin))).then_some(Level::from(high))
    }

    fn port(&self, pin: Pin) -> &RegisterFile {
        self.block(self.slots.gpio[pin.port])
    }
}

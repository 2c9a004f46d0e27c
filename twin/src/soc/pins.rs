//! The part's pins as the board sees them: what is on the wire, and what the firmware makes of it.

use rigless::device::{Level, RegisterFile};
use rigless::soc::stm32f427::generated::gpioa::Register;
use rigless::soc::stm32f427::peripherals::gpio::{self, Gpio};
use rigless::time::VirtualNanos;

use super::Stm32f411;

/// A pin of the part.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Hash)]
pub struct Pin {
    /// Its port's place in [`super::memory_map::PORTS`].
    pub port: usize,
    /// 0 to 15.
    pub number: u8,
}

/// The pin `P<port><number>`.
///
/// # Panics
/// When the part has no such port or pin; the names are constants of this crate.
#[must_use]
pub const fn pin(port: char, number: u8) -> Pin {
    let port = match port {
        'A' => 0,
        'B' => 1,
        'C' => 2,
        'D' => 3,
        'E' => 4,
        'H' => 5,
        _ => panic!("ports A to E and H"),
    };
    assert!(number < 16, "a port has sixteen pins");
    Pin { port, number }
}

impl Pin {
    fn gpio(self) -> gpio::Pin {
        gpio::Pin::new(self.number).expect("checked when the pin was named")
    }
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
        self.gpio[pin.port].drive(pin.gpio(), level, registers, &mut context);
    }

    /// The level on the wire of a pin.
    #[must_use]
    pub fn pin_level(&self, pin: Pin) -> Level {
        self.gpio[pin.port].level(pin.gpio(), self.port(pin))
    }

    /// What the pin is configured to be.
    #[must_use]
    pub fn role(&self, pin: Pin) -> Role {
        let registers = self.port(pin);
        match registers.get(Register::Moder) >> (pin.number * 2) & 3 {
            0 => Role::Input,
            1 => Role::Output,
            2 => Role::Function(Gpio::function(pin.gpio(), registers).unwrap_or_default()),
            _ => Role::Analog,
        }
    }

    /// The level the firmware drives on a pin, `None` where it drives none.
    #[must_use]
    pub fn output(&self, pin: Pin) -> Option<Level> {
        let registers = self.port(pin);
        let bit = |register| registers.get(register) >> pin.number & 1 != 0;
        match self.role(pin) {
            Role::Output => {
                let high = bit(Register::Odr);
                let open_drain = bit(Register::Otyper);
                (!(high && open_drain)).then_some(Level::from(high))
            }
            _ => None,
        }
    }

    fn port(&self, pin: Pin) -> &RegisterFile {
        self.bus.slots()[self.slots.gpio[pin.port]].registers()
    }
}

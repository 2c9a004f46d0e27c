//! Why the part was reset (RM0383, 6.3.21).

use stm32f4::stm32f411 as pac;

/// The most telling of the flags.
#[derive(Clone, Copy, PartialEq, Eq)]
pub enum Cause {
    /// Power came up.
    Power,
    /// NRST: the Pi or the button.
    Pin,
    /// The independent watchdog: the firmware hung or ended in the safe state.
    Watchdog,
    /// The firmware itself, in the safe state with a dead watchdog, or a debugger.
    Software,
}

impl Cause {
    /// For the log.
    pub const fn name(self) -> &'static str {
        match self {
            Self::Power => "power-on",
            Self::Pin => "reset by pin",
            Self::Watchdog => "the watchdog's reset",
            Self::Software => "its own reset",
        }
    }

    /// Whether the firmware failed before.
    pub const fn is_fault(self) -> bool {
        matches!(self, Self::Watchdog | Self::Software)
    }
}

/// Reads the cause and clears it for the next time.
pub fn cause() -> Cause {
    // SAFETY: boot runs alone.
    let rcc = unsafe { &*pac::RCC::ptr() };
    let flags = rcc.csr().read();
    rcc.csr().modify(|_, w| w.rmvf().set_bit());
    // Every internal reset pulls the pin too, so the pin comes last.
    if flags.wdgrstf().bit_is_set() || flags.wwdgrstf().bit_is_set() {
        Cause::Watchdog
    } else if flags.sftrstf().bit_is_set() {
        Cause::Software
    } else if flags.porrstf().bit_is_set() || flags.borrstf().bit_is_set() {
        Cause::Power
    } else {
        Cause::Pin
    }
}

//! Reset cause (RM0383, 6.3.21).

use crate::registers::Registers;
use stm32f4::stm32f411::RCC;

/// Reset cause, the most specific of the flags.
#[derive(Clone, Copy, PartialEq, Eq)]
pub enum Cause {
    Power,
    /// The supply fell below the brown-out level, as motors that stall on a weak battery make it.
    BrownOut,
    /// NRST: the Pi or the button.
    Pin,
    /// A watchdog: the firmware hung or ended in the safe state.
    Watchdog,
    /// Software: the safe state without a working watchdog, or a debugger.
    Software,
}

impl Cause {
    /// Text for the log.
    pub const fn name(self) -> &'static str {
        match self {
            Self::Power => "power-on",
            Self::BrownOut => "brown-out",
            Self::Pin => "reset by pin",
            Self::Watchdog => "watchdog reset",
            Self::Software => "software reset",
        }
    }

    /// Whether the firmware or its supply failed before the reset.
    pub const fn is_fault(self) -> bool {
        !matches!(self, Self::Power | Self::Pin)
    }
}

/// Reads the cause and clears the flags.
// Not inlined: boot's log line would be repeated for each cause.
#[inline(never)]
pub fn cause() -> Cause {
    let rcc = RCC::registers();
    let flags = rcc.csr().read();
    rcc.csr().modify(|_, w| w.rmvf().set_bit());
    // Every internal reset pulls the pin too, so the pin comes last.
    if flags.wdgrstf().bit_is_set() || flags.wwdgrstf().bit_is_set() {
        Cause::Watchdog
    } else if flags.sftrstf().bit_is_set() {
        Cause::Software
    } else if flags.porrstf().bit_is_set() {
        // It sets the brown-out's flag too.
        Cause::Power
    } else if flags.borrstf().bit_is_set() {
        Cause::BrownOut
    } else {
        Cause::Pin
    }
}

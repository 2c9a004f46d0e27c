//! Reset cause (RM0383, 6.3.21).

use crate::registers::Registers;
use core::cell::UnsafeCell;
use core::mem::MaybeUninit;
use stm32f4::stm32f411::RCC;

/// Reset cause, the most specific of the flags.
#[derive(Clone, Copy, PartialEq, Eq)]
pub enum Cause {
    Power,
    /// NRST: the Pi or the button.
    Pin,
    /// A debugger, as after flashing.
    Software,
    /// The supply fell below the brown-out level, as motors that stall on a weak battery make it.
    BrownOut,
    /// A watchdog: the firmware hung or ended in the safe state.
    Watchdog,
    /// The safe state, where the watchdog has not come first.
    SafeState,
}

/// A word that a reset leaves as it is.
pub struct Kept(UnsafeCell<MaybeUninit<u32>>);

// SAFETY: accessed by volatile words, at boot and right before a reset.
unsafe impl Sync for Kept {}

impl Kept {
    /// For a static in `.uninit`.
    pub const fn new() -> Self {
        Self(UnsafeCell::new(MaybeUninit::uninit()))
    }

    /// Marks the reset that follows.
    pub fn mark(&self) {
        let word: *mut u32 = self.0.get().cast();
        // SAFETY: RAM, aligned. Its own address is what the RAM holds by chance as rarely as any other word.
        unsafe { word.write_volatile(word as u32) };
    }

    /// Whether the reset was marked; clears the mark.
    pub fn take(&self) -> bool {
        let word: *mut u32 = self.0.get().cast();
        // SAFETY: as above; any pattern is a word.
        unsafe {
            let found = word.read_volatile() == word as u32;
            word.write_volatile(0);
            found
        }
    }
}

/// Marked by the safe state's own reset.
#[unsafe(link_section = ".uninit.reset")]
pub static SAFE_STATE: Kept = Kept::new();

impl Cause {
    /// Text for the log.
    pub const fn name(self) -> &'static str {
        match self {
            Self::Power => "power-on",
            Self::BrownOut => "brown-out",
            Self::Pin => "reset by pin",
            Self::Watchdog => "watchdog reset",
            Self::SafeState | Self::Software => "software reset",
        }
    }

    /// Whether the firmware or its supply failed before the reset.
    pub const fn is_fault(self) -> bool {
        !matches!(self, Self::Power | Self::Pin | Self::Software)
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
        if SAFE_STATE.take() {
            Cause::SafeState
        } else {
            Cause::Software
        }
    } else if flags.porrstf().bit_is_set() {
        // It sets the brown-out's flag too.
        Cause::Power
    } else if flags.borrstf().bit_is_set() {
        Cause::BrownOut
    } else {
        Cause::Pin
    }
}

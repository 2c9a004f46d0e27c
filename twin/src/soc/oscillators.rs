//! The time that the crystal and the PLL take to become ready, which `rigless` leaves out: the program must wait.

use rigless::soc::stm32f427::generated as g;
use rigless::soc::stm32f427::generated::rcc::Register::Cr;
use rigless::time::VirtualNanos;

use super::Stm32f411;

/// A time of the part in instructions: before the switch to the PLL the part retires 16 in a microsecond, the
/// emulated core 100.
const fn scaled(ns: u64) -> u64 {
    ns * 16 / 100
}

/// The crystal's start, typically, nanoseconds (DS10314, table 37).
const HSE_NS: u64 = scaled(2_000_000);
/// The PLL's longest time to lock (table 41).
const PLL_NS: u64 = scaled(300_000);

/// Since when the crystal and the PLL have been on.
#[derive(Debug, Default)]
pub struct OnSince([Option<VirtualNanos>; 2]);

impl Stm32f411 {
    /// Sets the ready flags, for which a switch to the PLL must wait here: never without a crystal (RM0383
    /// section 6.2.1), where `rigless` sets its flag all the same.
    pub(super) fn update_ready_flags(&mut self, now: VirtualNanos) {
        let crystal = self.rcc.crystals().0 != 0;
        let registers = self.bus.slot_mut(self.slots.rcc).registers_mut();
        let before = registers.get(Cr);
        let sources = [
            (g::rcc::cr::HSEON, g::rcc::cr::HSERDY, HSE_NS, crystal),
            (g::rcc::cr::PLLON, g::rcc::cr::PLLRDY, PLL_NS, true),
        ];
        let (mut control, mut wakes) = (before, [None; 2]);
        let since = self.on_since.0.iter_mut().zip(&mut wakes);
        for ((since, wake), (on, ready, ns, works)) in since.zip(sources) {
            let begins = since.is_none() && on.is_set(control);
            *since = on.is_set(control).then(|| since.unwrap_or(now));
            *wake = begins.then_some(VirtualNanos(now.0 + ns));
            let is_ready = works && since.is_some_and(|since| now.0 - since.0 >= ns);
            control = ready.set(control, is_ready.into());
        }
        if control != before {
            registers.set(Cr, control);
        }
        for wake in wakes.into_iter().flatten() {
            self.wake_at(now, wake);
        }
    }
}

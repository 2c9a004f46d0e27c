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

impl Stm32f411 {
    /// Sets the ready flags, for which a switch to the PLL must wait here: never without a crystal (RM0383
    /// section 6.2.1), where `rigless` sets its flag all the same.
    pub(super) fn update_ready_flags(&mut self, now: VirtualNanos) {
        let crystal = self.rcc.crystals().0 != 0;
        let before = self.block(self.slots.rcc).get(Cr);
        let mut control = before;
        let sources = [
            (g::rcc::cr::HSEON, g::rcc::cr::HSERDY, HSE_NS, crystal),
            (g::rcc::cr::PLLON, g::rcc::cr::PLLRDY, PLL_NS, true),
        ];
        for (nth, (on, ready, ns, works)) in sources.into_iter().enumerate() {
            let before = self.on_since[nth];
            let since = on.is_set(control).then(|| before.unwrap_or(now));
            self.on_since[nth] = since;
            if since.is_some() && before.is_none() {
                self.wake_at(now, VirtualNanos(now.0 + ns));
            }
            let is_ready = works && since.is_some_and(|since| now.0 - since.0 >= ns);
            control = ready.set(control, is_ready.into());
        }
        if control != before {
            let registers = self.bus.slot_mut(self.slots.rcc).registers_mut();
            registers.set(Cr, control);
        }
    }
}

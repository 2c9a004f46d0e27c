//! The independent watchdog (RM0383, 15): the last thing that still works when nothing else does.
//!
//! It runs from its own oscillator and is fed only by `main`'s loop, and only when the
//! robot's tick has completed since the last feeding: a dead tick, a handler that never returns, and
//! a main loop that never runs all end in a reset, and a reset is motors off.

use core::sync::atomic::{AtomicBool, Ordering};
use stm32f4::stm32f411 as pac;

/// Counts of the LSI divided by 16: 100 ms at the typical 32 kHz, 68 to 188 ms over its tolerance.
const RELOAD: u16 = 200;

/// The robot's priority has completed a tick since the last feeding.
static TICKED: AtomicBool = AtomicBool::new(false);

fn registers() -> &'static pac::iwdg::RegisterBlock {
    // SAFETY: the registers are at this address for as long as the part is powered; after boot only
    // the single store of the key remains.
    unsafe { &*pac::IWDG::ptr() }
}

/// Starts it; there is no way to stop it again.
pub fn start() {
    let watchdog = registers();
    watchdog.kr().write(|w| w.key().start());
    watchdog.kr().write(|w| w.key().unlock());
    watchdog.pr().write(|w| w.pr().divide_by16());
    watchdog.rlr().write(|w| w.rl().set(RELOAD));
    // Five cycles of the LSI at most (RM0383, 15.4.4). Should it take longer, the reset value's
    // 512 ms apply until the next feeding.
    for _ in 0..10_000 {
        if watchdog.sr().read().bits() == 0 {
            break;
        }
    }
    feed();
}

/// Gives another 100 ms. At boot the bounded waits call it; afterwards [`feed_if_ticked`] alone.
pub fn feed() {
    registers().kr().write(|w| w.key().feed());
}

/// The tick's half of the feeding.
pub fn ticked() {
    TICKED.store(true, Ordering::Release);
}

/// The main loop's half of the feeding.
// Requirement: WIRE-safe-2
pub fn feed_if_ticked() {
    if TICKED.swap(false, Ordering::AcqRel) {
        feed();
    }
}

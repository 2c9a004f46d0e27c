//! The independent watchdog (RM0383, 15), and `SysTick` as a faster one for the ticks.
//!
//! The watchdog runs from its own oscillator. After boot only the idle loop feeds it, and only if a tick has
//! completed since: a lost tick, a handler that does not return and an idle loop that does not run all
//! end in a reset, which turns the motors off. A lost tick and a handler of the robot's priority that does not
//! return reach the safe state before that: each tick restarts `SysTick`'s count.

use crate::clock::APB2_HZ;
use crate::registers::Registers;
use core::sync::atomic::{AtomicBool, Ordering};
use cortex_m::peripheral::SYST;
use cortex_m::peripheral::syst::SystClkSource;
use stm32f4::stm32f411::IWDG;

/// Counts of the LSI divided by 16: 100 ms at the typical 32 kHz, 68 to 188 ms over its tolerance.
const RELOAD: u16 = 200;

/// Counts of the core's clock from a tick to the safe state: 30 ms, two ticks late.
const TICK_LIMIT: u32 = 30 * (APB2_HZ / 1000);

/// A tick has completed since the last feeding.
static TICKED: AtomicBool = AtomicBool::new(false);

/// Starts the watchdog; only a reset stops it.
pub fn start() {
    let watchdog = IWDG::registers();
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

/// Restarts the 100 ms; after boot only by [`feed_if_ticked`].
pub fn feed() {
    IWDG::registers().kr().write(|w| w.key().feed());
}

/// Starts `SysTick`, whose exception is the safe state.
pub fn await_ticks(timer: &mut SYST) {
    timer.set_clock_source(SystClkSource::Core);
    timer.set_reload(TICK_LIMIT);
    timer.clear_current();
    timer.enable_counter();
    timer.enable_interrupt();
}

/// Reports a completed tick.
pub fn ticked() {
    // SAFETY: one store, of a register that only this function writes after boot; it restarts the count.
    unsafe { (*SYST::PTR).cvr.write(0) };
    TICKED.store(true, Ordering::Release);
}

/// Feeds if a tick has completed since the last feeding; for the idle loop.
// Requirement: WIRE-safe-2
pub fn feed_if_ticked() {
    if TICKED.swap(false, Ordering::AcqRel) {
        feed();
    }
}

//! TIM5: the microsecond clock and the end of a trigger pulse.
//!
//! The counter runs free over all 32 bits. Compare 1 is the tick, compare 2 ends the rangefinders'
//! trigger pulse, compare 3 starts the battery's conversion shortly before a tick, compare 4 ends boot's
//! naps.

use crate::clock::APB1_TIMER_HZ;
use crate::registers::Registers;
use cortex_m::interrupt::free;
use cortex_m::peripheral::NVIC;
use fw_core::types::Micros;
use stm32f4::stm32f411::{Interrupt, TIM5};

/// The trigger pulse, microseconds: at least 10 (US-015), one more for where in a count it began,
/// and one to spare.
const TRIGGER: u32 = 12;

/// Starts the clock at 0; no interrupt yet.
pub fn start() {
    let timer = TIM5::registers();
    timer
        .psc()
        .write(|w| w.psc().set((APB1_TIMER_HZ / 1_000_000 - 1) as u16));
    timer.arr().write(|w| w.arr().set(u32::MAX));
    // The prescaler takes effect at an update only.
    timer.egr().write(|w| w.ug().set_bit());
    timer.sr().reset();
    timer.cr1().write(|w| w.cen().set_bit());
}

/// Now.
#[inline]
pub fn now() -> Micros {
    Micros(TIM5::registers().cnt().read().bits())
}

/// Waits until `ready`, at most `limit` microseconds; whether it became so.
pub fn wait(limit: u32, mut ready: impl FnMut() -> bool) -> bool {
    let begin = now();
    loop {
        if ready() {
            return true;
        }
        if now().since(begin) > limit {
            return false;
        }
    }
}

/// Sleeps for `span` microseconds, or until an interrupt is pending; for boot, which runs with
/// interrupts masked.
pub fn sleep(span: u32) {
    let timer = TIM5::registers();
    timer.ccr4().write(|w| w.ccr().set(now().after(span).0));
    timer.sr().reset();
    timer.dier().write(|w| w.cc4ie().set_bit());
    // SAFETY: masked, so the handler does not run; the pending interrupt is what wakes.
    unsafe { NVIC::unmask(Interrupt::TIM5) };
    cortex_m::asm::wfi();
    NVIC::mask(Interrupt::TIM5);
    timer.dier().reset();
    timer.sr().reset();
    NVIC::unpend(Interrupt::TIM5);
}

/// Ends the pulse that `begin` starts, [`TRIGGER`] microseconds later.
pub fn pulse(begin: impl FnOnce()) {
    let timer = TIM5::registers();
    free(|_| {
        begin();
        timer.ccr2().write(|w| w.ccr().set(now().after(TRIGGER).0));
        timer.sr().write(|w| w.cc2if().clear_bit());
        timer.dier().modify(|_, w| w.cc2ie().set_bit());
    });
}

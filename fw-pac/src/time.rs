//! TIM5: the robot's clock in microseconds, the 100 Hz tick, and the end of a trigger pulse.
//!
//! The counter runs free over all 32 bits. Compare 1 is the tick, compare 2 ends the rangefinders'
//! trigger pulse, compare 3 starts the battery's conversion shortly before a tick. The interrupt is
//! above the robot's priority and only latches: both encoders and the time go into a slot in one
//! masked stretch of a few instructions, so however long the robot takes over a frame, the sample it
//! gets next is of the tick's instant.

use crate::clock::APB1_TIMER_HZ;
use crate::{adc, encoders, exti, rangefinders};
use core::cell::Cell;
use cortex_m::interrupt::{free, CriticalSection, Mutex};
use cortex_m::peripheral::NVIC;
use fw_core::robot::Sample;
use fw_core::types::Micros;
use stm32f4::stm32f411::{self as pac, interrupt, Interrupt};

/// Microseconds from tick to tick: the core's 100 Hz.
// Requirement: DOC-5.2.2-5
const TICK: u32 = 10_000;
/// How long before a tick its battery words are measured, microseconds.
const BATTERY_LEAD: u32 = 200;
/// The trigger pulse, microseconds: at least 10 (US-015), one more for where in a count it began,
/// and one to spare.
const TRIGGER: u32 = 12;

/// The sample latched last, until the robot takes it; a later one replaces it.
static LATCHED: Mutex<Cell<Option<Sample>>> = Mutex::new(Cell::new(None));

fn registers() -> &'static pac::tim5::RegisterBlock {
    // SAFETY: the registers are at this address for as long as the part is powered. This module is
    // their only user; what is written from two priorities is written masked.
    unsafe { &*pac::TIM5::ptr() }
}

/// Starts the clock at 0; no interrupt yet.
pub fn start() {
    let timer = registers();
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
    Micros(registers().cnt().read().bits())
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
pub fn doze(span: u32) {
    let timer = registers();
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

/// A sample of this instant: masked, so that nothing comes between its parts.
#[inline]
pub fn sample(_: &CriticalSection) -> Sample {
    let (left, right) = encoders::read();
    Sample {
        now: now(),
        left,
        right,
    }
}

/// The first tick comes one period from now, and its battery words shortly before.
// Requirement: DOC-3.1-3
pub fn start_ticks() {
    let timer = registers();
    let tick = now().after(TICK);
    timer.ccr1().write(|w| w.ccr().set(tick.0));
    timer
        .ccr3()
        .write(|w| w.ccr().set(tick.0.wrapping_sub(BATTERY_LEAD)));
    timer.sr().reset();
    timer.dier().write(|w| {
        w.cc1ie().set_bit();
        w.cc3ie().set_bit()
    });
}

/// Ends the pulse that `begin` starts, [`TRIGGER`] microseconds later.
pub fn pulse(begin: impl FnOnce()) {
    let timer = registers();
    free(|_| {
        begin();
        timer.ccr2().write(|w| w.ccr().set(now().after(TRIGGER).0));
        timer.sr().write(|w| {
            // Ones leave their flags alone; a 0 clears compare 2's stale match.
            keep_all(w).cc2if().clear_bit()
        });
        timer.dier().modify(|_, w| w.cc2ie().set_bit());
    });
}

/// When the sample that [`claim`] would give was latched.
#[inline]
pub fn latched(token: &CriticalSection) -> Option<Micros> {
    LATCHED.borrow(token).get().map(|sample| sample.now)
}

/// The sample latched last and not yet claimed.
#[inline]
pub fn claim(token: &CriticalSection) -> Option<Sample> {
    LATCHED.borrow(token).take()
}

/// Every flag is cleared by a 0 and left by a 1 (RM0383, 13.4.5).
fn keep_all(w: &mut pac::tim2::sr::W) -> &mut pac::tim2::sr::W {
    // SAFETY: a 1 never sets a flag.
    unsafe { w.bits(u32::MAX) }
}

// Requirement: DOC-3.1-1
#[interrupt]
fn TIM5() {
    let timer = registers();
    let flags = timer.sr().read();
    let enabled = timer.dier().read();
    if flags.cc2if().bit_is_set() && enabled.cc2ie().bit_is_set() {
        rangefinders::end_trigger();
        timer.dier().modify(|_, w| w.cc2ie().clear_bit());
        timer.sr().write(|w| keep_all(w).cc2if().clear_bit());
    }
    if flags.cc1if().bit_is_set() {
        free(|token| LATCHED.borrow(token).set(Some(sample(token))));
        let next = timer.ccr1().read().bits().wrapping_add(TICK);
        timer.ccr1().write(|w| w.ccr().set(next));
        timer
            .ccr3()
            .write(|w| w.ccr().set(next.wrapping_sub(BATTERY_LEAD)));
        timer.sr().write(|w| keep_all(w).cc1if().clear_bit());
        exti::wake_robot();
    }
    if flags.cc3if().bit_is_set() {
        adc::begin();
        timer.sr().write(|w| keep_all(w).cc3if().clear_bit());
    }
}

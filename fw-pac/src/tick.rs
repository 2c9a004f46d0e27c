//! TIM5's interrupt: latches the 100 Hz tick, ends trigger pulses, starts the battery's conversion.
//!
//! It has the highest priority and only latches: both encoders and the time go into a slot, so the sample
//! is of the tick's instant, whatever the robot and the link are busy with.

use crate::registers::Registers;
use crate::{adc, clock, encoders, exti, rangefinders, time};
use core::cell::Cell;
use cortex_m::interrupt::{CriticalSection, Mutex};
use cortex_m::peripheral::SCB;
use fw_core::robot::TickInput;
use stm32f4::stm32f411::TIM5;

/// Microseconds between ticks: the core's 100 Hz.
// Requirement: DOC-5.2.2-5
const PERIOD: u32 = 10_000;
/// Microseconds from the battery's conversion to the tick that uses it.
const BATTERY_LEAD: u32 = 200;

/// The sample latched last, until the robot takes it; a later one replaces it.
pub static LATCHED: Mutex<Cell<Option<TickInput>>> = Mutex::new(Cell::new(None));

/// A sample of this instant: masked, so that nothing comes between its parts.
#[inline]
pub fn sample(_: &CriticalSection) -> TickInput {
    let (left, right) = encoders::read();
    TickInput {
        now: time::now(),
        left,
        right,
        supply_low: exti::take_supply_dip() | clock::supply_is_low(),
    }
}

/// The first tick comes one period from now, and its battery words shortly before.
// Requirement: DOC-3.1-3
pub fn start() {
    let timer = TIM5::registers();
    schedule(time::now().0);
    timer.sr().reset();
    timer.dier().write(|w| {
        w.cc1ie().set_bit();
        w.cc3ie().set_bit()
    });
}

/// Sets the compare registers for the tick that follows the one at `last`.
#[inline]
fn schedule(last: u32) {
    let timer = TIM5::registers();
    let next = last.wrapping_add(PERIOD);
    timer.ccr1().write(|w| w.ccr().set(next));
    timer
        .ccr3()
        .write(|w| w.ccr().set(next.wrapping_sub(BATTERY_LEAD)));
}

/// A compare event of the timer.
#[inline]
pub fn on_timer(token: &CriticalSection) {
    let timer = TIM5::registers();
    let flags = timer.sr().read();
    let enabled = timer.dier().read();
    // At once: a clear that is still under way at the exception's return would raise it again.
    // SAFETY: a 1 leaves its flag.
    timer.sr().write(|w| unsafe { w.bits(!flags.bits()) });
    if flags.cc2if().bit_is_set() && enabled.cc2ie().bit_is_set() {
        rangefinders::end_trigger();
        timer.dier().modify(|_, w| w.cc2ie().clear_bit());
    }
    if flags.cc1if().bit_is_set() {
        LATCHED.borrow(token).set(Some(sample(token)));
        schedule(timer.ccr1().read().bits());
        SCB::set_pendsv();
    }
    if flags.cc3if().bit_is_set() {
        adc::begin();
    }
}

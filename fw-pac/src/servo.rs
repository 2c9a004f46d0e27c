//! The servo of the swept rangefinder: TIM1 channel 1 on PA8, in single pulses.
//!
//! Every pulse is started by a tick of the robot and timed by the counter: 1 µs low, then high until the
//! counter overflows and stops itself (one-pulse mode, RM0383, 12.3.10). So a robot that no longer
//! ticks sends no more pulses, and a servo without pulses has no force.

use crate::board::SERVO;
use crate::clock::APB2_HZ;
use crate::gpio::{Driver, Pull};
use stm32f4::stm32f411 as pac;

fn registers() -> &'static pac::tim1::RegisterBlock {
    // SAFETY: the registers are at this address for as long as the part is powered; boot and then the
    // robot's priority are their only users.
    unsafe { &*pac::TIM1::ptr() }
}

/// The timer ready for its first pulse, the pin its own.
pub fn start() {
    let timer = registers();
    timer
        .psc()
        .write(|w| w.psc().set((APB2_HZ / 1_000_000 - 1) as u16));
    timer.ccr1().write(|w| w.ccr().set(1));
    // High from the compare value on: low at rest, where the counter stands at 0.
    timer.ccmr1_output().write(|w| w.oc1m().pwm_mode2());
    timer.ccer().write(|w| w.cc1e().set_bit());
    // An advanced timer's outputs have a switch of their own.
    timer.bdtr().write(|w| w.moe().set_bit());
    // The prescaler takes effect at an update only.
    timer.egr().write(|w| w.ug().set_bit());
    SERVO.alternate(1, Driver::PushPull, Pull::Down);
}

/// One pulse of `width` microseconds, from now; the one before is over.
pub fn pulse(width: u16) {
    let timer = registers();
    timer.arr().write(|w| w.arr().set(width));
    timer.cr1().write(|w| {
        w.opm().set_bit();
        w.cen().set_bit()
    });
}

/// The pin low whatever the timer does: where boot begins and every failure ends.
pub fn force_off() {
    SERVO.low();
    SERVO.output(Driver::PushPull);
}

//! The servo of the swept rangefinder: TIM1 channel 1 on PA8, in single pulses.
//!
//! Each pulse is started by a tick and timed by the counter: 1 µs low, then high until the counter
//! overflows and stops (one-pulse mode, RM0383, 12.3.10). Without ticks there are no pulses, and a servo
//! without pulses has no force.

use crate::board::SERVO;
use crate::clock::APB2_HZ;
use crate::gpio::{Driver, Pull};
use crate::registers::Registers;
use stm32f4::stm32f411::TIM1;

/// Sets the timer up for its first pulse and connects the pin.
pub fn start() {
    let timer = TIM1::registers();
    timer
        .psc()
        .write(|w| w.psc().set((APB2_HZ / 1_000_000 - 1) as u16));
    timer.ccr1().write(|w| w.ccr().set(1));
    // High from the compare value on: low at rest, where the counter stands at 0.
    timer.ccmr1_output().write(|w| w.oc1m().pwm_mode2());
    timer.ccer().write(|w| w.cc1e().set_bit());
    // An advanced timer's outputs have a master enable.
    timer.bdtr().write(|w| w.moe().set_bit());
    // The prescaler takes effect at an update only.
    timer.egr().write(|w| w.ug().set_bit());
    SERVO.alternate(1, Driver::PushPull, Pull::PullDown);
}

/// Starts a pulse of `width` microseconds; the one before is over.
pub fn pulse(width: u16) {
    let timer = TIM1::registers();
    timer.arr().write(|w| w.arr().set(width));
    timer.cr1().write(|w| {
        w.opm().set_bit();
        w.cen().set_bit()
    });
}

/// Drives the pin low, whatever the timer does: at boot and in the safe state.
pub fn force_off() {
    SERVO.low();
    SERVO.output(Driver::PushPull);
}

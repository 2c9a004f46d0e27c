//! The wheel encoders: TIM2 (left, 32 bits) and TIM3 (right, 16 bits) count every edge of both
//! channels by themselves; the core knows how to unwrap them.

use crate::board::{ENCODER_LEFT_1, ENCODER_LEFT_2, ENCODER_RIGHT_1, ENCODER_RIGHT_2};
use crate::gpio::{Driver, Pull};
use stm32f4::stm32f411 as pac;

fn left() -> &'static pac::tim2::RegisterBlock {
    // SAFETY: the registers are at this address for as long as the part is powered; written at boot
    // alone, afterwards only the counter is read.
    unsafe { &*pac::TIM2::ptr() }
}

fn right() -> &'static pac::tim3::RegisterBlock {
    // SAFETY: as for the left.
    unsafe { &*pac::TIM3::ptr() }
}

/// Starts both counters at 0.
///
/// The filter wants eight equal samples at 12.5 MHz (`fDTS` = 100 MHz / 2, sampled at a quarter of it):
/// 0.64 µs of spike rejection, while the wheels' fastest edges are 300 µs apart.
pub fn start() {
    for pin in [ENCODER_LEFT_1, ENCODER_LEFT_2] {
        pin.alternate(1, Driver::PushPull, Pull::Up);
    }
    for pin in [ENCODER_RIGHT_1, ENCODER_RIGHT_2] {
        pin.alternate(2, Driver::PushPull, Pull::Up);
    }
    left().ccmr1_input().write(|w| {
        w.cc1s().ti1();
        w.cc2s().ti2();
        w.ic1f().fdts_div4_n8();
        w.ic2f().fdts_div4_n8()
    });
    left().smcr().write(|w| w.sms().encoder_mode_3());
    left().arr().write(|w| w.arr().set(u32::MAX));
    left().cr1().write(|w| {
        w.ckd().div2();
        w.cen().set_bit()
    });
    right().ccmr1_input().write(|w| {
        w.cc1s().ti1();
        w.cc2s().ti2();
        w.ic1f().fdts_div4_n8();
        w.ic2f().fdts_div4_n8()
    });
    right().smcr().write(|w| w.sms().encoder_mode_3());
    right().arr().write(|w| w.arr().set(u16::MAX));
    right().cr1().write(|w| {
        w.ckd().div2();
        w.cen().set_bit()
    });
}

/// Both counters, left and right, a few cycles apart.
#[inline]
pub fn read() -> (u32, u16) {
    (
        left().cnt().read().bits(),
        right().cnt().read().cnt().bits(),
    )
}

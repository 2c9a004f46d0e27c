//! The wheel encoders: TIM2 (left, 32 bits) and TIM3 (right, 16 bits) count every edge of both
//! channels in hardware; the core unwraps them.

use crate::board::{ENCODER_LEFT_1, ENCODER_LEFT_2, ENCODER_RIGHT_1, ENCODER_RIGHT_2};
use crate::gpio::{Driver, Pull};
use crate::registers::Registers;
use stm32f4::stm32f411::{TIM2, TIM3};

/// Starts both counters at 0.
///
/// The filter needs eight equal samples at 12.5 MHz (`fDTS` = 100 MHz / 2, sampled at a quarter of it):
/// 0.64 µs of spike rejection, while the wheels' fastest edges are 300 µs apart.
pub fn start() {
    for pin in [ENCODER_LEFT_1, ENCODER_LEFT_2] {
        pin.alternate(1, Driver::PushPull, Pull::PullUp);
    }
    for pin in [ENCODER_RIGHT_1, ENCODER_RIGHT_2] {
        pin.alternate(2, Driver::PushPull, Pull::PullUp);
    }
    // The two timers differ in width and in type, not in the fields used here.
    macro_rules! count_every_edge {
        ($timer:ident, $last:expr) => {
            let timer = $timer::registers();
            timer.ccmr1_input().write(|w| {
                w.cc1s().ti1();
                w.cc2s().ti2();
                w.ic1f().fdts_div4_n8();
                w.ic2f().fdts_div4_n8()
            });
            timer.smcr().write(|w| w.sms().encoder_mode_3());
            timer.arr().write(|w| w.arr().set($last));
            timer.cr1().write(|w| {
                w.ckd().div2();
                w.cen().set_bit()
            });
        };
    }
    count_every_edge!(TIM2, u32::MAX);
    count_every_edge!(TIM3, u16::MAX);
}

/// Both counters, left and right, a few cycles apart.
#[inline]
pub fn read() -> (u32, u16) {
    (
        TIM2::registers().cnt().read().bits(),
        TIM3::registers().cnt().read().cnt().bits(),
    )
}

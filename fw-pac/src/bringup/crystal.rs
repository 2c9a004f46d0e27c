//! Frequency of the crystal, against the internal 16 MHz oscillator from which the part starts: TIM11 can
//! capture the RTC's division of the crystal's clock (RM0383, 14.5.11), without a wire.

use crate::registers::Registers;
use core::ops::RangeInclusive;
use stm32f4::stm32f411::{RCC, TIM11};

/// The internal oscillator, kilohertz; exact to 1 %.
const INTERNAL_KHZ: u32 = 16_000;
/// Division of the crystal's clock before the timer, and by its input.
const DIVISION: u32 = 31 * 8;
/// Captures that are measured: some 2 ms at 8 MHz.
const CAPTURES: u32 = 64;
/// Polls until the crystal must have started, as [`crate::clock::start`] waits.
const POLLS: u32 = 64_000;

/// What the clock tree is made for: 8 MHz, as exact as it can be measured here.
pub const FITS: RangeInclusive<u32> = 7_800..=8_200;

/// Kilohertz, 0 without a working crystal; called once, on the oscillator of the reset.
pub fn measure() -> u32 {
    let rcc = RCC::registers();
    rcc.cr().modify(|_, w| w.hseon().set_bit());
    if !(0..POLLS).any(|_| rcc.cr().read().hserdy().bit_is_set()) {
        return 0;
    }
    rcc.apb2enr().modify(|_, w| w.tim11en().set_bit());
    // Read back: a peripheral answers two bus cycles after its clock is enabled (ES0287, 2.2.7).
    let _ = rcc.apb2enr().read();
    // SAFETY: 31 is within 2 ..= 31 (RM0383, 6.3.3).
    rcc.cfgr().modify(|_, w| unsafe { w.rtcpre().bits(31) });
    let timer = TIM11::registers();
    // SAFETY: 2 is the crystal's clock, and 3 captures every eighth edge (RM0383, 14.5.11 and 14.5.5).
    unsafe {
        timer.or().write(|w| w.rmp().bits(2));
        timer
            .ccmr1_input()
            .write(|w| w.cc1s().bits(1).ic1psc().bits(3));
    }
    timer.arr().write(|w| w.arr().set(u16::MAX));
    timer.ccer().write(|w| w.cc1e().set_bit());
    timer.cr1().write(|w| w.cen().set_bit());
    let counts = capture().and_then(|first| {
        let mut last = first;
        for _ in 0..CAPTURES {
            last = capture()?;
        }
        Some(u32::from(last.wrapping_sub(first)))
    });
    let missed = timer.sr().read().cc1of().bit_is_set();
    timer.cr1().reset();
    rcc.apb2enr().modify(|_, w| w.tim11en().clear_bit());
    // The PLL and the switch belong to `clock::start`.
    rcc.cr().modify(|_, w| w.hseon().clear_bit());
    let counts = counts.filter(|_| !missed).unwrap_or(0);
    (CAPTURES * DIVISION * INTERNAL_KHZ)
        .checked_div(counts)
        .unwrap_or(0)
}

/// The counter at the next captured edge.
fn capture() -> Option<u16> {
    let timer = TIM11::registers();
    (0..POLLS)
        .any(|_| timer.sr().read().cc1if().bit_is_set())
        .then(|| timer.ccr1().read().ccr().bits())
}

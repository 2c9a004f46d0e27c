//! Battery taps: ADC1 scans IN0 and IN1 shortly before each tick, DMA2 stream 4 takes the words.
//!
//! The sampling time is the longest, 480 cycles of 25 MHz = 19 µs a tap: the taps' dividers are
//! 7.7 kΩ and 13 kΩ at their outputs, and DS10314 equation 1 would let 50 kΩ settle in it.

use crate::board::{CELL_1, CELL_2, TAPS};
use crate::dma::{control, Stream};
use core::cell::UnsafeCell;
use stm32f4::stm32f411 as pac;

type Dma = Stream<2, 4>;

struct Words(UnsafeCell<[u16; TAPS]>);

// SAFETY: the DMA writes the words between `begin` and its completion; the program reads them only
// once the stream says complete, and by volatile copies.
unsafe impl Sync for Words {}

static WORDS: Words = Words(UnsafeCell::new([0; TAPS]));

fn registers() -> &'static pac::adc1::RegisterBlock {
    // SAFETY: the registers are at this address for as long as the part is powered. After boot,
    // `begin` is their only user.
    unsafe { &*pac::ADC1::ptr() }
}

/// Powers the converter; its 3 µs of stabilisation are long over at the first tick.
pub fn start() {
    CELL_1.analog();
    CELL_2.analog();
    // SAFETY: boot runs alone; the common block belongs to the one converter there is.
    unsafe { &*pac::ADC_COMMON::ptr() }
        .ccr()
        .write(|w| w.adcpre().div4());
    let adc = registers();
    adc.cr1().write(|w| w.scan().set_bit());
    adc.smpr2().write(|w| {
        w.smp0().cycles480();
        w.smp1().cycles480()
    });
    adc.sqr1().write(|w| w.l().set(TAPS as u8 - 1));
    // SAFETY: channels 0 and 1 exist.
    adc.sqr3().write(|w| unsafe {
        w.sq1().bits(0);
        w.sq2().bits(1)
    });
    adc.cr2().write(|w| w.adon().set_bit());
}

/// Starts one scan; 40 µs. Every scan sets the stream up anew, so an overrun or a lost request
/// costs one scan and never swaps the taps.
#[inline]
pub fn begin() {
    let adc = registers();
    Dma::stop();
    adc.cr2().write(|w| w.adon().set_bit());
    // A 0 clears, OVR among them, and there is nothing to keep.
    adc.sr().reset();
    // SAFETY: the words are static, as many as the count, and read only after completion.
    unsafe {
        Dma::start(
            adc.dr().as_ptr() as u32,
            WORDS.0.get() as u32,
            TAPS as u16,
            control::channel(0) | control::READ | control::HALF_WORDS | control::MEDIUM,
        );
    }
    adc.cr2().write(|w| {
        w.adon().set_bit();
        w.dma().set_bit()
    });
    adc.cr2().write(|w| {
        w.adon().set_bit();
        w.dma().set_bit();
        w.swstart().set_bit()
    });
}

/// The words of the scan begun last, taps in order; `None` until it has completed.
pub fn words() -> Option<[u16; TAPS]> {
    // SAFETY: the stream has completed, so nobody writes the words until the next `begin`.
    Dma::complete().then(|| unsafe { WORDS.0.get().read_volatile() })
}

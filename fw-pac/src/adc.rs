//! Battery taps: ADC1 scans IN0 and IN1 shortly before each tick, DMA2 stream 4 takes the words. The
//! chip's temperature sensor and voltage reference, IN18 and IN17, follow every scan as its injected
//! group, which has registers of its own and does not disturb the taps.
//!
//! The sampling time is the longest, 480 cycles of 25 MHz = 19 µs a channel: the taps' dividers are
//! 7.7 kΩ and 13 kΩ at their outputs, and DS10314 equation 1 would let 50 kΩ settle in it; the sensor
//! and the reference need 10 µs.

use crate::board::{CELL_1, CELL_2, TAPS};
use crate::dma::{Buffer, Stream, control};
use crate::registers::Registers;
use core::sync::atomic::{AtomicU8, Ordering};
use fw_core::sensing::Calibration;
use stm32f4::stm32f411::{ADC_COMMON, ADC1};

type Dma = Stream<2, 4>;

static WORDS: Buffer<{ 2 * TAPS }> = Buffer::new();

/// Ticks from one temperature to the next: about a second, as slow as air is.
const TEMPERATURE_TICKS: u8 = 100;

/// Ticks to the next temperature; for the robot's priority alone.
static WAIT: AtomicU8 = AtomicU8::new(0);

/// Factory calibration words of this part's sensor and reference (DS10314, temperature sensor and
/// internal reference voltage calibration values).
pub fn calibration() -> Calibration {
    let word = |address: usize| {
        // SAFETY: aligned half-words of the system memory, which is always readable.
        unsafe { (address as *const u16).read_volatile() }
    };
    Calibration {
        reference: word(0x1FFF_7A2A),
        cold: word(0x1FFF_7A2C),
        hot: word(0x1FFF_7A2E),
    }
}

/// Powers the converter; its 3 µs of stabilisation are long over at the first tick.
pub fn start() {
    CELL_1.analog();
    CELL_2.analog();
    ADC_COMMON::registers().ccr().write(|w| {
        w.adcpre().div4();
        w.tsvrefe().set_bit()
    });
    let adc = ADC1::registers();
    adc.cr1().write(|w| {
        w.scan().set_bit();
        w.jauto().set_bit()
    });
    adc.smpr2().write(|w| {
        w.smp0().cycles480();
        w.smp1().cycles480()
    });
    adc.sqr1().write(|w| w.l().set(TAPS as u8 - 1));
    adc.smpr1().write(|w| {
        w.smp17().cycles480();
        w.smp18().cycles480()
    });
    // SAFETY: the channels exist. The injected group is the last `jl` + 1 of its four places.
    unsafe {
        adc.sqr3().write(|w| {
            w.sq1().bits(0);
            w.sq2().bits(1)
        });
        adc.jsqr().write(|w| {
            w.jl().bits(1);
            w.jsq3().bits(18);
            w.jsq4().bits(17)
        });
    }
    Dma::connect(adc.dr().as_ptr());
    adc.cr2().write(|w| w.adon().set_bit());
}

/// Starts one scan: 40 µs, and 40 more for the chip's own channels. Every scan sets the stream up again,
/// so an overrun or a lost request costs one scan and never swaps the taps.
#[inline]
pub fn begin() {
    let adc = ADC1::registers();
    Dma::stop();
    adc.cr2().write(|w| w.adon().set_bit());
    // A 0 clears, OVR among them, and there is nothing to keep.
    adc.sr().reset();
    Dma::fill(
        &WORDS,
        TAPS as u16,
        control::channel(0) | control::HALF_WORDS | control::MEDIUM,
    );
    // DDS: requests go on whatever the count of the last block was (RM0383, 11.8.1).
    adc.cr2().write(|w| {
        w.adon().set_bit();
        w.dma().set_bit().dds().set_bit()
    });
    adc.cr2().modify(|_, w| w.swstart().set_bit());
}

/// The words of the scan begun last, taps in order, as they would be at a supply of 3.3 V; `None` until
/// it has completed.
pub fn words() -> Option<[u16; TAPS]> {
    Dma::complete().then(|| {
        let [cell_1_low, cell_1_high, cell_2_low, cell_2_high] = WORDS.get();
        let reference = ADC1::registers().jdr2().read().jdata().bits();
        let correction = calibration().supply_correction(reference);
        let nominal = |word| correction.apply(u16::from_le_bytes(word));
        [
            nominal([cell_1_low, cell_1_high]),
            nominal([cell_2_low, cell_2_high]),
        ]
    })
}

/// The words of the chip's temperature sensor and of its reference, once a second; called each tick.
pub fn temperature() -> Option<(u16, u16)> {
    let wait = WAIT.load(Ordering::Relaxed);
    if wait > 0 {
        WAIT.store(wait - 1, Ordering::Relaxed);
        return None;
    }
    let adc = ADC1::registers();
    // Set once both are done; `begin` clears it.
    if adc.sr().read().jeoc().bit_is_clear() {
        return None;
    }
    WAIT.store(TEMPERATURE_TICKS - 1, Ordering::Relaxed);
    Some((
        adc.jdr1().read().jdata().bits(),
        adc.jdr2().read().jdata().bits(),
    ))
}

//! Battery: cell voltages from the ADC words of the taps (document, 5.1.3 and 6.0.3).
//!
//! Tap n reads the sum of cells 1 to n through its divider; cell n is tap n minus tap n − 1. The factors
//! are computed once; a reading is one multiplication and a shift, with an error of half of 2⁻¹⁶ V.

use fixed::types::U16F16;

use crate::divide::div_rem;
pub use crate::eeprom::MAX_CELLS;
use crate::eeprom::{Config, Divider};
use crate::types::Volts;

/// Time constant of the filter, 2ⁿ ticks: 80 ms removes the PWM's ripple.
const FILTER_SHIFT: u32 = 3;
/// Ticks below a threshold until it takes effect: half a second, longer than a motor's start.
const DEBOUNCE_TICKS: u8 = 50;
/// Hysteresis of the warning, 2⁻¹⁶ V: 50 mV.
const HYSTERESIS: u32 = 3277;

/// `mantissa · 2⁻ᵉˣᵖᵒⁿᵉⁿᵗ`, the mantissa with its top bit set, or zero.
#[derive(Clone, Copy, Debug, Default)]
struct Factor {
    mantissa: u32,
    exponent: i32,
}

impl Factor {
    const ZERO: Self = Self {
        mantissa: 0,
        exponent: 0,
    };

    /// `value · 2⁻ᵉˣᵖᵒⁿᵉⁿᵗ`, to 32 bits.
    // Start-up only: one copy in flash.
    #[inline(never)]
    const fn new(value: u64, exponent: i32) -> Self {
        if value == 0 {
            return Self::ZERO;
        }
        let zeros = value.leading_zeros();
        Self {
            mantissa: ((value << zeros) >> 32) as u32,
            exponent: exponent.wrapping_add(zeros as i32).wrapping_sub(32),
        }
    }

    // Start-up only: one copy in flash.
    #[inline(never)]
    const fn times(self, value: u64) -> Self {
        let other = Self::new(value, 0);
        Self::new(
            self.mantissa as u64 * other.mantissa as u64,
            self.exponent.wrapping_add(other.exponent),
        )
    }

    /// `self / value`, which is not 0.
    // Start-up only: one copy in flash.
    #[inline(never)]
    const fn over(self, value: u32) -> Self {
        let (quotient, _) = div_rem((self.mantissa as u64) << 32, value as u64);
        Self::new(quotient, self.exponent.wrapping_add(32))
    }

    /// `self · word`, nearest, at most `u32::MAX`.
    #[inline]
    const fn scale(self, word: u32) -> u32 {
        let product = self.mantissa as u64 * word as u64;
        if self.exponent > 32 && self.exponent < 64 {
            // The usual case: the upper word suffices, the last bit shifted out rounds.
            let twice = (product >> 32) as u32 >> (self.exponent - 33);
            return (twice >> 1) + (twice & 1);
        }
        self.scale_unusual(product)
    }

    /// [`Self::scale`] for the exponents of unusual configurations.
    #[cold]
    #[inline(never)]
    const fn scale_unusual(self, product: u64) -> u32 {
        let result = match self.exponent {
            shift @ 1..=63 => (product >> shift) + ((product >> (shift - 1)) & 1),
            64.. => 0,
            0 => product,
            // The mantissa's top bit is set: whatever is not zero is too large.
            _ => product.saturating_mul(1 << 33),
        };
        if result > u32::MAX as u64 {
            u32::MAX
        } else {
            result as u32
        }
    }
}

/// One tap: its factor and its filtered reading.
#[derive(Clone, Copy, Debug, Default)]
struct Tap {
    /// 2⁻¹⁶ V per unit of the word.
    factor: Factor,
    divider: Divider,
    /// Filtered word, 12 fractional bits; `None` before the first.
    word: Option<u32>,
    /// 2⁻¹⁶ V; 0 before the first word.
    voltage: u32,
}

impl Tap {
    /// Filters a word of the ADC.
    fn read(&mut self, word: u16) {
        let word = u32::from(word) << 12;
        let word = match self.word {
            // Both below 2²⁸: no overflow.
            Some(old) => old + (word >> FILTER_SHIFT) - (old >> FILTER_SHIFT),
            None => word,
        };
        self.word = Some(word);
        self.voltage = self.factor.scale(word);
    }
}

/// The battery.
#[derive(Clone, Debug)]
pub struct Battery {
    taps: [Tap; MAX_CELLS],
    /// Of each cell; 0 before its tap's first word.
    voltages: [Volts; MAX_CELLS],
    cells: u8,
    /// 2⁻¹⁶ V.
    warn: u32,
    cutoff: u32,
    low_ticks: u8,
    empty_ticks: u8,
    low: bool,
    empty: bool,
}

impl Battery {
    /// Without a reading.
    // Requirement: DOC-6.0.3-2, WIRE-platform-10
    pub fn new(config: &Config) -> Self {
        // Filtered words have 12 fractional bits, voltages 16, the full scale 32.
        let unit = Factor::new(
            config.adc_max_volts().to_bits().unsigned_abs(),
            32 - 16 + 12,
        )
        .over(config.adc_max_word().into());
        let mut taps = [Tap::default(); MAX_CELLS];
        for (tap, divider) in taps.iter_mut().zip(config.dividers()) {
            let sum = u64::from(divider.upper.0) + u64::from(divider.lower.0);
            tap.divider = *divider;
            tap.factor = unit.times(sum).over(divider.lower.0);
        }
        Self {
            taps,
            voltages: [Volts::default(); MAX_CELLS],
            cells: config.cells(),
            warn: config.battery_warn().0.to_bits(),
            cutoff: config.battery_cutoff().0.to_bits(),
            low_ticks: 0,
            empty_ticks: 0,
            low: false,
            empty: false,
        }
    }

    /// One tick's ADC words, tap 1 first. A tap without a word stays unread: on a board with fewer ADC
    /// pins than cells the missing ones are not low.
    // Requirement: WIRE-eeprom-12, WIRE-fault-3, WIRE-fault-4
    pub fn sample(&mut self, words: &[u16]) {
        let mut words = words.iter();
        // No conversion counts as empty: the voltage is not known.
        let unknown = words.len() == 0;
        let (mut below, mut lowest) = (0, if unknown { 0 } else { u32::MAX });
        let count = usize::from(self.cells);
        for (tap, cell) in self.taps.iter_mut().zip(&mut self.voltages).take(count) {
            if let Some(&word) = words.next() {
                tap.read(word);
            } else if tap.word.is_none() {
                // No later tap has been read either.
                break;
            }
            // 0 V for a tap below the one before it: a broken divider.
            let voltage = tap.voltage.saturating_sub(below);
            below = tap.voltage;
            lowest = lowest.min(voltage);
            *cell = Volts(U16F16::from_bits(voltage));
        }
        let below = |limit: u32| lowest < limit;
        self.low_ticks = count_while(self.low_ticks, below(self.warn));
        self.empty_ticks = count_while(self.empty_ticks, below(self.cutoff));
        if self.low_ticks >= DEBOUNCE_TICKS {
            self.low = true;
        } else if !below(self.warn.saturating_add(HYSTERESIS)) {
            self.low = false;
        }
        // Latched: an unloaded battery recovers.
        self.empty |= self.empty_ticks >= DEBOUNCE_TICKS;
    }

    /// Voltage of tap `index`, 2⁻¹⁶ V; 0 before its first word.
    fn tap(&self, index: u8) -> u32 {
        self.taps
            .get(usize::from(index))
            .map_or(0, |tap| tap.voltage)
    }

    /// The number of cells, 1 ..= 8.
    pub const fn cells(&self) -> u8 {
        self.cells
    }

    /// Voltage of every cell; 0 V before its tap's first word.
    pub fn voltages(&self) -> &[Volts] {
        let cells = usize::from(self.cells);
        self.voltages.get(..cells).unwrap_or_default()
    }

    /// Voltage of cell `index`, from 0; `None` beyond the last cell.
    pub fn cell(&self, index: u8) -> Option<Volts> {
        self.voltages().get(usize::from(index)).copied()
    }

    /// Tuning (document, 5.1.3): the upper resistor, ohms, with which the reading of cell `index` is
    /// `reference`, a source in place of the cell. `None` without a reference, a cell or a reading.
    ///
    /// The lower resistor is kept. Tune from cell 1 upwards: each cell depends on the tap below.
    // Requirement: DOC-5.1.3-3, WIRE-battery-2
    pub fn tune(&self, index: u8, reference: Volts) -> Option<u32> {
        let reference = reference.0.to_bits();
        if reference == 0 || index >= self.cells {
            return None;
        }
        let below = if index == 0 { 0 } else { self.tap(index - 1) };
        let tap = self.taps.get(usize::from(index))?;
        let Divider { upper, lower } = tap.divider;
        let sum = Factor::new(u64::from(upper.0) + u64::from(lower.0), 0);
        let truth = u64::from(below) + u64::from(reference);
        let whole = sum.times(truth).over(tap.voltage);
        let whole = whole.scale(1);
        (tap.voltage != 0).then(|| whole.saturating_sub(lower.0))
    }

    /// Whether a cell was below the warning voltage for half a second; ends 50 mV above it.
    pub const fn low(&self) -> bool {
        self.low
    }

    /// Whether a cell was below the cut-off voltage for half a second; latched until the restart.
    pub const fn empty(&self) -> bool {
        self.empty
    }
}

/// Consecutive ticks of a condition, at most 255.
const fn count_while(ticks: u8, now: bool) -> u8 {
    if now { ticks.saturating_add(1) } else { 0 }
}

#[cfg(test)]
mod tests;

//! The battery: ADC words of the taps to voltages of the cells (document, 5.1.3 and 6.0.3).
//!
//! Tap n reads the sum of cells 1 to n through its divider; cell n is tap n minus tap n − 1. All
//! factors are worked out once; a reading is one multiplication and a shift, its arithmetic error
//! half of 2⁻¹⁶ V.

use fixed::types::U16F16;

use crate::eeprom::{Config, Divider};
use crate::units::Volts;

/// Most cells of a battery (document, 6.0.3).
pub const MAX_CELLS: usize = 8;

/// Time constant of the filter, 2ⁿ ticks: 80 ms keeps the PWM's ripple out.
const FILTER: u32 = 3;
/// Ticks below a threshold that count: half a second, longer than a motor's start.
const PATIENCE: u8 = 50;
/// How far above the warning a cell must be for the warning to end, 2⁻¹⁶ V: 50 mV.
const RELIEF: u32 = 3277;

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

    const fn times(self, value: u64) -> Self {
        let other = Self::new(value, 0);
        Self::new(
            self.mantissa as u64 * other.mantissa as u64,
            self.exponent.wrapping_add(other.exponent),
        )
    }

    /// By zero, which no accepted configuration asks for, zero.
    const fn over(self, value: u32) -> Self {
        match ((self.mantissa as u64) << 32).checked_div(value as u64) {
            Some(quotient) => Self::new(quotient, self.exponent.wrapping_add(32)),
            None => Self::ZERO,
        }
    }

    /// `self · word`, nearest, at most `u32::MAX`.
    const fn scale(self, word: u32) -> u32 {
        let product = self.mantissa as u64 * word as u64;
        let result = match self.exponent {
            shift @ 1..=63 => (product >> shift) + ((product >> (shift - 1)) & 1),
            64.. => 0,
            _ => product,
        };
        if result > u32::MAX as u64 {
            u32::MAX
        } else {
            result as u32
        }
    }
}

/// One tap: where its voltage comes from and what it was last.
#[derive(Clone, Copy, Debug, Default)]
struct Tap {
    /// 2⁻¹⁶ V per unit of the word.
    factor: Factor,
    divider: Divider,
    /// Filtered word, 12 fractional bits; `None` before the first.
    word: Option<u32>,
}

impl Tap {
    /// 2⁻¹⁶ V.
    const fn voltage(&self) -> u32 {
        match self.word {
            Some(word) => self.factor.scale(word),
            None => 0,
        }
    }
}

/// The battery.
#[derive(Clone, Debug)]
pub struct Battery {
    taps: [Tap; MAX_CELLS],
    cells: u8,
    /// The cell that [`Self::walk`] shows next.
    next: u8,
    /// 2⁻¹⁶ V.
    warn: u32,
    cutoff: u32,
    low_ticks: u8,
    empty_ticks: u8,
    low: bool,
    empty: bool,
}

impl Battery {
    /// Nothing read yet.
    #[must_use]
    pub fn new(config: &Config) -> Self {
        let volts = config.adc_max_voltage.to_scaled(32).unwrap_or(0).max(0);
        // Filtered words have 12 fractional bits, voltages 16, the full scale 32.
        let unit = Factor::new(volts.unsigned_abs(), 32 - 16 + 12).over(config.adc_max_word);
        let mut taps = [Tap::default(); MAX_CELLS];
        for (tap, divider) in taps.iter_mut().zip(config.dividers) {
            let sum = u64::from(divider.upper) + u64::from(divider.lower);
            tap.divider = divider;
            tap.factor = unit.times(sum).over(divider.lower);
        }
        let millivolts = |mv: u16| (u32::from(mv) << 16) / 1000;
        Self {
            taps,
            cells: config.cells.clamp(1, MAX_CELLS as u8),
            next: 0,
            warn: millivolts(config.platform.battery_warn),
            cutoff: millivolts(config.platform.battery_cutoff),
            low_ticks: 0,
            empty_ticks: 0,
            low: false,
            empty: false,
        }
    }

    /// One tick's ADC words, tap 1 first. A tap without a word stays unread: a board with fewer
    /// ADC pins than cells does not count the missing ones as empty.
    pub fn sample(&mut self, words: &[u16]) {
        let count = usize::from(self.cells);
        for (tap, &word) in self.taps.iter_mut().take(count).zip(words) {
            let word = u32::from(word) << 12;
            tap.word = Some(match tap.word {
                // Both below 2²⁸: no sum here can leave its type.
                Some(old) => old + (word >> FILTER) - (old >> FILTER),
                None => word,
            });
        }
        let lowest = self.lowest();
        let below = |limit: u32| lowest.is_some_and(|v| v < limit);
        self.low_ticks = run(self.low_ticks, below(self.warn));
        self.empty_ticks = run(self.empty_ticks, below(self.cutoff));
        if self.low_ticks >= PATIENCE {
            self.low = true;
        } else if !below(self.warn.saturating_add(RELIEF)) {
            self.low = false;
        }
        // A battery recovers when its load goes: cut off stays until the restart.
        self.empty |= self.empty_ticks >= PATIENCE;
    }

    /// 2⁻¹⁶ V of the lowest cell that was read.
    fn lowest(&self) -> Option<u32> {
        let mut below = 0;
        let mut lowest = None;
        for tap in self.taps.iter().take(usize::from(self.cells)) {
            if tap.word.is_some() {
                let voltage = tap.voltage();
                let cell = voltage.saturating_sub(below);
                below = voltage;
                lowest = Some(lowest.map_or(cell, |l: u32| l.min(cell)));
            }
        }
        lowest
    }

    /// Voltage of tap `index`, 0 ..= 7, 0 V where nothing was read.
    fn tap(&self, index: u8) -> u32 {
        self.taps.get(usize::from(index)).map_or(0, Tap::voltage)
    }

    /// The number of cells, 1 ..= 8.
    #[must_use]
    pub const fn cells(&self) -> u8 {
        self.cells
    }

    /// The voltage of cell `index`, 0 = the first; `None` for a cell the battery does not have. A
    /// tap below the one before it, which only a broken divider shows, makes 0 V.
    #[must_use]
    pub fn cell(&self, index: u8) -> Option<Volts> {
        if index >= self.cells {
            return None;
        }
        let below = if index == 0 { 0 } else { self.tap(index - 1) };
        let voltage = self.tap(index).saturating_sub(below);
        Some(Volts(U16F16::from_bits(voltage)))
    }

    /// The next cell in turn, one a frame: 0 ..= cells − 1 and again.
    pub fn walk(&mut self) -> (u8, Volts) {
        let index = self.next;
        self.next = if index + 1 < self.cells { index + 1 } else { 0 };
        (index, self.cell(index).unwrap_or_default())
    }

    /// Tuning (document, 5.1.3): a source of `reference` volts stands in for cell `index`, what
    /// upper resistor, in ohms, would have shown it exactly? `None` where there is nothing to tune:
    /// reference 0, no such cell, or a reading of 0.
    ///
    /// The divider's ratio is scaled, its lower resistor kept. Tune from cell 1 upwards: each builds
    /// on the tap below.
    #[must_use]
    pub fn tune(&self, index: u8, reference: Volts) -> Option<u32> {
        let reference = reference.0.to_bits();
        if reference == 0 || index >= self.cells {
            return None;
        }
        let below = if index == 0 { 0 } else { self.tap(index - 1) };
        let tap = self.taps.get(usize::from(index))?;
        let Divider { upper, lower } = tap.divider;
        let sum = Factor::new(u64::from(upper) + u64::from(lower), 0);
        let truth = u64::from(below) + u64::from(reference);
        let whole = sum.times(truth).over(tap.voltage());
        let whole = whole.scale(1);
        (tap.voltage() != 0).then(|| whole.saturating_sub(lower))
    }

    /// Whether a cell has been below the warning voltage for half a second; ends 50 mV above it.
    #[must_use]
    pub const fn low(&self) -> bool {
        self.low
    }

    /// Whether a cell was below the cut-off voltage for half a second since the start.
    #[must_use]
    pub const fn empty(&self) -> bool {
        self.empty
    }
}

/// How long a condition has been true, at most 255.
const fn run(ticks: u8, now: bool) -> u8 {
    if now {
        ticks.saturating_add(1)
    } else {
        0
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::double::Double;
    use crate::eeprom::first_board;

    /// The words that the first board's ADC gives for two cells.
    fn words(first: f64, second: f64) -> [u16; 2] {
        let word = |volts: f64| (volts / 3.3 * 4095.0).round() as u16;
        [
            word(first * 33.0 / 43.0),
            word((first + second) * 22.0 / 55.0),
        ]
    }

    fn read(config: &Config, words: &[u16]) -> Battery {
        let mut battery = Battery::new(config);
        battery.sample(words);
        battery
    }

    fn volts(battery: &Battery, cell: u8) -> f64 {
        battery.cell(cell).unwrap().0.to_num()
    }

    #[test]
    fn the_first_boards_cells_are_right_to_a_step_of_its_adc() {
        for (first, second) in [(3.0, 3.1), (3.7, 3.7), (4.2, 4.2), (4.2, 0.0), (0.0, 0.0)] {
            let battery = read(&first_board(), &words(first, second));
            assert!((volts(&battery, 0) - first).abs() < 0.0006, "{first}");
            assert!((volts(&battery, 1) - second).abs() < 0.0017, "{second}");
            assert_eq!(battery.cell(2), None);
        }
    }

    #[test]
    fn every_word_gives_its_voltage_to_a_sixteenth_of_a_millivolt_and_more_gives_more() {
        let config = first_board();
        let mut last = 0;
        for word in 0..=4095u16 {
            let battery = read(&config, &[word]);
            let truth = f64::from(word) / 4095.0 * 3.3 * 43.0 / 33.0;
            assert!((volts(&battery, 0) - truth).abs() < 1.0 / 16_000.0);
            let now = battery.tap(0);
            assert!(now >= last);
            last = now;
        }
    }

    #[test]
    fn every_configuration_that_is_accepted_reads_every_word_without_overflow() {
        let mut config = first_board();
        config.cells = 8;
        for volts in [0.1, 3.3, 10.0] {
            for word in [1, 4095, 65_535] {
                for (upper, lower) in [
                    (0, 1),
                    (10_000_000, 1),
                    (1, 10_000_000),
                    (10_000_000, 10_000_000),
                ] {
                    config.adc_max_voltage = Double(f64::to_bits(volts));
                    config.adc_max_word = word;
                    config.dividers = [Divider { upper, lower }; 8];
                    for read_word in [0, 1, 4095, 65_535] {
                        let mut battery = read(&config, &[read_word; 8]);
                        battery.sample(&[65_535; 8]);
                        battery.sample(&[0; 12]);
                        for _ in 0..9 {
                            let (index, _) = battery.walk();
                            let _ = battery.tune(index, Volts(U16F16::MAX));
                        }
                        let truth = f64::from(read_word) / f64::from(word)
                            * volts
                            * (f64::from(upper) + f64::from(lower))
                            / f64::from(lower);
                        let tap = f64::from(read(&config, &[read_word]).tap(0)) / 65_536.0;
                        let truth = truth.min(65_536.0);
                        assert!((tap - truth).abs() <= 1e-5 + truth * 1e-8, "{tap} {truth}");
                    }
                }
            }
        }
    }

    #[test]
    fn the_walk_shows_every_cell_in_turn() {
        for cells in 1..=8u8 {
            let mut config = first_board();
            config.cells = cells;
            let mut battery = Battery::new(&config);
            for k in 0..40u8 {
                assert_eq!(battery.walk().0, k % cells);
            }
        }
    }

    #[test]
    fn the_filter_settles_on_every_word() {
        for (from, to) in [(0, 4095), (4095, 0), (2000, 2001), (2001, 2000)] {
            let mut battery = read(&first_board(), &[from]);
            for _ in 0..200 {
                battery.sample(&[to]);
            }
            let truth = f64::from(to) / 4095.0 * 3.3 * 43.0 / 33.0;
            assert!((volts(&battery, 0) - truth).abs() < 1e-4, "{from} {to}");
        }
    }

    #[test]
    fn tuning_finds_the_resistor_that_is_really_there() {
        // The board's resistors are off by their tolerance; the EEPROM says what they should be.
        let mut config = first_board();
        let (first, second) = (10_220.0, 32_500.0);
        let pin = |volts: f64, upper: f64, lower: f64| {
            (volts * lower / (upper + lower) / 3.3 * 4095.0).round() as u16
        };
        let words = [pin(3.9, first, 33_000.0), pin(7.8, second, 22_000.0)];
        let reference = Volts(U16F16::from_num(3.9));
        let tuned = read(&config, &words).tune(0, reference).unwrap();
        assert!((f64::from(tuned) - first).abs() < 15.0, "{tuned}");
        config.dividers[0].upper = tuned;
        let tuned = read(&config, &words).tune(1, reference).unwrap();
        assert!((f64::from(tuned) - second).abs() < 30.0, "{tuned}");
        config.dividers[1].upper = tuned;
        let battery = read(&config, &words);
        assert!((volts(&battery, 0) - 3.9).abs() < 0.001);
        assert!((volts(&battery, 1) - 3.9).abs() < 0.002);
    }

    #[test]
    fn nothing_to_tune_is_no_tuning() {
        let battery = read(&first_board(), &words(3.7, 3.7));
        assert_eq!(battery.tune(0, Volts(U16F16::ZERO)), None);
        assert_eq!(battery.tune(2, Volts(U16F16::ONE)), None);
        assert_eq!(
            Battery::new(&first_board()).tune(0, Volts(U16F16::ONE)),
            None
        );
    }

    #[test]
    fn a_low_cell_warns_and_an_empty_one_cuts_off_for_good() {
        let mut battery = read(&first_board(), &words(3.7, 3.7));
        let mut run = |volts: f64, ticks: u32| {
            for _ in 0..ticks {
                battery.sample(&words(3.7, volts));
            }
            (battery.low(), battery.empty())
        };
        assert_eq!(run(3.7, 500), (false, false));
        assert_eq!(run(2.5, 40), (false, false), "a motor's start");
        assert_eq!(run(3.7, 200), (false, false));
        assert_eq!(run(3.3, 200), (true, false));
        assert_eq!(run(3.42, 200), (true, false), "not yet relieved");
        assert_eq!(run(3.5, 200), (false, false));
        assert_eq!(run(2.9, 200), (true, true));
        assert_eq!(run(4.0, 2000), (false, true));
    }

    #[test]
    fn a_tap_that_the_board_does_not_measure_is_not_an_empty_cell() {
        let mut config = first_board();
        config.cells = 4;
        let mut battery = Battery::new(&config);
        for _ in 0..1000 {
            battery.sample(&words(3.7, 3.7));
        }
        assert!(!battery.low() && !battery.empty());
        assert_eq!(battery.cell(3).unwrap().0, 0);
        for _ in 0..1000 {
            battery.sample(&[]);
        }
        assert!(!battery.empty());
    }
}

use super::*;
use crate::eeprom::{FIELDS, config_with, fields, first_board};
use std::vec::Vec;

/// The ADC words of the first board's two cells.
fn words(first: f64, second: f64) -> [u16; 2] {
    let word = |volts: f64| (volts / 3.3 * 4095.0).round() as u16;
    [first * 33.0 / 43.0, (first + second) * 22.0 / 55.0].map(word)
}

/// The first board's battery after so many samples of these words.
fn sampled(words: &[u16], samples: u8) -> Battery {
    let mut battery = Battery::new(&first_board());
    (0..samples).for_each(|_| battery.sample(words));
    battery
}

/// The lowest cell, 2⁻¹⁶ V.
fn lowest(battery: &Battery) -> u32 {
    let cells = battery.voltages().iter();
    cells.map(|volts| volts.0.to_bits()).min().unwrap()
}

fn volts(battery: &Battery, cell: u8) -> f64 {
    battery.cell(cell).unwrap().0.to_num()
}

#[test]
fn first_board_cells_are_exact_to_an_adc_step() {
    for (first, second) in [(3.0, 3.1), (3.7, 3.7), (4.2, 4.2), (4.2, 0.0), (0.0, 0.0)] {
        // The filter settles on the new words.
        let mut battery = sampled(&[4095, 0], 1);
        (0..200).for_each(|_| battery.sample(&words(first, second)));
        assert!((volts(&battery, 0) - first).abs() < 0.0006, "{first}");
        assert!((volts(&battery, 1) - second).abs() < 0.0017, "{second}");
        assert_eq!((battery.cells(), battery.cell(2)), (2, None));
    }
}

// Requirement: DOC-6.0.3-2
#[test]
fn configured_largest_word_is_the_full_scale() {
    for largest in [1023_u16, 4095, u16::MAX] {
        let config = config_with(&[(fields::ADC_MAX_WORD, largest.into())]);
        let mut battery = Battery::new(&config);
        battery.sample(&[largest]);
        // 3.3 V at the pin.
        assert!((volts(&battery, 0) - 4.3).abs() < 0.0001, "{largest}");
    }
}

// Requirement: DOC-5.1.3-3
#[test]
fn tune_finds_the_actual_resistors() {
    let mut config = first_board();
    let mut changes = Vec::new();
    let (first, second) = (10_220.0, 32_500.0);
    let pin = |volts: f64, upper: f64, lower: f64| {
        (volts * lower / (upper + lower) / 3.3 * 4095.0).round() as u16
    };
    let words = [pin(3.9, first, 33_000.0), pin(7.8, second, 22_000.0)];
    let reference = Volts(U16F16::from_num(3.9));
    for (cell, resistor) in [(0, first), (1, second)] {
        let mut battery = Battery::new(&config);
        assert_eq!(battery.tune(cell, reference), None);
        battery.sample(&words);
        assert_eq!(battery.tune(cell, Volts(U16F16::ZERO)), None);
        assert_eq!(battery.tune(2, reference), None);
        let least = battery.tune(cell, Volts(U16F16::from_bits(1)));
        assert!(cell != 0 || least == Some(0));
        let tuned = battery.tune(cell, reference).unwrap();
        assert!((f64::from(tuned) - resistor).abs() < 30.0, "{tuned}");
        let upper = [fields::TAP_1_UPPER, fields::TAP_2_UPPER][usize::from(cell)];
        changes.push((upper, tuned.into()));
        config = config_with(&changes);
    }
    let mut battery = Battery::new(&config);
    battery.sample(&words);
    assert!((volts(&battery, 0) - 3.9).abs() < 0.001);
    assert!((volts(&battery, 1) - 3.9).abs() < 0.002);
}

#[test]
fn low_cell_warns_with_hysteresis_and_cutoff_latches() {
    let mut battery = Battery::new(&first_board());
    let mut sample = |volts: f64, ticks: u32| {
        (0..ticks).for_each(|_| battery.sample(&words(3.7, volts)));
        (battery.low(), battery.empty())
    };
    for (volts, ticks, expected) in [
        (3.7, 500, (false, false)),
        // A motor's start.
        (2.5, 40, (false, false)),
        (3.7, 200, (false, false)),
        (3.3, 200, (true, false)),
        // Within the hysteresis.
        (3.42, 200, (true, false)),
        (3.5, 200, (false, false)),
        (2.9, 200, (true, true)),
        (4.0, 2000, (false, true)),
    ] {
        assert_eq!(sample(volts, ticks), expected, "{volts} V");
    }
}

#[test]
fn cell_at_a_threshold_is_not_below_it() {
    let words = words(3.9, 4.0);
    let battery = sampled(&words, 1);
    let lowest = lowest(&battery);
    for (limit, below) in [(lowest, false), (lowest + 1, true)] {
        let mut battery = battery.clone();
        (battery.warn, battery.cutoff) = (limit, limit);
        (0..=DEBOUNCE_TICKS).for_each(|_| battery.sample(&words));
        assert_eq!((battery.low(), battery.empty()), (below, below));
    }
}

#[test]
fn tap_without_words_is_not_a_low_cell() {
    let mut battery = Battery::new(&config_with(&[
        (fields::CELLS, 4),
        (fields::TAP_3_UPPER, 0),
        (fields::TAP_3_LOWER, 1),
        (fields::TAP_4_UPPER, 0),
        (fields::TAP_4_LOWER, 1),
    ]));
    (0..1000).for_each(|_| battery.sample(&words(3.7, 3.7)));
    assert!(!battery.low() && !battery.empty());
    assert_eq!(battery.cell(3).unwrap().0, 0);
}

// Requirement: WIRE-fault-4
#[test]
fn battery_unread_for_half_a_second_is_empty() {
    let mut battery = Battery::new(&first_board());
    for missing in [0, 1, DEBOUNCE_TICKS - 1, DEBOUNCE_TICKS] {
        battery.sample(&words(3.7, 3.7));
        (0..missing).for_each(|_| battery.sample(&[]));
        let unread = missing == DEBOUNCE_TICKS;
        assert_eq!((battery.low(), battery.empty()), (unread, unread));
    }
    // The supervision is off.
    (battery.warn, battery.cutoff) = (0, 0);
    (battery.low, battery.empty) = (false, false);
    battery.sample(&[]);
    assert!(!battery.low() && !battery.empty());
}

// Requirement: WIRE-fault-4
#[test]
fn cell_of_0_v_is_empty() {
    for words in [words(3.7, 0.0), words(0.0, 3.7), [0; 2]] {
        let battery = sampled(&words, DEBOUNCE_TICKS);
        assert!(battery.low() && battery.empty(), "{words:?}");
    }
}

// Requirement: WIRE-eeprom-12, DOC-5.1.3-3
#[test]
fn cell_is_its_tap_less_the_one_below() {
    let taps = FIELDS.iter().filter(|field| field.tap != 0);
    let mut changes: Vec<_> = taps.map(|field| (field, 10_000)).collect();
    changes.push((fields::CELLS, 8));
    let mut battery = Battery::new(&config_with(&changes));
    for words in [
        &[400, 900, 800, 2000, 2500][..],
        &[500],
        &[450, 700, 1300, 1900, 2100, 2900, 3300, 4000],
        &[0, 0, 0],
        &[],
    ] {
        battery.sample(words);
        let mut below = 0;
        for cell in 0..8 {
            let voltage = battery.cell(cell).unwrap().0.to_bits();
            assert_eq!(voltage, battery.tap(cell).saturating_sub(below), "{cell}");
            // A reference of what is read finds the resistor that is configured.
            if let Some(upper) = battery.tune(cell, battery.cell(cell).unwrap()) {
                assert!(upper.abs_diff(10_000) <= 1, "{cell}: {upper}");
            }
            below = battery.tap(cell);
        }
    }
}

#[test]
fn factor_scales_to_nearest_at_every_exponent() {
    for exponent in -40..=100 {
        for mantissa in [1 << 31, (1 << 31) + 1, 0xC000_0001, u32::MAX] {
            for word in [0, 1, 2, 3, 0xFFF, 0x8000_0000, u32::MAX] {
                let product = u128::from(mantissa) * u128::from(word);
                let exact = match exponent {
                    // At least 2³², or 0.
                    ..=-1 => product << 33,
                    0 => product,
                    _ => (product >> (exponent - 1)).div_ceil(2),
                };
                let exact = u32::try_from(exact).unwrap_or(u32::MAX);
                let scaled = Factor { mantissa, exponent }.scale(word);
                // Below 1 a unit of rounding is irrelevant.
                let slack = u32::from(exponent == 64);
                assert!(scaled.abs_diff(exact) <= slack, "{scaled} {exact}");
            }
        }
    }
}

#[test]
fn reading_takes_80_ms_and_warning_ends_50_mv_above() {
    let mut battery = sampled(&[0, 0], 1);
    (0..8).for_each(|_| battery.sample(&words(4.0, 4.0)));
    let share = 1.0 - (7.0_f64 / 8.0).powi(8);
    assert!((volts(&battery, 0) - 4.0 * share).abs() < 0.005);
    let battery = sampled(&words(4.0, 3.9), 1);
    let lowest = lowest(&battery);
    for (above, low) in [(3276, true), (3277, false)] {
        let mut battery = battery.clone();
        (battery.warn, battery.low) = (lowest - above, true);
        battery.sample(&words(4.0, 3.9));
        assert_eq!(battery.low(), low, "{above} of 2⁻¹⁶ V");
    }
}

// Requirement: WIRE-battery-2
#[test]
fn tap_below_its_neighbour_can_be_tuned() {
    let battery = sampled(&[3428, 1000], 1);
    assert!(battery.tap(1) < battery.tap(0));
    assert!(battery.tune(1, Volts(U16F16::from_num(3.9))).is_some());
}

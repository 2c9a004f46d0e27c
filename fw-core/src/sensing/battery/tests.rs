use super::*;
use crate::binary64::Binary64;
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
                config.adc_max_voltage = Binary64(f64::to_bits(volts));
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

// Requirement: DOC-5.1.3-3
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

// Requirement: WIRE-eeprom-12
#[test]
fn a_cell_is_its_tap_less_the_one_below_however_many_words_come() {
    let mut config = first_board();
    config.cells = 8;
    config.dividers = [Divider {
        upper: 10_000,
        lower: 10_000,
    }; 8];
    let mut battery = Battery::new(&config);
    let scans = [
        &[400, 900, 800, 2000, 2500][..],
        &[500],
        &[450, 700, 1300, 1900, 2100, 2900, 3300, 4000],
        &[0, 0, 0],
        &[],
    ];
    for words in scans {
        battery.sample(words);
        let mut below = 0;
        for cell in 0..8 {
            let voltage = battery.cell(cell).unwrap().0.to_bits();
            assert_eq!(voltage, battery.tap(cell).saturating_sub(below), "{cell}");
            below = battery.tap(cell);
        }
    }
}

#[test]
fn a_factor_scales_to_the_nearest_whatever_its_exponent() {
    for exponent in -40..=100 {
        for mantissa in [1 << 31, (1 << 31) + 1, 0xC000_0001, u32::MAX] {
            for word in [0, 1, 2, 3, 0xFFF, 0x8000_0000, u32::MAX] {
                let product = u128::from(mantissa) * u128::from(word);
                let exact = match exponent {
                    // At least 2³¹, unless it is nothing.
                    ..=-1 => product << 33,
                    0 => product,
                    _ => (product >> (exponent - 1)).div_ceil(2),
                };
                let exact = u32::try_from(exact).unwrap_or(u32::MAX);
                let scaled = Factor { mantissa, exponent }.scale(word);
                // Below 1 there is nothing to be measured.
                let slack = u32::from(exponent == 64);
                assert!(
                    scaled.abs_diff(exact) <= slack,
                    "{mantissa} {exponent} {word}: {scaled} {exact}"
                );
            }
        }
    }
}

#[test]
fn a_cell_at_its_limit_is_not_below_it() {
    let words = words(3.9, 4.0);
    let mut battery = Battery::new(&first_board());
    battery.sample(&words);
    assert_eq!(battery.cells(), 2);
    let lowest = battery.voltages().iter().map(|volts| volts.0.to_bits());
    let lowest = lowest.min().unwrap();
    for (limit, below) in [(lowest, false), (lowest + 1, true)] {
        let mut battery = battery.clone();
        (battery.warn, battery.cutoff) = (limit, limit);
        for _ in 0..=PATIENCE {
            battery.sample(&words);
        }
        assert_eq!((battery.low(), battery.empty()), (below, below));
    }
}

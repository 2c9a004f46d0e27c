//! T5 and T10: cell voltages are total, correct and monotone.

use fixed::types::U16F16;
use fw_core::binary64::Binary64;
use fw_core::eeprom::fields::{
    ADC_MAX, ADC_MAX_WORD, BATTERY_CUTOFF, BATTERY_WARN, CELLS, TAP_1_LOWER, TAP_1_UPPER,
};
use fw_core::eeprom::{Config, Divider};
use fw_core::sensing::Battery;

use crate::eeprom::accepted::AcceptedConfig;
use crate::property::Seen;
use fw_core::types::Volts;

/// One cell, with any full scale, largest word and divider that are accepted.
fn one_cell(full_scale: Binary64, largest: u16, (upper, lower): (u32, u32)) -> (bool, Config) {
    AcceptedConfig::FIRST_BOARD
        .with(CELLS, 1)
        .with(ADC_MAX, full_scale.0)
        .with(ADC_MAX_WORD, largest.into())
        .with(TAP_1_UPPER, upper.into())
        .with(TAP_1_LOWER, lower.into())
        .checked()
}

/// The ADC's words, one a tap.
pub type Words = [u16; 8];

fn volts(volts: Volts) -> f64 {
    volts.0.to_num()
}

/// For any words and accepted configuration every cell has a voltage, and no other.
pub fn every_cell_shows_a_voltage(values: AcceptedConfig, words: [(Words, ()); 2]) -> Seen {
    given!(let Some(config) = values.config());
    let mut battery = Battery::new(&config);
    assert!(battery.cells() == config.cells());
    for (words, ()) in words {
        battery.sample(&words);
    }
    let (mut sum, mut nothing) = (0_u64, false);
    for index in 0..=u8::MAX {
        let cell = battery.cell(index);
        assert!(cell.is_some() == (index < config.cells()));
        nothing |= cell == Some(Volts::default());
        sum += cell.map_or(0, |volts| u64::from(volts.0.to_bits()));
    }
    seen!(nothing && sum > 0, sum > 0 && config.cells() == 8)
}

/// The first cell's voltage is word · full scale / largest word · (upper + lower) / lower (document,
/// 6.0.3), to a part in 10⁸ and 15 µV.
// Requirement: DOC-6.0.3-2
pub fn voltage_is_the_dividers(values: AcceptedConfig, word: u16) -> Seen {
    given!(let Some(config) = values.config());
    let mut battery = Battery::new(&config);
    battery.sample(&[word]);
    let found = battery.cell(0).map_or(0.0, volts);
    let Divider { upper, lower } = config.dividers()[0];
    let exact = f64::from(word) * config.adc_max_volts().to_num::<f64>()
        / f64::from(config.adc_max_word())
        * (f64::from(upper.0) + f64::from(lower.0))
        / f64::from(lower.0);
    let largest = volts(Volts(U16F16::MAX));
    if exact >= largest {
        assert!(found >= largest * (1.0 - 1e-8));
    } else {
        assert!((found - exact).abs() <= 1e-8 * exact + 1.6e-5);
    }
    seen!(exact >= largest, exact > 0.0 && exact < largest)
}

/// The voltage is monotone in the word.
pub fn voltage_is_monotone(word: u16) -> Seen {
    let cell = |word: u16| {
        let mut battery = Battery::new(&AcceptedConfig::FIRST_BOARD.checked().1);
        battery.sample(&[word, u16::MAX]);
        battery.cell(0).unwrap_or_default()
    };
    let (one, next) = (cell(word), cell(word.saturating_add(1)));
    assert!(one <= next);
    Seen::NOTHING.case(0, one < next).case(1, one == next)
}

/// The filter keeps a constant word, and follows a step without overshoot.
pub fn filter_never_overshoots(before: u16, after: u16, samples: u8) -> Seen {
    let config = AcceptedConfig::FIRST_BOARD.checked().1;
    let cell = |word: u16| {
        let mut battery = Battery::new(&config);
        battery.sample(&[word]);
        battery.cell(0).unwrap_or_default()
    };
    let mut battery = Battery::new(&config);
    for _ in 0..3 {
        battery.sample(&[before]);
    }
    assert!(battery.cell(0) == Some(cell(before)));
    let (low, high) = (cell(before.min(after)), cell(before.max(after)));
    for _ in 0..samples {
        battery.sample(&[after]);
        let now = battery.cell(0).unwrap_or_default();
        assert!(low <= now && now <= high);
    }
    seen!(before < after && samples > 0, before > after && samples > 0)
}

/// With the tuned resistor the same word gives the reference, to a part in a thousand, an ohm and a last
/// place (document, 5.1.3).
// Requirement: DOC-5.1.3-4
pub fn tuned_divider_shows_the_reference(
    values: AcceptedConfig,
    word: u16,
    reference: u32,
) -> Seen {
    given!(let Some(config) = values.config());
    let mut battery = Battery::new(&config);
    battery.sample(&[word]);
    let reference = Volts(U16F16::from_bits(reference));
    let shown = battery.cell(0).map_or(0.0, volts);
    let Some(upper) = battery.tune(0, reference) else {
        assert!(reference == Volts::default() || shown == 0.0);
        return Seen::NOTHING.case(0, true);
    };
    let lower = config.dividers()[0].lower.0;
    // A resistor that no configuration may have is of no use.
    let Some(config) = values.with(TAP_1_UPPER, upper.into()).config() else {
        assert!(upper > 10_000_000 || u64::from(upper) > 99 * u64::from(lower));
        return Seen::NOTHING.case(2, true);
    };
    let mut tuned = Battery::new(&config);
    tuned.sample(&[word]);
    let now = tuned.cell(0).map_or(0.0, volts);
    let reference = volts(reference);
    // A coarse or a saturated reading cannot be tuned, nor a divider below 0 ohm.
    let ohm = reference / (f64::from(upper) + f64::from(lower));
    if shown > 0.5 && shown < 65_535.0 && upper > 0 && upper < u32::MAX - lower {
        assert!((now - reference).abs() <= reference / 1000.0 + ohm + 1e-4);
    }
    Seen::NOTHING.case(1, shown > 0.5 && upper > 0)
}

/// The cut-off latches after half a second below its threshold, not earlier; a threshold of 0 disables it.
pub fn cutoff_takes_half_a_second(ticks: u8, supervised: bool) -> Seen {
    let mut values = AcceptedConfig::FIRST_BOARD;
    if !supervised {
        values = values.with(BATTERY_CUTOFF, 0).with(BATTERY_WARN, 0);
    }
    let config = values.config().expect("accepted");
    let mut battery = Battery::new(&config);
    // 2 V and 3.9 V a cell on the first board's taps.
    let (empty, full) = ([1_905_u16, 1_986], [3_714_u16, 3_872]);
    for _ in 0..ticks {
        battery.sample(&empty);
    }
    let (low, off) = (battery.low(), battery.empty());
    assert!(off == (supervised && ticks >= 50) && low == off);
    for _ in 0..255 {
        battery.sample(&full);
    }
    // The filter prolongs a sag by some ticks.
    assert!(!battery.low() && (battery.empty() == off || (35..50).contains(&ticks)));
    Seen::NOTHING.case(0, off).case(1, !off && supervised)
}

/// No two samples of the first board's taps overflow, and no cell exceeds the range of its taps.
pub fn first_board_samples_are_safe(first: [u16; 2], second: [u16; 2]) -> Seen {
    let mut battery = Battery::new(&AcceptedConfig::FIRST_BOARD.checked().1);
    battery.sample(&first);
    battery.sample(&second);
    let (one, two) = (battery.cell(0), battery.cell(1));
    assert!(one.is_some() && two.is_some() && battery.cell(2).is_none());
    // 16 times the largest word of 12 bits.
    let highest = Volts(U16F16::from_bits(140 << 16));
    assert!(one.unwrap_or_default() <= highest && two.unwrap_or_default() <= highest);
    seen!(one > two, two == Some(Volts::default()))
}

/// For any accepted full scale, largest word and divider: no overflow, and words of 0 give 0 V.
pub fn any_divider_is_safe(
    full_scale: Binary64,
    largest: u16,
    ohms: (u32, u32),
    words: [u16; 2],
) -> Seen {
    let (true, config) = one_cell(full_scale, largest, ohms) else {
        return Seen::NOTHING.case(2, true);
    };
    let mut battery = Battery::new(&config);
    let mut voltage = Volts::default();
    for word in words {
        battery.sample(&[word]);
        let cell = battery.cell(0);
        assert!(cell.is_some());
        voltage = cell.unwrap_or_default();
    }
    assert!(words != [0; 2] || voltage == Volts::default());
    let most = Volts(U16F16::MAX);
    Seen::NOTHING
        .case(0, voltage == most)
        .case(1, voltage > Volts::default() && voltage < most)
}

/// Tuning with any resistors and reference does not overflow, and finds a resistor unless reference or
/// reading are 0.
pub fn any_tuning_is_safe(ohms: (u32, u32), word: u16, reference: u32) -> Seen {
    let full_scale = Binary64(3.3_f64.to_bits());
    given!(let (true, config) = one_cell(full_scale, 4095, ohms));
    let mut battery = Battery::new(&config);
    battery.sample(&[word]);
    let shown = battery.cell(0).unwrap_or_default();
    let tuned = battery.tune(0, Volts(U16F16::from_bits(reference)));
    assert!(tuned.is_none() == (reference == 0 || shown == Volts::default()));
    assert!(battery.tune(1, shown).is_none());
    Seen::NOTHING
        .case(0, tuned.is_none())
        .case(1, tuned.is_some_and(|tuned| tuned > ohms.0))
        .case(2, tuned == Some(0))
}

crate::properties! {
    property T10 every_cell_shows_a_voltage(values: AcceptedConfig, words: [(Words, ()); 2]) {
        cases ["a cell beside one of 0 V", "eight cells"];
        needs [accepted_configuration_is_bounded];
        sampled 50_000;
    }
    property T10 voltage_is_the_dividers(values: AcceptedConfig, word: u16) {
        cases ["saturated", "a voltage"];
        needs [accepted_configuration_is_bounded];
        sampled 200_000;
    }
    theorem T10 voltage_is_monotone(word: u16) {
        cases ["a higher voltage", "the same voltage"];
        exhaustive (0..=u16::MAX).map(|word| (word,));
    }
    property T10 filter_never_overshoots(before: u16, after: u16, samples: u8) {
        cases ["rising", "falling"];
        sampled 50_000;
    }
    property T10 tuned_divider_shows_the_reference(values: AcceptedConfig, word: u16, reference: u32) {
        cases ["nothing to tune", "tuned", "no resistor that is accepted"];
        needs [accepted_configuration_is_bounded];
        sampled 100_000;
    }
    theorem T10 cutoff_takes_half_a_second(ticks: u8, supervised: bool) {
        cases ["cut off", "not yet"];
        exhaustive (0..=u8::MAX).flat_map(|ticks| [(ticks, false), (ticks, true)]);
    }
    theorem T5 any_divider_is_safe(
        full_scale: Binary64, largest: u16, ohms: (u32, u32), words: [u16; 2]
    ) {
        cases ["saturated", "a voltage", "not accepted"];
        kani proof [unwind(80)];
        sampled 200_000;
    }
    theorem T5 any_tuning_is_safe(ohms: (u32, u32), word: u16, reference: u32) {
        cases ["nothing to compare", "a larger resistor", "0 ohm"];
        kani proof [unwind(80), solver(minisat)];
        sampled 200_000;
    }
    theorem T10 first_board_samples_are_safe(first: [u16; 2], second: [u16; 2]) {
        cases ["the first cell is higher", "the second tap is not above the first"];
        kani proof [unwind(80), solver(minisat)];
        sampled 100_000;
    }
}

//! T5 and T9: the temperature sensor for any words and any calibration.

use fw_core::sensing::{Calibration, SupplyCorrection, Thermometer};

use crate::input::{Input, Source};
use crate::property::Seen;

/// Typical part of the data sheet.
const TYPICAL: Calibration = Calibration {
    reference: 1501,
    cold: 959,
    hot: 1207,
};

/// Any word, often near that of a working part.
fn word(source: &mut impl Source, typical: u16) -> u16 {
    let (anything, word) = (source.bits8() % 4 == 0, source.bits16());
    if anything {
        word
    } else {
        typical - 256 + (word & 0x1FF)
    }
}

impl Input for Calibration {
    fn draw(source: &mut impl Source) -> Self {
        Self {
            reference: word(source, TYPICAL.reference),
            cold: word(source, TYPICAL.cold),
            hot: word(source, TYPICAL.hot),
        }
    }
}

/// The words of one reading.
#[derive(Clone, Copy, Debug)]
pub struct Words {
    /// The sensor.
    pub sensor: u16,
    /// The voltage reference.
    pub reference: u16,
}

impl Input for Words {
    fn draw(source: &mut impl Source) -> Self {
        Self {
            sensor: word(source, TYPICAL.cold),
            reference: word(source, TYPICAL.reference),
        }
    }
}

/// For any calibration and two readings: no overflow, no division by zero, and every temperature is
/// between −42.5 and 102.5 °C of the air.
pub fn temperature_is_total(calibration: Calibration, first: Words, second: Words) -> Seen {
    let mut thermometer = Thermometer::new(calibration);
    let mut read = [None; 2];
    for (read, words) in read.iter_mut().zip([first, second]) {
        *read = thermometer.read(words.sensor, words.reference);
        if let Some(celsius) = *read {
            assert!(calibration.is_plausible());
            assert!((-43..=103).contains(&celsius));
        }
    }
    Seen::NOTHING
        .case(0, read[1].is_some())
        .case(1, calibration.is_plausible() && read[0].is_none())
        .case(2, !calibration.is_plausible())
}

/// The temperature is monotone in the sensor word, at any supply.
pub fn temperature_is_monotone(sensor: u16, reference: u16) -> Seen {
    let read = |sensor| Thermometer::new(TYPICAL).read(sensor, reference);
    let (one, two) = (read(sensor), read(sensor.saturating_add(1)));
    if let (Some(one), Some(two)) = (one, two) {
        assert!(one <= two);
    }
    Seen::NOTHING
        .case(0, one.is_some() && two.is_some())
        .case(1, one.is_some() != two.is_some())
}

/// The correction for these words of the reference, at the factory and now, and whether both are plausible.
fn correction(at_factory: u16, reference: u16) -> (SupplyCorrection, bool) {
    let calibration = Calibration {
        reference: at_factory,
        ..Calibration::UNWRITTEN
    };
    let plausible = (1400..=1600).contains(&at_factory) && (1270..=2115).contains(&reference);
    (calibration.supply_correction(reference), plausible)
}

/// A tap's word of 12 bits at any plausible supply becomes that at 3.3 V, to half a unit and a sixteenth.
// Requirement: WIRE-battery-4
pub fn supply_correction_is_nearest(at_factory: u16, reference: u16, word: u16) -> Seen {
    given!(let (correction, true) = correction(at_factory, reference));
    given!(word <= 0xFFF);
    let nominal = correction.apply(word);
    let [word, nominal, at_factory, reference] =
        [word, nominal, at_factory, reference].map(i32::from);
    assert!(16 * (nominal * reference - word * at_factory).abs() <= 9 * reference);
    seen!(nominal > 4095, nominal < word)
}

/// Where the reference's word or its calibration is implausible, a word stays what it is.
// Requirement: WIRE-battery-4
pub fn supply_correction_needs_the_reference(at_factory: u16, reference: u16, word: u16) -> Seen {
    given!(let (correction, false) = correction(at_factory, reference));
    assert!(correction.apply(word) == word & 0xFFF);
    seen!(at_factory == 0xFFFF, at_factory == 1501 && word > 0)
}

crate::properties! {
    theorem T9 supply_correction_is_nearest(at_factory: u16, reference: u16, word: u16) {
        cases ["above the full scale", "a supply below 3.3 V"];
        exhaustive (1400..=1600_u16).flat_map(|at_factory| (1270..=2115_u16).flat_map(move |reference| {
            (0..4096_u16).map(move |word| (at_factory, reference, word))
        }));
    }
    theorem T9 supply_correction_needs_the_reference(at_factory: u16, reference: u16, word: u16) {
        cases ["no calibration", "an implausible reading"];
        kani proof [unwind(3)];
        stepped [0, 1399, 1501, 1601, u16::MAX].into_iter().flat_map(|at_factory| {
            (0..=u16::MAX).flat_map(move |reference| {
                [0, 1, 4095, u16::MAX].map(|word| (at_factory, reference, word))
            })
        });
    }
    theorem T5 temperature_is_total(calibration: Calibration, first: Words, second: Words) {
        cases ["a temperature", "a reading out of range", "an implausible calibration"];
        kani proof [unwind(3)];
        stepped (700..=1300_u16).step_by(60).flat_map(|cold| (150..=350).step_by(50).flat_map(move |span| {
            (0..=4096_u16).step_by(16).flat_map(move |sensor| [1270, 1501, 1800].map(|reference| {
                let calibration = Calibration { reference: 1600, cold, hot: cold + span };
                let opposite = Words { sensor: 4095 - sensor.min(4095), reference: 1501 };
                (calibration, Words { sensor, reference }, opposite)
            }))
        })).chain([(
            Calibration::UNWRITTEN,
            Words { sensor: 959, reference: 1501 },
            Words { sensor: 959, reference: 1501 },
        )]);
        sampled 100_000;
    }
    theorem T9 temperature_is_monotone(sensor: u16, reference: u16) {
        cases ["two temperatures", "the end of the range"];
        kani typical_supply [unwind(3)] = (any(), TYPICAL.reference);
        exhaustive (1260..=1810_u16).flat_map(|reference| (0..4096_u16).map(move |sensor| (sensor, reference)));
    }
}

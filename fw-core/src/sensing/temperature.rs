//! Air temperature from the microcontroller's sensor (RM0383, 11.9; DS10314, temperature sensor
//! characteristics).
//!
//! The part holds its factory readings of the sensor at 30 and 110 °C and of the voltage reference, at a
//! supply of 3.3 V. Reading the reference with the sensor compensates for the actual supply.
//!
//! The chip is warmer than the air by an estimated 2.5 K: some 50 mW through the package's 51 K/W. An
//! error of 5 K is 0.9 % of a distance.

use fixed::types::I16F16;

/// Factory calibration in the part's system memory: ADC words, 12 bits, right-aligned.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct Calibration {
    /// 0x1FFF7A2A: the voltage reference.
    pub reference: u16,
    /// 0x1FFF7A2C: the sensor at 30 °C.
    pub cold: u16,
    /// 0x1FFF7A2E: the sensor at 110 °C.
    pub hot: u16,
}

/// Largest word of 12 bits.
const FULL_SCALE: u16 = 4095;
/// Reference words at 3.3 V: 1.18 to 1.24 V, with a margin.
const REFERENCE: (u16, u16) = (1400, 1600);
/// Sensor words at 30 °C: 959 typically (0.77 V), ±140 for 45 K from part to part, with a margin.
const COLD: (u16, u16) = (700, 1300);
/// Difference of the sensor words at 30 and 110 °C: 248 typically (2.5 mV/K).
const SPAN: (u16, u16) = (150, 350);
/// Reference words at a supply of 2.8 to 3.8 V: for the thermometer.
const SUPPLY: (u16, u16) = (1270, 1800);
/// And of 2.4 V, below which the converter would run too fast (DS10314), to 3.8 V: for other channels.
const CORRECTED_SUPPLY: (u16, u16) = (1270, 2115);
/// Range of the part, 2⁻¹² °C.
const COLDEST: i32 = -40 << 12;
const HOTTEST: i32 = 105 << 12;
/// Chip above air, 2⁻¹² K: 2.5 K.
const SELF_HEATING: i32 = 5 << 11;
/// Calibration points: the colder one, °C, and their distance, K.
const AT_COLD: i32 = 30;
const APART: i32 = 80;
/// Weight of a reading in the filter, 2⁻ⁿ.
const FILTER_SHIFT: u32 = 2;

const fn within(word: u16, limits: (u16, u16)) -> bool {
    limits.0 <= word && word <= limits.1
}

impl Calibration {
    /// Erased memory.
    pub const UNWRITTEN: Self = Self {
        reference: u16::MAX,
        cold: u16::MAX,
        hot: u16::MAX,
    };

    /// Whether a working part can hold these words.
    pub const fn is_plausible(&self) -> bool {
        within(self.reference, REFERENCE)
            && within(self.cold, COLD)
            && within(self.hot, (self.cold + SPAN.0, self.cold + SPAN.1))
    }

    /// The correction of other channels' words of the scan in which the reference read this word. It changes
    /// nothing where that word or the calibration is implausible.
    #[inline]
    pub const fn supply_correction(&self, reference: u16) -> SupplyCorrection {
        if within(self.reference, REFERENCE) && within(reference, CORRECTED_SUPPLY) {
            SupplyCorrection(((self.reference as u32) << 16) / reference as u32)
        } else {
            SupplyCorrection(1 << 16)
        }
    }
}

/// From words at the present supply, which is the converter's full scale, to words at 3.3 V. A pin above the
/// supply reads as the supply: too low, never too high.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct SupplyCorrection(
    /// 2⁻¹⁶, at most 1600/1270.
    u32,
);

impl SupplyCorrection {
    /// A word of 12 bits as it would be at 3.3 V, nearest, within 0.06: 0 ..= 5159. Further bits are
    /// ignored.
    // Requirement: WIRE-battery-4
    #[inline]
    pub const fn apply(self, word: u16) -> u16 {
        (((word & FULL_SCALE) as u32 * self.0 + (1 << 15)) >> 16) as u16
    }
}

/// The filtered air temperature.
#[derive(Clone, Debug)]
pub struct Thermometer {
    calibration: Calibration,
    /// 2⁻¹² °C; `None` after an implausible reading.
    air: Option<i32>,
}

impl Thermometer {
    /// Without a reading.
    pub const fn new(calibration: Calibration) -> Self {
        Self {
            calibration,
            air: None,
        }
    }

    /// One reading of both channels: air temperature, °C, −42.5 ..= 102.5. `None` if the words or the
    /// calibration are implausible for a part between −40 and 105 °C.
    pub fn read(&mut self, sensor: u16, reference: u16) -> Option<I16F16> {
        self.air = self.chip(sensor, reference).map(|chip| {
            let now = chip - SELF_HEATING;
            match self.air {
                Some(old) => old + ((now - old) >> FILTER_SHIFT),
                None => now,
            }
        });
        self.air.map(|air| I16F16::from_bits(air << 4))
    }

    /// Chip temperature, 2⁻¹² °C.
    fn chip(&self, sensor: u16, reference: u16) -> Option<i32> {
        let Calibration {
            reference: at_factory,
            cold,
            hot,
        } = self.calibration;
        if !self.calibration.is_plausible() || sensor > FULL_SCALE || !within(reference, SUPPLY) {
            return None;
        }
        // Sensor word at 3.3 V, 2⁻⁸: the product is below 2³², the quotient below 2²¹.
        let word =
            ((u32::from(sensor) * u32::from(at_factory)) << 8).checked_div(reference.into())?;
        let span = i32::from(hot) - i32::from(cold);
        // ±120 000 is 107 K at the largest span: whatever is cut off is out of range below.
        let above = (word as i32 - (i32::from(cold) << 8)).clamp(-120_000, 120_000);
        // 2⁻⁸ words times 2⁻⁴.
        let chip = (AT_COLD << 12) + (above * (APART << 4)).checked_div(span)?;
        (COLDEST..=HOTTEST).contains(&chip).then_some(chip)
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    const TYPICAL: Calibration = Calibration {
        reference: 1501,
        cold: 959,
        hot: 1207,
    };

    /// Sensor and reference words of a typical part at a chip temperature and a supply, volts.
    fn words(chip: f64, supply: f64) -> (u16, u16) {
        let word = |volts: f64| (volts / supply * 4095.0).round().clamp(0.0, 65_535.0) as u16;
        (word(0.76 + (chip - 25.0) * 0.0025), word(1.21))
    }

    fn read(calibration: Calibration, (sensor, reference): (u16, u16)) -> Option<f64> {
        let celsius = Thermometer::new(calibration).read(sensor, reference);
        celsius.map(I16F16::to_num::<f64>)
    }

    #[test]
    fn temperature_is_within_a_degree_at_any_supply() {
        for supply in [2.8, 3.3, 3.6] {
            for chip in -36..=104 {
                let chip = f64::from(chip);
                let air = read(TYPICAL, words(chip, supply)).expect("within range");
                assert!(
                    (air - (chip - 2.5)).abs() < 1.0,
                    "{chip} at {supply}: {air}"
                );
            }
        }
    }

    // Requirement: WIRE-battery-4
    #[test]
    fn word_at_any_supply_becomes_that_at_3_3_volts() {
        let word = |volts: f64, supply: f64| (volts / supply * 4095.0).round() as u16;
        for supply in [2.4, 3.0, 3.3, 3.6] {
            let correction = TYPICAL.supply_correction(word(1.21, supply));
            for pin in [0.0, 1.0, 2.3] {
                let nominal = f64::from(correction.apply(word(pin, supply)));
                let error = nominal / 4095.0 * 3.3 - pin;
                assert!(error.abs() < 0.002, "{pin} V at {supply} V: {error}");
            }
        }
        let correction = TYPICAL.supply_correction(TYPICAL.reference);
        assert!((0..=4095).all(|word| correction.apply(word) == word));
        // 371.75.
        assert_eq!(TYPICAL.supply_correction(1502).apply(372), 372);
        for (calibration, reference) in [(TYPICAL, 1269), (TYPICAL, 2116), (TYPICAL, 0)] {
            let correction = calibration.supply_correction(reference);
            assert_eq!(correction, Calibration::UNWRITTEN.supply_correction(1501));
            assert_eq!(correction.apply(4095), 4095);
        }
    }

    #[test]
    fn hottest_part_of_the_largest_span_is_within_range() {
        let [reference, cold, hot] = [1600, 1300, 1650];
        let part = Calibration {
            reference,
            cold,
            hot,
        };
        // 104 °C in the chip.
        let air = read(part, (1624, reference)).expect("within range");
        assert!((air - 101.5).abs() < 0.1, "{air}");
    }

    #[test]
    fn temperature_outside_the_part_range_is_none() {
        for chip in [-60.0, -45.0, 110.0, 300.0] {
            assert_eq!(read(TYPICAL, words(chip, 3.3)), None, "{chip}");
        }
    }

    #[test]
    fn calibration_is_plausible_exactly_within_its_limits() {
        let with = |reference, cold, span| Calibration {
            reference,
            cold,
            hot: cold + span,
        };
        for (inside, outside) in [
            ((1400, 700, 150), (1399, 700, 150)),
            ((1400, 700, 150), (1400, 699, 150)),
            ((1400, 700, 150), (1400, 700, 149)),
            ((1600, 1300, 350), (1601, 1300, 350)),
            ((1600, 1300, 350), (1600, 1301, 350)),
            ((1600, 1300, 350), (1600, 1300, 351)),
        ] {
            let sensor = outside.1 + outside.2 / 2;
            let [inside, outside] = [inside, outside].map(|(r, c, s)| with(r, c, s));
            assert!(inside.is_plausible(), "{inside:?}");
            assert!(!outside.is_plausible(), "{outside:?}");
            assert_eq!(read(outside, (sensor, outside.reference)), None);
            assert!(read(inside, (sensor, inside.reference)).is_some());
        }
        let swapped = Calibration {
            cold: TYPICAL.hot,
            hot: TYPICAL.cold,
            ..TYPICAL
        };
        assert!(!Calibration::UNWRITTEN.is_plausible() && !swapped.is_plausible());
    }

    #[test]
    fn temperature_of_implausible_words_is_none() {
        for reference in [1270, 1501, 1800] {
            for sensor in 4096..=u16::MAX {
                assert_eq!(read(TYPICAL, (sensor, reference)), None, "{sensor}");
            }
        }
        // 30 °C at every supply.
        for reference in 1000..2200_u16 {
            let sensor = (u32::from(reference) * 959 / 1501) as u16;
            let plausible = (1270..=1800).contains(&reference);
            let air = read(TYPICAL, (sensor, reference));
            assert_eq!(air.is_some(), plausible, "{reference}");
        }
    }

    #[test]
    fn temperature_is_filtered_and_restarts_after_a_gap() {
        let mut thermometer = Thermometer::new(TYPICAL);
        let mut at = |chip: f64| {
            let (sensor, reference) = words(chip, 3.3);
            let celsius = thermometer.read(sensor, reference);
            celsius.map(I16F16::to_num::<f64>)
        };
        let first = at(20.0).unwrap();
        let second = at(40.0).unwrap();
        assert!((second - first - 5.0).abs() < 0.5, "{first} {second}");
        for _ in 0..20 {
            at(40.0);
        }
        assert!((at(40.0).unwrap() - 37.5).abs() < 0.5);
        assert_eq!(at(300.0), None);
        assert!((at(0.0).unwrap() + 2.5).abs() < 0.5);
    }
}

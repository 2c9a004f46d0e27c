//! How warm the air is, by the microcontroller's own sensor (RM0383, 11.9; DS10314, temperature sensor
//! characteristics).
//!
//! The factory measured every part's sensor at 30 and 110 °C and its voltage reference, all with the
//! ADC's supply at 3.3 V. Reading the reference beside the sensor takes the real supply out.
//!
//! What is measured is the chip, and the chip is warmer than the air: some 50 mW through 51 K/W of the
//! package are 2.5 K, which are taken off. That is an estimate: what stands next to the chip warms it
//! too. 5 K more or less are 0.9 % of a distance.

use fixed::types::I16F16;

/// Words of the ADC, 12 bits, right-aligned, as the factory left them in the part's system memory.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct Calibration {
    /// 0x1FFF7A2A: the voltage reference.
    pub reference: u16,
    /// 0x1FFF7A2C: the sensor at 30 °C.
    pub cold: u16,
    /// 0x1FFF7A2E: the sensor at 110 °C.
    pub hot: u16,
}

/// Of a word of 12 bits.
const FULL_SCALE: u16 = 4095;
/// Reference words at 3.3 V that 1.18 to 1.24 V make, and a little more.
const REFERENCE: (u16, u16) = (1400, 1600);
/// Sensor words at 30 °C: 0.77 V are 959, and 45 K from part to part are 140.
const COLD: (u16, u16) = (700, 1300);
/// From 30 to 110 °C: 2.5 mV/K are 248.
const SPAN: (u16, u16) = (150, 350);
/// Reference words that a supply of 2.8 to 3.8 V makes.
const SUPPLY: (u16, u16) = (1270, 1800);
/// °C, 2⁻¹²: what the part is made for.
const COLDEST: i32 = -40 << 12;
const HOTTEST: i32 = 105 << 12;
/// Chip over air, °C, 2⁻¹²: 2.5 K.
const SELF_HEATING: i32 = 5 << 11;
/// Of the calibration points, °C.
const AT_COLD: i32 = 30;
const APART: i32 = 80;
/// Each reading's share in the filter, 2⁻ⁿ.
const FILTER: u32 = 2;

const fn within(word: u16, limits: (u16, u16)) -> bool {
    limits.0 <= word && word <= limits.1
}

impl Calibration {
    /// A part whose words nobody wrote, as an erased memory reads.
    pub const UNWRITTEN: Self = Self {
        reference: u16::MAX,
        cold: u16::MAX,
        hot: u16::MAX,
    };

    /// Whether a working part can have these words.
    #[must_use]
    pub const fn is_plausible(&self) -> bool {
        within(self.reference, REFERENCE)
            && within(self.cold, COLD)
            && within(self.hot, (self.cold + SPAN.0, self.cold + SPAN.1))
    }
}

/// The thermometer.
#[derive(Clone, Debug)]
pub struct Thermometer {
    calibration: Calibration,
    /// °C of the air, 2⁻¹², while there is a reading.
    air: Option<i32>,
}

impl Thermometer {
    /// Nothing read yet.
    #[must_use]
    pub const fn new(calibration: Calibration) -> Self {
        Self {
            calibration,
            air: None,
        }
    }

    /// A reading of both channels, words as they came; °C of the air, −42.5 ..= 102.5. `None` where the
    /// words, or those of the factory, cannot be a working part's between −40 and 105 °C.
    pub fn read(&mut self, sensor: u16, reference: u16) -> Option<I16F16> {
        self.air = self.chip(sensor, reference).map(|chip| {
            let now = chip - SELF_HEATING;
            match self.air {
                Some(old) => old + ((now - old) >> FILTER),
                None => now,
            }
        });
        self.air.map(|air| I16F16::from_bits(air << 4))
    }

    /// °C of the chip, 2⁻¹².
    fn chip(&self, sensor: u16, reference: u16) -> Option<i32> {
        let Calibration {
            reference: at_factory,
            cold,
            hot,
        } = self.calibration;
        if !self.calibration.is_plausible() || sensor > FULL_SCALE || !within(reference, SUPPLY) {
            return None;
        }
        // What it would read at 3.3 V, 2⁻⁸: below 2³² on the way, below 2²¹ in the end.
        let word =
            ((u32::from(sensor) * u32::from(at_factory)) << 8).checked_div(reference.into())?;
        let span = i32::from(hot) - i32::from(cold);
        // 120 000 are 107 K at the flattest span: what is cut off here is out of range below.
        let above = (word as i32 - (i32::from(cold) << 8)).clamp(-120_000, 120_000);
        // 2⁻⁸ words times 2⁻⁴.
        let chip = (AT_COLD << 12) + (above * (APART << 4)).checked_div(span)?;
        (COLDEST..=HOTTEST).contains(&chip).then_some(chip)
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    /// A part as the data sheet has it typically, its ADC supplied with `supply` volts.
    const TYPICAL: Calibration = Calibration {
        reference: 1501,
        cold: 959,
        hot: 1207,
    };

    #[allow(clippy::cast_possible_truncation, clippy::cast_sign_loss)]
    fn words(chip: f64, supply: f64) -> (u16, u16) {
        let word = |volts: f64| (volts / supply * 4095.0).round().clamp(0.0, 65_535.0) as u16;
        (word(0.76 + (chip - 25.0) * 0.0025), word(1.21))
    }

    fn read(calibration: Calibration, sensor: u16, reference: u16) -> Option<f64> {
        let celsius = Thermometer::new(calibration).read(sensor, reference);
        celsius.map(I16F16::to_num::<f64>)
    }

    #[test]
    fn it_reads_the_air_within_a_degree_whatever_the_supply() {
        for supply in [3.0, 3.3, 3.6] {
            for degrees in -36..=104 {
                let chip = f64::from(degrees);
                let (sensor, reference) = words(chip, supply);
                let air = read(TYPICAL, sensor, reference).expect("within range");
                assert!(
                    (air - (chip - 2.5)).abs() < 1.0,
                    "{chip} at {supply}: {air}"
                );
            }
        }
    }

    #[test]
    fn what_no_working_part_says_is_no_temperature() {
        let (sensor, reference) = words(25.0, 3.3);
        for calibration in [
            Calibration::UNWRITTEN,
            Calibration {
                reference: 0,
                ..TYPICAL
            },
            Calibration {
                cold: 0,
                hot: 248,
                ..TYPICAL
            },
            Calibration {
                cold: 1207,
                hot: 959,
                ..TYPICAL
            },
            Calibration {
                hot: 959,
                ..TYPICAL
            },
        ] {
            assert_eq!(
                read(calibration, sensor, reference),
                None,
                "{calibration:?}"
            );
        }
        for chip in [-60.0, -45.0, 110.0, 300.0] {
            let (sensor, reference) = words(chip, 3.3);
            assert_eq!(read(TYPICAL, sensor, reference), None, "{chip}");
        }
        for (sensor, reference) in [
            (0, 1501),
            (4095, 1501),
            (959, 0),
            (959, 4095),
            (65_535, 1501),
        ] {
            assert_eq!(
                read(TYPICAL, sensor, reference),
                None,
                "{sensor} {reference}"
            );
        }
    }

    #[test]
    fn the_factorys_words_are_plausible_within_their_limits_and_not_beyond_one() {
        let with = |reference, cold, apart| Calibration {
            reference,
            cold,
            hot: cold + apart,
        };
        for (inside, outside) in [
            (with(1400, 700, 150), with(1399, 700, 150)),
            (with(1400, 700, 150), with(1400, 699, 150)),
            (with(1400, 700, 150), with(1400, 700, 149)),
            (with(1600, 1300, 350), with(1601, 1300, 350)),
            (with(1600, 1300, 350), with(1600, 1301, 350)),
            (with(1600, 1300, 350), with(1600, 1300, 351)),
        ] {
            assert!(inside.is_plausible(), "{inside:?}");
            assert!(!outside.is_plausible(), "{outside:?}");
            // Between the two calibrated temperatures, were they any.
            let sensor = u16::midpoint(outside.cold, outside.hot);
            assert_eq!(read(outside, sensor, outside.reference), None);
            assert!(read(inside, sensor, inside.reference).is_some());
        }
        assert!(!Calibration::UNWRITTEN.is_plausible());
    }

    #[test]
    fn only_words_of_twelve_bits_beside_a_reference_of_2_8_to_3_8_volts_are_a_reading() {
        for reference in [1270, 1501, 1800] {
            for sensor in 4096..=u16::MAX {
                assert_eq!(read(TYPICAL, sensor, reference), None, "{sensor}");
            }
        }
        // At 30 °C, whatever the supply makes of both words.
        for reference in 1000..2200_u16 {
            let sensor = (u32::from(reference) * 959 / 1501) as u16;
            let air = read(TYPICAL, sensor, reference);
            assert_eq!(
                air.is_some(),
                (1270..=1800).contains(&reference),
                "{reference}"
            );
        }
    }

    #[test]
    fn it_follows_slowly_and_begins_anew_after_a_gap() {
        let mut thermometer = Thermometer::new(TYPICAL);
        let mut at = |chip: f64| {
            let (sensor, reference) = words(chip, 3.3);
            thermometer
                .read(sensor, reference)
                .map(I16F16::to_num::<f64>)
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

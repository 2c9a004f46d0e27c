//! Codes of the wire ↔ physical units: to the nearest code, saturating; back to the nearest value.

#![allow(
    clippy::cast_possible_truncation,
    clippy::cast_possible_wrap,
    clippy::cast_sign_loss,
    reason = "codes are cut to their width on purpose"
)]

use super::{CellCode, DistanceCode, PoseCode};
use crate::types::{Millimetres, Pose, Turns, Volts};
use fixed::types::{I32F32, U16F16};

impl PoseCode {
    /// The nearest codes; lengths beyond ±2 147 483.648 mm saturate, a rotation that rounds to a
    /// whole turn is 0.
    #[inline]
    #[must_use]
    pub fn from_pose(pose: &Pose) -> Self {
        Self {
            x: length_code(pose.x),
            y: length_code(pose.y),
            rotation: rotation_code(pose.heading),
        }
    }

    /// The pose, to the nearest 2⁻³² mm; the rotation exactly.
    #[inline]
    #[must_use]
    pub fn to_pose(&self) -> Pose {
        Pose {
            x: length(self.x),
            y: length(self.y),
            heading: Turns(u32::from(self.rotation & 0x7FFF) << 17),
        }
    }
}

/// Millimetres × 1000, nearest (a tie goes up), saturating.
// Requirement: DOC-5.1.1-2, WIRE-code-1
#[inline]
fn length_code(length: Millimetres) -> i32 {
    let bits = length.0.to_bits();
    // Whole and fractional millimetres apart: both products stay far inside 64 bits.
    let whole = (bits >> 32).wrapping_mul(1000);
    let part = (bits & 0xFFFF_FFFF).wrapping_mul(1000);
    let code = whole.wrapping_add(part.wrapping_add(1 << 31) >> 32);
    // Requirement: WIRE-position-1
    match i32::try_from(code) {
        Ok(code) => code,
        Err(_) if code < 0 => i32::MIN,
        Err(_) => i32::MAX,
    }
}

/// Code / 1000 in millimetres, to the nearest 2⁻³² mm, without a 64-bit division.
#[inline]
fn length(code: i32) -> Millimetres {
    // code · 2³² / 1000 = code · 2²⁹ / 125; 125 goes k times into code, leaving r, and
    // 2²⁹ / 125 = 4 294 967 + 37 / 125.
    let magnitude = code.unsigned_abs();
    let (k, r) = (magnitude / 125, magnitude % 125);
    let tail = r.wrapping_mul(74).wrapping_add(125) / 250;
    let bits = (u64::from(k) << 29)
        .wrapping_add(u64::from(r.wrapping_mul(4_294_967)))
        .wrapping_add(tail.into()) as i64;
    Millimetres(I32F32::from_bits(if code < 0 {
        bits.wrapping_neg()
    } else {
        bits
    }))
}

/// Turn × 0x8000, nearest (a tie goes up); what rounds to 0x8000 is 0.
// Requirement: DOC-5.1.1-3, WIRE-position-2
#[inline]
fn rotation_code(heading: Turns) -> u16 {
    // Wrapping past a whole turn is what makes 0x8000 become 0. 15 bits are left.
    (heading.0.wrapping_add(1 << 16) >> 17) as u16
}

impl CellCode {
    /// The largest voltage code: 40.955 V and above.
    pub const MAX_VOLTAGE: u16 = 0x1FFF;

    /// The nearest code of a cell's voltage (a tie goes up), saturating at 40.955 V. `cell` is
    /// taken modulo 8.
    // Requirement: DOC-5.1.3-2
    #[inline]
    #[must_use]
    pub fn from_volts(cell: u8, voltage: Volts) -> Self {
        let scaled = u64::from(voltage.0.to_bits()).wrapping_mul(200);
        let code = scaled.wrapping_add(1 << 15) >> 16;
        Self {
            cell: cell & 7,
            voltage: code.min(Self::MAX_VOLTAGE.into()) as u16,
        }
    }

    /// The voltage, to the nearest 2⁻¹⁶ V.
    #[inline]
    #[must_use]
    pub fn to_volts(&self) -> Volts {
        let code = u32::from(self.voltage & Self::MAX_VOLTAGE);
        // code · 2¹⁶ / 200 = code · 8192 / 25.
        let bits = code.wrapping_mul(16_384).wrapping_add(25) / 50;
        Volts(U16F16::from_bits(bits))
    }
}

impl DistanceCode {
    /// The nearest code (a tie goes up). A distance that is negative, or that rounds to 2500 mm or
    /// more, is out of range: [`Self::NONE`].
    // Requirement: DOC-5.1.4-1
    #[inline]
    #[must_use]
    pub fn from_distance(distance: Option<Millimetres>) -> Self {
        let Some(Millimetres(distance)) = distance else {
            return Self::NONE;
        };
        let bits = distance.to_bits();
        if !(0..2500 << 32).contains(&bits) {
            return Self::NONE;
        }
        // mm · 65535 / 2500 = mm · 13107 / 500, and half of 500 rounds; the quotient is at most
        // 0xFFFF, which is NONE already.
        let scaled = bits.wrapping_mul(13_107).wrapping_add(250 << 32) >> 32;
        Self((scaled as u32 / 500) as u16)
    }

    /// The distance, to the nearest 2⁻³² mm; nothing for [`Self::NONE`].
    // Requirement: DOC-5.1.4-2
    #[must_use]
    pub fn to_distance(self) -> Option<Millimetres> {
        if self == Self::NONE {
            return None;
        }
        // code · 500 / 13107.
        let scaled = (i64::from(self.0).wrapping_mul(1000) << 32).wrapping_add(13_107);
        Some(Millimetres(I32F32::from_bits(scaled / 26_214)))
    }
}

/// A bearing's nearest code: turn × 0x10000 (a tie goes up), wrapping.
// Requirement: WIRE-bearing-1
#[inline]
#[must_use]
pub fn bearing_code(bearing: Turns) -> u16 {
    (bearing.0.wrapping_add(1 << 15) >> 16) as u16
}

/// The bearing of a code, exactly.
#[inline]
#[must_use]
pub fn bearing(code: u16) -> Turns {
    Turns(u32::from(code) << 16)
}

#[cfg(test)]
mod tests {
    use super::*;
    use proptest::prelude::*;

    fn pose(x: i64, heading: u32) -> Pose {
        Pose {
            x: Millimetres(I32F32::from_bits(x)),
            y: Millimetres(I32F32::from_bits(-1 - x)),
            heading: Turns(heading),
        }
    }

    /// round(bits · 1000 / 2³²), a tie up, in 128 bits.
    fn nearest_length(bits: i64) -> i32 {
        let code = (i128::from(bits) * 1000 + (1 << 31)) >> 32;
        code.clamp(i32::MIN.into(), i32::MAX.into()) as i32
    }

    #[test]
    fn lengths_saturate_and_go_backwards() {
        let code = |x| length_code(Millimetres(I32F32::from_num(x)));
        assert_eq!(code(0), 0);
        assert_eq!(code(1), 1000);
        assert_eq!(code(-1), -1000);
        assert_eq!(code(2_147_483), 2_147_483_000);
        assert_eq!(code(2_147_484), i32::MAX);
        assert_eq!(code(-2_147_484), i32::MIN);
        assert_eq!(length_code(Millimetres(I32F32::MAX)), i32::MAX);
        assert_eq!(length_code(Millimetres(I32F32::MIN)), i32::MIN);
        // Half a micrometre, and the last step below it.
        let half = 2_147_484;
        assert_eq!(length_code(Millimetres(I32F32::from_bits(half))), 1);
        assert_eq!(length_code(Millimetres(I32F32::from_bits(half - 1))), 0);
    }

    proptest! {
        #![proptest_config(ProptestConfig::with_cases(100_000))]

        #[test]
        fn a_length_becomes_its_nearest_code(bits in any::<i64>(), small in -1_i64 << 42..1 << 42) {
            for bits in [bits, small] {
                let code = PoseCode::from_pose(&pose(bits, 0));
                prop_assert_eq!(code.x, nearest_length(bits));
                prop_assert_eq!(code.y, nearest_length(-1 - bits));
            }
        }

        #[test]
        fn a_length_code_becomes_its_nearest_length_and_comes_back(x in any::<i32>()) {
            let code = PoseCode { x, y: x.wrapping_neg(), rotation: 0 };
            let back = code.to_pose();
            let exact = i128::from(x) << 32;
            let error = i128::from(back.x.0.to_bits()) * 1000 - exact;
            prop_assert!(error.abs() <= 500);
            prop_assert_eq!(PoseCode::from_pose(&back), code);
        }

        #[test]
        fn a_rotation_becomes_its_nearest_code(heading in any::<u32>()) {
            let code = PoseCode::from_pose(&pose(0, heading)).rotation;
            let nearest = (u64::from(heading) * 0x8000 + (1 << 31)) >> 32;
            prop_assert_eq!(u64::from(code), nearest & 0x7FFF);
        }

        #[test]
        fn a_voltage_becomes_its_nearest_code(bits in any::<u32>()) {
            let code = CellCode::from_volts(5, Volts(U16F16::from_bits(bits)));
            let nearest = (u64::from(bits) * 200 + 0x8000) / 0x1_0000;
            prop_assert_eq!(u64::from(code.voltage), nearest.min(0x1FFF));
            prop_assert_eq!(code.cell, 5);
        }

        #[test]
        fn a_distance_becomes_its_nearest_code(bits in any::<i64>(), near in 0_i64..2600 << 32) {
            for bits in [bits, near] {
                let code = DistanceCode::from_distance(Some(Millimetres(I32F32::from_bits(bits))));
                let scaled = i128::from(bits) * 65_535;
                let unit = 2500_i128 << 32;
                let nearest = (scaled + unit / 2).div_euclid(unit);
                let expected = if bits < 0 || nearest > 0xFFFE { 0xFFFF } else { nearest };
                prop_assert_eq!(i128::from(code.0), expected);
            }
        }
    }

    // Requirement: WIRE-position-2
    #[test]
    fn every_rotation_code_comes_back_and_a_whole_turn_is_none() {
        for rotation in 0..0x8000 {
            let code = PoseCode {
                rotation,
                ..PoseCode::default()
            };
            assert_eq!(code.to_pose().heading, Turns(u32::from(rotation) << 17));
            assert_eq!(PoseCode::from_pose(&code.to_pose()), code);
        }
        // 359.99…° is nearer to 360° than to the last code.
        assert_eq!(rotation_code(Turns(u32::MAX)), 0);
        assert_eq!(rotation_code(Turns(0xFFFF_0000)), 0);
        assert_eq!(rotation_code(Turns(0xFFFE_FFFF)), 0x7FFF);
    }

    #[test]
    fn every_voltage_code_comes_back_and_stands_for_5_millivolts() {
        for voltage in 0..=CellCode::MAX_VOLTAGE {
            let code = CellCode { cell: 3, voltage };
            let volts = code.to_volts();
            assert_eq!(CellCode::from_volts(3, volts), code);
            let error = i64::from(volts.0.to_bits()) * 200 - (i64::from(voltage) << 16);
            assert!(error.abs() <= 100);
        }
        let code = |volts| CellCode::from_volts(0, Volts(U16F16::from_num(volts))).voltage;
        assert_eq!(
            (code(0.0), code(4.2), code(40.955), code(41.0)),
            (0, 840, 0x1FFF, 0x1FFF)
        );
    }

    #[test]
    fn every_distance_code_comes_back_and_only_none_is_none() {
        let mut last = Millimetres(I32F32::NEG_ONE);
        for code in 0..=0xFFFE {
            let distance = DistanceCode(code).to_distance().unwrap();
            assert_eq!(DistanceCode::from_distance(Some(distance)).0, code);
            let error =
                i128::from(distance.0.to_bits()) * 65_535 - ((i128::from(code) * 2500) << 32);
            assert!(error.abs() <= 32_768);
            assert!(distance > last);
            last = distance;
        }
        assert_eq!(DistanceCode::NONE.to_distance(), None);
        assert_eq!(DistanceCode::from_distance(None), DistanceCode::NONE);
        let code = |mm| DistanceCode::from_distance(Some(Millimetres(I32F32::from_num(mm))));
        assert_eq!(code(1000.0), DistanceCode(26_214));
        assert_eq!(code(2499.98), DistanceCode(0xFFFE));
        assert_eq!(code(2499.99), DistanceCode::NONE);
        assert_eq!(code(2500.0), DistanceCode::NONE);
        assert_eq!(code(-0.001), DistanceCode::NONE);
    }

    #[test]
    fn every_bearing_code_comes_back() {
        for code in 0..=0xFFFF {
            assert_eq!(bearing_code(bearing(code)), code);
        }
        assert_eq!(bearing_code(Turns(u32::MAX)), 0);
        assert_eq!(bearing_code(Turns(0x8000)), 1);
        assert_eq!(bearing_code(Turns(0x7FFF)), 0);
    }
}

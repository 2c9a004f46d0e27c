//! Codes of the wire ↔ physical units: to the nearest code, saturating; back to the nearest value.

#![allow(
    clippy::cast_possible_truncation,
    clippy::cast_possible_wrap,
    clippy::cast_sign_loss,
    reason = "codes are cut to their width on purpose"
)]

use super::{CellCode, DistanceCode, GyroCode, PoseCode};
use crate::types::{Millimetres, Pose, Turns, Volts};
use fixed::types::{I32F32, U16F16};

impl PoseCode {
    /// The nearest codes; lengths beyond ±2 147 483.648 mm saturate, a rotation that rounds to a
    /// whole turn is 0.
    #[inline]
    pub fn from_pose(pose: &Pose) -> Self {
        Self {
            x: length_code(pose.x),
            y: length_code(pose.y),
            rotation: rotation_code(pose.heading),
        }
    }

    /// The pose, to the nearest 2⁻³² mm; the rotation exactly.
    // One copy in flash.
    #[inline(never)]
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
#[inline(never)]
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
#[inline(never)]
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
// Requirement: DOC-5.1.1-3, WIRE-code-1, WIRE-position-2
fn rotation_code(heading: Turns) -> u16 {
    // Wrapping past a whole turn is what makes 0x8000 become 0. 15 bits are left.
    (heading.0.wrapping_add(1 << 16) >> 17) as u16
}

impl CellCode {
    /// The largest voltage code: 40.955 V and above.
    pub const MAX_VOLTAGE: u16 = 0x1FFF;

    /// The nearest code of a cell's voltage (a tie goes up), saturating at 40.955 V. `cell` is
    /// taken modulo 8.
    // Requirement: DOC-5.1.3-2, WIRE-code-1
    pub fn from_volts(cell: u8, voltage: Volts) -> Self {
        let scaled = u64::from(voltage.0.to_bits()).wrapping_mul(200);
        let code = scaled.wrapping_add(1 << 15) >> 16;
        Self {
            cell: cell & 7,
            voltage: code.min(Self::MAX_VOLTAGE.into()) as u16,
        }
    }

    /// The voltage, to the nearest 2⁻¹⁶ V.
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
    // Requirement: DOC-5.1.4-1, DOC-5.1.4-2, WIRE-code-1
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

impl GyroCode {
    /// The nearest code of an angle of 2⁻³² turns (a tie goes up), wrapping; what would be
    /// [`Self::NONE`] is the next one.
    // Requirement: WIRE-code-1, WIRE-gyro-1
    pub const fn from_angle(angle: i64) -> Self {
        match (angle.wrapping_add(1 << 7) >> 8) as i32 {
            i32::MIN => Self(i32::MIN + 1),
            code => Self(code),
        }
    }

    /// The angle, 2⁻²⁴ turns; nothing for [`Self::NONE`].
    #[must_use]
    pub const fn angle(self) -> Option<i32> {
        match self {
            Self::NONE => None,
            Self(code) => Some(code),
        }
    }
}

/// A bearing's nearest code: turn × 0x10000 (a tie goes up), wrapping.
// Requirement: WIRE-bearing-1, WIRE-code-1
pub fn bearing_code(bearing: Turns) -> u16 {
    (bearing.0.wrapping_add(1 << 15) >> 16) as u16
}

/// The bearing of a code, exactly.
pub fn bearing(code: u16) -> Turns {
    Turns(u32::from(code) << 16)
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn voltage_of_a_code_is_the_nearest() {
        for voltage in 0..=CellCode::MAX_VOLTAGE {
            let bits = CellCode { cell: 0, voltage }.to_volts().0.to_bits();
            let off = (bits * 200).abs_diff(u32::from(voltage) << 16);
            assert!(off <= 100, "{voltage}: {bits}");
        }
    }
}

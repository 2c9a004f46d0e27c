//! T2: codes of the wire to units and back: the nearest code, saturating, monotone.

use fixed::types::{I32F32, U16F16};
use fw_core::wire::code::{bearing, bearing_code};
use fw_core::wire::{CellCode, DistanceCode, GyroCode, PoseCode};

use crate::property::Seen;
use fw_core::types::{Millimetres, Pose, Turns, Volts};

fn pose_of(x: i64, y: i64, heading: u32) -> Pose {
    Pose {
        x: Millimetres(I32F32::from_bits(x)),
        y: Millimetres(I32F32::from_bits(y)),
        heading: Turns(heading),
    }
}

/// A length's code is back to itself after the way to millimetres. x takes the code and y its
/// complement, so that half of the codes try all of them.
pub fn length_code_round_trips(code: i32) -> Seen {
    let (x, y, rotation) = (code, !code, 0);
    let there = PoseCode { x, y, rotation };
    assert!(PoseCode::from_pose(&there.to_pose()) == there);
    seen!(code == 1_000_000, code == i32::MAX)
}

/// A length's code is the nearest micrometre, of two the upper, or the end of the range where that lies
/// beyond. That it is monotone follows.
// Requirement: DOC-5.1.1-2, WIRE-code-1
pub fn length_code_is_nearest(bits: i64) -> Seen {
    let code = PoseCode::from_pose(&pose_of(bits, 0, 0)).x;
    // In 2⁻³² µm: the length is bits · 1000 of them, the code 2³² · code.
    let (whole, part) = (bits >> 32, bits & 0xFFFF_FFFF);
    let length = (i128::from(whole * 1000) << 32) + i128::from(part * 1000);
    let missing = length - (i128::from(code) << 32);
    let half = 1 << 31;
    match code {
        i32::MAX => assert!(missing >= -half),
        i32::MIN => assert!(missing < half),
        _ => assert!(-half <= missing && missing < half),
    }
    Seen::NOTHING
        .case(0, code == i32::MAX && missing > half)
        .case(1, code == i32::MIN && missing < -half)
        .case(2, missing == -half)
}

/// A length's code never falls from one length to the next, so it never falls when the length grows.
// Requirement: WIRE-position-1
pub fn length_code_is_monotone(bits: i64) -> Seen {
    let code = |bits| PoseCode::from_pose(&pose_of(bits, 0, 0)).x;
    let (low, high) = (code(bits), code(bits.saturating_add(1)));
    assert!(low <= high);
    seen!(low == high, low < high)
}

/// A heading's code is the nearest of 32 768, and a code is back to itself.
// Requirement: DOC-5.1.1-3, WIRE-code-1, WIRE-position-2
pub fn rotation_code_is_nearest(heading: u32) -> Seen {
    let there = PoseCode::from_pose(&pose_of(0, 0, heading));
    let code = there.rotation;
    assert!(code <= 0x7FFF);
    let back = there.to_pose().heading;
    assert!(Turns(heading).from_nearest(back).unsigned_abs() <= 1 << 16);
    assert!(PoseCode::from_pose(&pose_of(0, 0, back.0)).rotation == code);
    seen!(code == 0 && heading > 1 << 31, back.0 == heading)
}

/// A bearing's code is the nearest of 65 536, and a code is back to itself.
// Requirement: WIRE-bearing-1, WIRE-code-1
pub fn bearing_code_is_nearest(heading: u32) -> Seen {
    let code = bearing_code(Turns(heading));
    let back = bearing(code);
    assert!(Turns(heading).from_nearest(back).unsigned_abs() <= 1 << 15);
    assert!(bearing_code(back) == code);
    seen!(code == 0 && heading > 1 << 31, back.0 == heading)
}

/// A gyroscope's angle has the nearest of the codes that wrap at ±128 turns, and never the code of none but
/// for the one next to it.
// Requirement: WIRE-code-1, WIRE-gyro-1
pub fn gyro_code_is_nearest(angle: i64) -> Seen {
    let code = GyroCode::from_angle(angle).angle();
    assert!(code.is_some());
    // In 2⁻³² turns, modulo 256 turns.
    let back = i64::from(code.unwrap_or_default()) << 8;
    let missing = (angle.wrapping_sub(back) << 24) >> 24;
    let beside_none = code == Some(i32::MIN + 1);
    assert!((-128..128).contains(&missing) || beside_none && (-384..-128).contains(&missing));
    Seen::NOTHING
        .case(0, missing == -128)
        .case(1, beside_none && missing < -128)
        .case(2, angle >> 40 != 0 && angle >> 40 != -1)
}

/// A voltage's code is back to itself after the way to volts.
pub fn voltage_code_round_trips(cell: u8, voltage: u16) -> Seen {
    given!(cell <= 7 && voltage <= CellCode::MAX_VOLTAGE);
    let there = CellCode { cell, voltage };
    assert!(CellCode::from_volts(cell, there.to_volts()) == there);
    seen!(voltage == 0, voltage == CellCode::MAX_VOLTAGE)
}

/// A voltage's code is the nearest 5 mV, or 40.955 V above that; the cell is the cell.
// Requirement: DOC-5.1.3-2, WIRE-code-1
pub fn voltage_code_is_nearest(cell: u8, bits: u32) -> Seen {
    let code = CellCode::from_volts(cell, Volts(U16F16::from_bits(bits)));
    assert!(code.cell == cell & 7 && code.voltage <= CellCode::MAX_VOLTAGE);
    // In 2⁻¹⁶ of 5 mV.
    let missing = i64::from(bits) * 200 - (i64::from(code.voltage) << 16);
    assert!(missing >= -(1 << 15));
    let saturated = code.voltage == CellCode::MAX_VOLTAGE;
    assert!(saturated || missing <= 1 << 15);
    Seen::NOTHING
        .case(0, saturated && missing > 1 << 15)
        .case(1, missing < 0)
        .case(2, code.voltage == 0)
}

/// A voltage's code never falls when the voltage grows.
// Requirement: DOC-5.1.3-2
pub fn voltage_code_is_monotone(one: u32, other: u32) -> Seen {
    given!(one <= other);
    let low = CellCode::from_volts(0, Volts(U16F16::from_bits(one)));
    let high = CellCode::from_volts(0, Volts(U16F16::from_bits(other)));
    assert!(low.voltage <= high.voltage);
    seen!(low == high, low.voltage < high.voltage)
}

/// The lowest distance, in 2⁻³² mm, whose nearest code is `code` or above: (code − ½)·2500/65535 mm,
/// rounded up; a tie goes up.
fn threshold(code: u16) -> i64 {
    let numerator = ((2 * i128::from(code) - 1) * 2500) << 32;
    let bits = numerator.div_euclid(2 * 65_535) + i128::from(numerator.rem_euclid(2 * 65_535) > 0);
    i64::try_from(bits.max(0)).unwrap_or(i64::MAX)
}

fn distance_code(bits: i64) -> DistanceCode {
    DistanceCode::from_distance(Some(Millimetres(I32F32::from_bits(bits))))
}

/// A distance's code is back to itself after the way to millimetres, and the distances that have it
/// begin and end exactly half way to its neighbours.
// Requirement: DOC-5.1.4-1, WIRE-code-1
pub fn distance_code_is_nearest(code: u16) -> Seen {
    let first = threshold(code);
    // 0xFFFF begins half way from 0xFFFE, and is "nothing valid" from there on.
    assert!(distance_code(first).0 == code);
    if code > 0 {
        assert!(distance_code(first - 1).0 == code - 1);
    }
    match DistanceCode(code).to_distance() {
        Some(Millimetres(distance)) => assert!(distance_code(distance.to_bits()).0 == code),
        None => assert!(code == 0xFFFF),
    }
    seen!(code == 0, code == 0xFFFF, code == 0xFFFE)
}

/// A distance's code is 0xFFFF for every distance that is not at least 0 and well below 2500 mm, and
/// for none; it never falls when the distance grows inside.
pub fn distance_code_is_total(one: i64, other: i64) -> Seen {
    assert!(DistanceCode::from_distance(None) == DistanceCode::NONE);
    let (low, high) = (distance_code(one), distance_code(other));
    let end = 2500 << 32;
    if one < 0 || one >= end {
        assert!(low == DistanceCode::NONE);
    }
    if 0 <= one && one <= other {
        assert!(low.0 <= high.0);
    }
    seen!(one < 0, one >= end, 0 <= one && one < other && other < end)
}

/// Kani's share of [`distance_code_is_total`]: no input panics or overflows, and what is out of range
/// is nothing.
// Requirement: DOC-5.1.4-2
pub fn distance_out_of_range_is_nothing(bits: i64) -> Seen {
    let end = 2500 << 32;
    let inside = 0 <= bits && bits < end;
    let code = distance_code(bits);
    assert!(inside || code == DistanceCode::NONE);
    seen!(bits < 0, bits >= end, inside && code != DistanceCode::NONE)
}

crate::properties! {
    theorem T2 length_code_round_trips(code: i32) {
        cases ["1 m", "the end of the range"];
        exhaustive (0..=i32::MAX).map(|code| (code,));
    }
    theorem T2 length_code_is_nearest(bits: i64) {
        cases ["beyond the top", "beyond the bottom", "a tie"];
        kani proof [unwind(4)];
        sampled 1_000_000;
    }
    theorem T2 length_code_is_monotone(bits: i64) {
        cases ["equal codes", "a higher code"];
        needs [length_code_is_nearest];
        kani proof [unwind(4)];
        // Around the first length of a code.
        stepped (-150_000..150_000_i64).flat_map(|code| {
            let first = (((2 * code - 1) << 31) + 999).div_euclid(1000);
            [(first - 1,), (first,)]
        });
        sampled 300_000;
    }
    theorem T2 rotation_code_is_nearest(heading: u32) {
        cases ["just below a turn is 0", "exact"];
        kani proof [unwind(4)];
        stepped (0..=u32::MAX).step_by(1 << 10).flat_map(|heading| {
            [heading, heading.wrapping_sub(1), heading.wrapping_add(1)].map(|heading| (heading,))
        });
    }
    theorem T2 bearing_code_is_nearest(heading: u32) {
        cases ["just below a turn is 0", "exact"];
        kani proof [unwind(4)];
        stepped (0..=u32::MAX).step_by(1 << 10).flat_map(|heading| {
            [heading, heading.wrapping_sub(1), heading.wrapping_add(1)].map(|heading| (heading,))
        });
    }
    theorem T2 gyro_code_is_nearest(angle: i64) {
        cases ["a tie", "the code of none", "wrapped"];
        kani proof [unwind(4)];
        sampled 300_000;
    }
    theorem T2 voltage_code_round_trips(cell: u8, voltage: u16) {
        cases ["no voltage", "the highest voltage"];
        kani proof [unwind(4)];
        exhaustive (0..=8).flat_map(|cell| (0..=0x2000).map(move |voltage| (cell, voltage)));
    }
    theorem T2 voltage_code_is_nearest(cell: u8, bits: u32) {
        cases ["beyond the top", "rounded up", "nothing"];
        kani proof [unwind(4)];
        stepped (0..=u32::MAX).step_by(61).map(|bits| (3, bits));
        sampled 300_000;
    }
    theorem T2 voltage_code_is_monotone(one: u32, other: u32) {
        cases ["equal codes", "a higher code"];
        kani proof [unwind(4)];
        sampled 300_000;
    }
    theorem T2 distance_code_is_nearest(code: u16) {
        cases ["0 mm", "nothing valid", "the farthest"];
        needs [distance_code_is_total];
        exhaustive (0..=u16::MAX).map(|code| (code,));
    }
    property T2 distance_code_is_total(one: i64, other: i64) {
        cases ["negative", "too far", "two distances in range"];
        sampled 1_000_000;
    }
    theorem T2 distance_out_of_range_is_nothing(bits: i64) {
        cases ["negative", "too far", "in range"];
        kani proof [unwind(4)];
        sampled 300_000;
    }
}

//! Physical values ↔ codes, and the checksums.

use std::fmt::Debug;

use crate::json::{Value, bytes, file, int, list, text};
use fixed::types::{I32F32, U0F32, U16F16};
use fw_core::eeprom::crc32;
use fw_core::types::{Millimetres, Pose, Turns, Volts};
use fw_core::wire::{CellCode, DistanceCode, GyroCode, PoseCode, code, crc::crc16};

pub fn millimetres(text: &str) -> Millimetres {
    Millimetres(I32F32::from_str(text).expect("millimetres"))
}

pub fn turns(text: &str) -> Turns {
    Turns(U0F32::from_str(text).expect("turns").to_bits())
}

pub fn volts(text: &str) -> Volts {
    Volts(U16F16::from_str(text).expect("volts"))
}

pub fn distance(value: &Value) -> Option<Millimetres> {
    value["mm"].as_str().map(millimetres)
}

/// 2⁻³² turns.
pub fn angle(value: &Value) -> Option<i64> {
    let turns = |text| I32F32::from_str(text).expect("turns").to_bits();
    value["turn"].as_str().map(turns)
}

pub fn gyro_code(angle: Option<i64>) -> GyroCode {
    angle.map_or(GyroCode::NONE, GyroCode::from_angle)
}

/// Every vector of a kind: its value as a code, its code as a value.
fn each<C: PartialEq + Debug, V: PartialEq + Debug>(
    kind: &str,
    code: impl Fn(&Value) -> C,
    value: impl Fn(&Value) -> V,
    encode: impl Fn(V) -> C,
    decode: impl Fn(C) -> V,
) {
    let codes = &file("codes")[kind];
    for vector in list(&codes["encode"]) {
        assert_eq!(encode(value(vector)), code(vector), "{vector}");
    }
    for vector in list(&codes["decode"]) {
        assert_eq!(decode(code(vector)), value(vector), "{vector}");
    }
}

fn each_pose(kind: &str, code: fn(&Value) -> PoseCode, pose: fn(&Value) -> Pose) {
    let encode = |pose: Pose| PoseCode::from_pose(&pose);
    each(kind, code, pose, encode, |code| code.to_pose());
}

// Requirement: DOC-5.1.1-2
#[test]
fn length_codes_match_vectors() {
    let code = |vector: &Value| {
        let (x, rotation) = (int(vector, "code"), 0);
        PoseCode { x, y: x, rotation }
    };
    each_pose("lengths", code, |vector| {
        let (x, heading) = (millimetres(text(vector, "mm")), Turns(0));
        Pose { x, y: x, heading }
    });
}

// Requirement: DOC-5.1.1-3
#[test]
fn rotation_codes_match_vectors() {
    let code = |vector: &Value| {
        let (x, rotation) = (0, int(vector, "code"));
        PoseCode { x, y: x, rotation }
    };
    each_pose("rotations", code, |vector| {
        let (x, heading) = (Millimetres::default(), turns(text(vector, "turn")));
        Pose { x, y: x, heading }
    });
}

#[test]
fn voltage_codes_match_vectors() {
    let code = |vector: &Value| {
        let voltage = int(vector, "code");
        CellCode { cell: 3, voltage }
    };
    let value = |vector: &Value| volts(text(vector, "V"));
    let encode = |volts| CellCode::from_volts(3, volts);
    each("voltages", code, value, encode, |code| code.to_volts());
}

// Requirement: DOC-5.1.4-1
#[test]
fn distance_codes_match_vectors() {
    let code = |vector: &Value| DistanceCode(int(vector, "code"));
    let (encode, decode) = (DistanceCode::from_distance, DistanceCode::to_distance);
    each("distances", code, distance, encode, decode);
}

#[test]
fn bearing_codes_match_vectors() {
    let code = |vector: &Value| int(vector, "code");
    let value = |vector: &Value| turns(text(vector, "turn"));
    each("bearings", code, value, code::bearing_code, code::bearing);
}

// Requirement: WIRE-gyro-1
#[test]
fn gyro_codes_match_vectors() {
    let code = |vector: &Value| GyroCode(int(vector, "code"));
    let decode = |code: GyroCode| code.angle().map(|angle| i64::from(angle) << 8);
    each("gyros", code, angle, gyro_code, decode);
}

#[test]
fn checksums_match_vectors() {
    let codes = file("codes");
    for vector in list(&codes["crc16"]) {
        assert_eq!(crc16(&bytes(vector)), int::<u16>(vector, "crc"), "{vector}");
    }
    for vector in list(&codes["crc32"]) {
        let crc: u32 = int(vector, "crc");
        assert_eq!(crc32(0, &bytes(vector)), crc, "{vector}");
    }
}

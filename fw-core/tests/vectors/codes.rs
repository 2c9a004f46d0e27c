//! Physical values ↔ codes, and the checksums.

use crate::json::{bytes, file, int, list, text, Value};
use fixed::types::{I32F32, U0F32, U16F16};
use fw_core::eeprom::crc32;
use fw_core::types::{Millimetres, Pose, Turns, Volts};
use fw_core::wire::{code, crc::crc16, CellCode, DistanceCode, GyroCode, PoseCode};

fn millimetres(text: &str) -> Millimetres {
    Millimetres(I32F32::from_str(text).expect("millimetres"))
}

fn turns(text: &str) -> Turns {
    Turns(U0F32::from_str(text).expect("turns").to_bits())
}

fn volts(text: &str) -> Volts {
    Volts(U16F16::from_str(text).expect("volts"))
}

fn distance(value: &Value) -> Option<Millimetres> {
    value["mm"].as_str().map(millimetres)
}

fn each(kind: &str, mut encode: impl FnMut(&Value), mut decode: impl FnMut(&Value)) {
    let codes = &file("codes")[kind];
    list(&codes["encode"]).iter().for_each(&mut encode);
    list(&codes["decode"]).iter().for_each(&mut decode);
}

// Requirement: DOC-5.1.1-2
#[test]
fn length_codes_match_vectors() {
    let along_x = |mm| {
        PoseCode::from_pose(&Pose {
            x: mm,
            ..Pose::default()
        })
        .x
    };
    let along_y = |mm| {
        PoseCode::from_pose(&Pose {
            y: mm,
            ..Pose::default()
        })
        .y
    };
    each(
        "lengths",
        |vector| {
            let mm = millimetres(text(vector, "mm"));
            assert_eq!(along_x(mm), int::<i32>(vector, "code"), "{vector}");
            assert_eq!(along_y(mm), int::<i32>(vector, "code"), "{vector}");
        },
        |vector| {
            let code = int(vector, "code");
            let pose = PoseCode {
                x: code,
                y: code,
                rotation: 0,
            }
            .to_pose();
            let mm = millimetres(text(vector, "mm"));
            assert_eq!((pose.x, pose.y), (mm, mm), "{vector}");
        },
    );
}

// Requirement: DOC-5.1.1-3
#[test]
fn rotation_codes_match_vectors() {
    each(
        "rotations",
        |vector| {
            let heading = turns(text(vector, "turn"));
            let code = PoseCode::from_pose(&Pose {
                heading,
                ..Pose::default()
            });
            assert_eq!(code.rotation, int::<u16>(vector, "code"), "{vector}");
        },
        |vector| {
            let code = PoseCode {
                rotation: int(vector, "code"),
                ..PoseCode::default()
            };
            assert_eq!(
                code.to_pose().heading,
                turns(text(vector, "turn")),
                "{vector}"
            );
        },
    );
}

#[test]
fn voltage_codes_match_vectors() {
    each(
        "voltages",
        |vector| {
            let code = CellCode::from_volts(3, volts(text(vector, "V")));
            assert_eq!(
                code,
                CellCode {
                    cell: 3,
                    voltage: int(vector, "code")
                },
                "{vector}"
            );
        },
        |vector| {
            let code = CellCode {
                cell: 3,
                voltage: int(vector, "code"),
            };
            assert_eq!(code.to_volts(), volts(text(vector, "V")), "{vector}");
        },
    );
}

// Requirement: DOC-5.1.4-1
#[test]
fn distance_codes_match_vectors() {
    each(
        "distances",
        |vector| {
            let code = DistanceCode::from_distance(distance(vector));
            assert_eq!(code.0, int::<u16>(vector, "code"), "{vector}");
        },
        |vector| {
            let code = DistanceCode(int(vector, "code"));
            assert_eq!(code.to_distance(), distance(vector), "{vector}");
        },
    );
}

#[test]
fn bearing_codes_match_vectors() {
    each(
        "bearings",
        |vector| {
            let code = code::bearing_code(turns(text(vector, "turn")));
            assert_eq!(code, int::<u16>(vector, "code"), "{vector}");
        },
        |vector| {
            let bearing = code::bearing(int(vector, "code"));
            assert_eq!(bearing, turns(text(vector, "turn")), "{vector}");
        },
    );
}

#[test]
fn checksums_match_vectors() {
    let codes = file("codes");
    for vector in list(&codes["crc16"]) {
        assert_eq!(crc16(&bytes(vector)), int::<u16>(vector, "crc"), "{vector}");
    }
    for vector in list(&codes["crc32"]) {
        assert_eq!(crc32(&bytes(vector)), int::<u32>(vector, "crc"), "{vector}");
    }
}

// Requirement: WIRE-gyro-1
#[test]
fn gyro_codes_match_vectors() {
    let angle = |vector: &Value| {
        vector["turn"]
            .as_str()
            .map(|text| I32F32::from_str(text).expect("turns").to_bits())
    };
    each(
        "gyros",
        |vector| {
            let code = angle(vector).map_or(GyroCode::NONE, GyroCode::from_angle);
            assert_eq!(code.0, int::<i32>(vector, "code"), "{vector}");
        },
        |vector| {
            let code = GyroCode(int(vector, "code"));
            assert_eq!(
                code.angle().map(|code| i64::from(code) << 8),
                angle(vector),
                "{vector}"
            );
        },
    );
}

//! Every strategy, both directions: its bytes within a frame of a mode that has it.

use crate::codes::{angle, distance, gyro_code, millimetres, turns, volts};
use crate::json::{
    Value, bytes, command, file, hex, int, is_command, is_written, list, maybe, report, sequence,
    text,
};
use fw_core::types::Pose;
use fw_core::wire::code::bearing_code;
use fw_core::wire::crc::crc16;
use fw_core::wire::strategy::Context;
use fw_core::wire::{
    CellCode, DistanceCode, Field, MAX_FRAME, Mode, PoseCode, chain, parse_command, parse_report,
    write_command, write_report,
};

fn context(vector: &Value) -> Context {
    let values = &vector["values"];
    Context {
        key_from_pi: int(vector, "key_from_pi"),
        key_from_stm: int(vector, "key_from_stm"),
        cells: int(vector, "cells"),
        own: maybe(values, "own").unwrap_or_default(),
        last: maybe(values, "seen"),
    }
}

fn check(field: Field, vector: &Value) {
    let values = &vector["values"];
    let mode = *Mode::ALL.iter().find(|mode| mode.has(field)).expect("used");
    let before = chain(mode).iter().take_while(|&&other| other != field);
    let offset: usize = before.map(|field| field.byte_len()).sum();
    let context = context(vector);
    let mut frame = [0xEE; MAX_FRAME];
    let len = if is_command(vector) {
        write_command(mode, &context, &command(values), &mut frame)
    } else {
        write_report(mode, &context, &report(values), &mut frame)
    };
    let place = offset..offset + field.byte_len();
    if is_written(vector) {
        assert_eq!(frame[place.clone()], bytes(vector), "{vector}");
    }
    frame[place].copy_from_slice(&bytes(vector));
    if mode.has(Field::Crc) {
        let crc = crc16(&frame[..len - 2]).to_be_bytes();
        frame[len - 2..len].copy_from_slice(&crc);
    }
    let first = Context {
        last: None,
        ..context
    };
    if is_command(vector) {
        let mut found = parse_command(mode, &first, &frame[..len], 0).expect("accepted");
        found.sequence = sequence(values);
        assert_eq!(found, command(values), "{vector}");
    } else {
        let mut found = parse_report(mode, &first, &frame[..len], 0).expect("accepted");
        found.sequence = sequence(values);
        assert_eq!(found, report(values), "{vector}");
    }
}

// Requirement: DOC-5.1-1, DOC-5.1.1-1, DOC-5.1.1-5, DOC-5.1.3-1, DOC-5.1.4-3, WIRE-crc-2, WIRE-velocity-1
#[test]
fn strategy_bytes_match_vectors_in_both_directions() {
    let file = file("strategies");
    for vector in list(&file) {
        let name = text(vector, "strategy");
        let field = *Field::ALL
            .iter()
            .find(|field| field.name() == name)
            .unwrap_or_else(|| panic!("no strategy {name}"));
        assert_eq!(bytes(vector).len(), field.byte_len(), "{vector}");
        if field == Field::Crc {
            let before = vector["before"].as_str().map(hex).unwrap_or_default();
            assert_eq!(crc16(&before).to_be_bytes(), bytes(vector)[..], "{vector}");
        } else {
            check(field, vector);
        }
    }
    for field in Field::ALL {
        for command in [true, false] {
            let name = field.name();
            let is_of =
                |vector: &Value| text(vector, "strategy") == name && is_command(vector) == command;
            assert!(list(&file).iter().any(is_of), "{name}, command: {command}");
        }
    }
}

#[test]
fn physical_values_convert_to_their_codes() {
    let file = file("strategies");
    let mut checked = 0;
    for vector in list(&file) {
        let (physical, values) = (&vector["physical"], &vector["values"]);
        if physical.is_null() {
            continue;
        }
        checked += 1;
        let millimetres = |key| millimetres(text(physical, key));
        match text(vector, "strategy") {
            "position" => {
                let pose = Pose {
                    x: millimetres("x_mm"),
                    y: millimetres("y_mm"),
                    heading: turns(text(physical, "turn")),
                };
                let expected = PoseCode {
                    x: int(values, "x"),
                    y: int(values, "y"),
                    rotation: int(values, "rotation"),
                };
                assert_eq!(PoseCode::from_pose(&pose), expected, "{vector}");
            }
            "double" => {
                let number: f64 = text(physical, "number").parse().unwrap();
                let bits = format!("0x{:016X}", number.to_bits());
                assert_eq!(bits, text(values, "double"), "{vector}");
            }
            "battery" => {
                let code = CellCode::from_volts(int(values, "cell"), volts(text(physical, "V")));
                assert_eq!(code.voltage, int::<u16>(values, "voltage"), "{vector}");
            }
            "bearing" => {
                let code = bearing_code(turns(text(physical, "turn")));
                let sent = maybe(values, "bearing").or(maybe(values, "sweep"));
                assert_eq!(Some(code), sent, "{vector}");
            }
            "gyro" => {
                let code = gyro_code(angle(physical));
                assert_eq!(code.0, int::<i32>(values, "gyro"), "{vector}");
            }
            name @ ("distance front" | "distance right" | "distance left") => {
                let code = DistanceCode::from_distance(distance(physical));
                assert_eq!(code.0, int::<u16>(values, name), "{vector}");
            }
            other => panic!("{other} has no physical values"),
        }
    }
    assert!(checked > 60);
}

//! Every strategy alone, both directions, both ways.

use crate::json::{
    bytes, command, file, hex, int, is_command, is_written, list, maybe, report, text, Value,
};
use fixed::types::{I32F32, U0F32, U16F16};
use fw_core::types::{Millimetres, Pose, Turns, Volts};
use fw_core::wire::code::bearing_code;
use fw_core::wire::strategy::{Context, Input, Output};
use fw_core::wire::{
    chain, CellCode, Command, DistanceCode, Mode, PoseCode, Report, Strategy, MAX_FRAME,
};

fn all() -> Vec<&'static Strategy> {
    let mut all: Vec<&Strategy> = Vec::new();
    for strategy in Mode::ALL.iter().flat_map(|&mode| chain(mode)) {
        if all.iter().all(|known| known.name != strategy.name) {
            all.push(strategy);
        }
    }
    all
}

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

/// The strategy's bytes, behind those that stand before it.
fn written(strategy: &Strategy, vector: &Value, before: &[u8]) -> Vec<u8> {
    let mut frame = [0xEE; MAX_FRAME];
    let mut output = Output::new(&mut frame);
    for &byte in before {
        output.put([byte]);
    }
    if is_command(vector) {
        (strategy.write_command)(&mut output, &context(vector), &command(&vector["values"]));
    } else {
        (strategy.write_report)(&mut output, &context(vector), &report(&vector["values"]));
    }
    output.written()[before.len()..].to_vec()
}

fn check_reading(strategy: &Strategy, vector: &Value, frame: &[u8], before: usize) {
    let context = Context {
        last: None,
        ..context(vector)
    };
    let mut input = Input::new(frame, 0);
    for _ in 0..before {
        input.take::<1>().expect("the bytes before");
    }
    if is_command(vector) {
        let mut found = Command::default();
        (strategy.parse_command)(&mut input, &context, &mut found).expect("accepted");
        assert_eq!(found, command(&vector["values"]), "{vector}");
    } else {
        let mut found = Report::default();
        (strategy.parse_report)(&mut input, &context, &mut found).expect("accepted");
        assert_eq!(found, report(&vector["values"]), "{vector}");
    }
    assert_eq!(input.left(), 0, "{vector}");
}

// Requirement: DOC-5.1-1, DOC-5.1.3-1
#[test]
fn each_writes_exactly_its_bytes_and_reads_exactly_its_values() {
    let file = file("strategies");
    for vector in list(&file) {
        let name = text(vector, "strategy");
        let strategy = all().into_iter().find(|strategy| strategy.name == name);
        let strategy = strategy.unwrap_or_else(|| panic!("no strategy {name}"));
        let before = vector["before"].as_str().map(hex).unwrap_or_default();
        let bytes = bytes(vector);
        assert_eq!(bytes.len(), strategy.bytes, "{vector}");
        if is_written(vector) {
            assert_eq!(written(strategy, vector, &before), bytes, "{vector}");
        }
        let frame = [before.as_slice(), bytes.as_slice()].concat();
        check_reading(strategy, vector, &frame, before.len());
    }
}

#[test]
fn every_strategy_of_every_chain_has_vectors_in_both_directions() {
    let file = file("strategies");
    for strategy in all() {
        for command in [true, false] {
            let found = list(&file).iter().filter(|vector| {
                text(vector, "strategy") == strategy.name && is_command(vector) == command
            });
            assert!(found.count() > 0, "{}, command: {command}", strategy.name);
        }
    }
}

#[test]
fn the_physical_values_beside_the_codes_give_these_codes() {
    let file = file("strategies");
    let mut checked = 0;
    for vector in list(&file) {
        let (physical, values) = (&vector["physical"], &vector["values"]);
        if physical.is_null() {
            continue;
        }
        checked += 1;
        let millimetres = |key| Millimetres(I32F32::from_str(text(physical, key)).unwrap());
        let turns = |key| Turns(U0F32::from_str(text(physical, key)).unwrap().to_bits());
        match text(vector, "strategy") {
            "position" => {
                let pose = Pose {
                    x: millimetres("x_mm"),
                    y: millimetres("y_mm"),
                    heading: turns("turn"),
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
                let voltage = Volts(U16F16::from_str(text(physical, "V")).unwrap());
                let code = CellCode::from_volts(int(values, "cell"), voltage);
                assert_eq!(code.voltage, int::<u16>(values, "voltage"), "{vector}");
            }
            "bearing" => {
                let code = bearing_code(turns("turn"));
                assert_eq!(code, int::<u16>(values, "bearing"), "{vector}");
            }
            name @ ("distance front" | "distance right" | "distance left") => {
                let distance = (!physical["mm"].is_null()).then(|| millimetres("mm"));
                let code = DistanceCode::from_distance(distance);
                assert_eq!(code.0, int::<u16>(values, name), "{vector}");
            }
            other => panic!("{other} has no physical values"),
        }
    }
    assert!(checked > 60);
}

//! The vectors' files, and their values as the core's types.

use fw_core::binary64::Binary64;
use fw_core::types::{Faults, Velocity};
use fw_core::wire::{
    Cause, CellCode, Command, DistanceCode, FrameError, GyroCode, Mode, Order, PoseCode, Report,
    Sequence, Setup, State,
};
pub use serde_json::Value;

/// One of the files, by its name without the ending.
pub fn file(name: &str) -> Value {
    let folder = concat!(env!("CARGO_MANIFEST_DIR"), "/../tests/vectors");
    let path = format!("{folder}/{name}.json");
    let text = std::fs::read_to_string(&path).unwrap_or_else(|error| panic!("{path}: {error}"));
    serde_json::from_str(&text).unwrap_or_else(|error| panic!("{path}: {error}"))
}

/// The entries of a list, of which there must be some.
pub fn list(value: &Value) -> &[Value] {
    let list = value.as_array().expect("a list");
    assert!(!list.is_empty());
    list
}

pub fn text<'a>(value: &'a Value, key: &str) -> &'a str {
    value[key]
        .as_str()
        .unwrap_or_else(|| panic!("no text {key} in {value}"))
}

/// An integer that fits its type.
pub fn int<T: TryFrom<i64>>(value: &Value, key: &str) -> T {
    let int = value[key]
        .as_i64()
        .unwrap_or_else(|| panic!("no integer {key} in {value}"));
    T::try_from(int).unwrap_or_else(|_| panic!("{key} does not fit in {value}"))
}

/// An integer that may be missing.
pub fn maybe<T: TryFrom<i64>>(value: &Value, key: &str) -> Option<T> {
    (!value[key].is_null()).then(|| int(value, key))
}

/// An integer, or the default of one that is missing.
fn given<T: TryFrom<i64> + Default>(value: &Value, key: &str) -> T {
    maybe(value, key).unwrap_or_default()
}

fn flag(value: &Value, key: &str) -> bool {
    value[key].as_bool().unwrap_or_default()
}

pub fn hex(text: &str) -> Vec<u8> {
    assert!(text.len() % 2 == 0, "{text}");
    (0..text.len())
        .step_by(2)
        .map(|at| u8::from_str_radix(&text[at..at + 2], 16).expect("hexadecimal"))
        .collect()
}

/// `0x…` as a number.
pub fn number(text: &str) -> u64 {
    let digits = text.strip_prefix("0x").expect("0x");
    u64::from_str_radix(digits, 16).expect("hexadecimal")
}

pub fn bytes(value: &Value) -> Vec<u8> {
    hex(text(value, "bytes"))
}

pub fn mode(value: &Value) -> Mode {
    Mode::from_code(int(value, "mode")).expect("a mode")
}

pub fn setup(value: &Value) -> Setup {
    Setup {
        mode: mode(value),
        key_from_pi: int(value, "key_from_pi"),
        key_from_stm: int(value, "key_from_stm"),
        cells: int(value, "cells"),
    }
}

/// Whether a vector is of what the Pi sends.
pub fn is_command(value: &Value) -> bool {
    match text(value, "direction") {
        "pi_to_stm" => true,
        "stm_to_pi" => false,
        other => panic!("direction {other}"),
    }
}

/// Whether a vector is to be written, or only read.
pub fn is_written(value: &Value) -> bool {
    let only = &value["only"];
    assert!(only.is_null() || only == "read", "{only}");
    only.is_null()
}

/// The keys that the values of commands and reports have, and those of one of them.
const KEYS: &str = "x, y, rotation, double, cell, voltage, own, seen";
const COMMAND_KEYS: &str = "apply, clear_faults, order, forward, yaw_rate, sweep";
const REPORT_KEYS: &str = "distance front, distance right, distance left, bearing, faults, state, \
                           obstacle_limited, clipped, gyro";

fn known(values: &Value, keys: &str) {
    for key in values.as_object().expect("values").keys() {
        let mut known = KEYS.split(", ").chain(keys.split(", "));
        assert!(known.any(|known| known == key), "unknown key {key}");
    }
}

fn pose(values: &Value) -> PoseCode {
    PoseCode {
        x: given(values, "x"),
        y: given(values, "y"),
        rotation: given(values, "rotation"),
    }
}

fn cell(values: &Value) -> CellCode {
    CellCode {
        cell: given(values, "cell"),
        voltage: given(values, "voltage"),
    }
}

fn double(values: &Value) -> Binary64 {
    let bits = values["double"].as_str().map(number);
    Binary64(bits.unwrap_or_default())
}

pub fn sequence(values: &Value) -> Sequence {
    Sequence {
        own: given(values, "own"),
        seen: given(values, "seen"),
    }
}

/// A command of these values; those that are not there have their default.
pub fn command(values: &Value) -> Command {
    known(values, COMMAND_KEYS);
    Command {
        expected: pose(values),
        apply: flag(values, "apply"),
        percent: double(values),
        velocity: Velocity {
            forward: given(values, "forward"),
            yaw_rate: given(values, "yaw_rate"),
        },
        sweep: given(values, "sweep"),
        tune: cell(values),
        sequence: sequence(values),
        clear_faults: Faults::from_bits(given(values, "clear_faults")),
        order: match values["order"].as_str() {
            None | Some("none") => Order::None,
            Some("stop") => Order::Stop,
            Some("resume") => Order::Resume,
            Some(word) => panic!("order {word}"),
        },
    }
}

/// A report of these values; those that are not there have their default.
pub fn report(values: &Value) -> Report {
    known(values, REPORT_KEYS);
    let range = |key| maybe(values, key).map_or(DistanceCode::NONE, DistanceCode);
    Report {
        pose: pose(values),
        measurement: double(values),
        cell: cell(values),
        ranges: ["distance front", "distance right", "distance left"].map(range),
        bearing: given(values, "bearing"),
        gyro: maybe(values, "gyro").map_or(GyroCode::NONE, GyroCode),
        obstacle_limited: flag(values, "obstacle_limited"),
        clipped: flag(values, "clipped"),
        sequence: sequence(values),
        faults: Faults::from_bits(given(values, "faults")),
        state: match &values["state"] {
            Value::Null => State::default(),
            word => (0..=u8::MAX)
                .filter_map(State::from_code)
                .find(|state| word == state.name())
                .unwrap_or_else(|| panic!("state {word}")),
        },
    }
}

/// A rejection as the vectors describe one.
pub fn rejection(value: &Value) -> (&str, usize, Cause) {
    let word = text(value, "cause");
    let cause = Cause::ALL.into_iter().find(|cause| cause.name() == word);
    let cause = cause.unwrap_or_else(|| panic!("cause {word}"));
    (text(value, "strategy"), int(value, "offset"), cause)
}

/// What of an error the vectors describe.
pub fn essence(error: &FrameError) -> (&str, usize, Cause) {
    let cause = error.reason.cause();
    (error.field.name(), error.offset.into(), cause)
}

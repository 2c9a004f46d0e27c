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
    let path = format!(
        "{}/../tests/vectors/{name}.json",
        env!("CARGO_MANIFEST_DIR")
    );
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
    match &value["only"] {
        Value::Null => true,
        only => {
            assert_eq!(only, "read");
            false
        }
    }
}

/// The keys that a command's values have.
const COMMAND_KEYS: &[&str] = &[
    "x",
    "y",
    "rotation",
    "apply",
    "double",
    "cell",
    "voltage",
    "own",
    "seen",
    "clear_faults",
    "order",
    "forward",
    "yaw_rate",
    "sweep",
];

/// The keys that a report's values have.
const REPORT_KEYS: &[&str] = &[
    "x",
    "y",
    "rotation",
    "double",
    "cell",
    "voltage",
    "distance front",
    "distance right",
    "distance left",
    "bearing",
    "own",
    "seen",
    "faults",
    "state",
    "obstacle_limited",
    "clipped",
    "gyro",
];

fn known(values: &Value, keys: &[&str]) {
    for key in values.as_object().expect("values").keys() {
        assert!(keys.contains(&key.as_str()), "unknown key {key}");
    }
}

fn pose(values: &Value) -> PoseCode {
    if values["x"].is_null() {
        return PoseCode::default();
    }
    PoseCode {
        x: int(values, "x"),
        y: int(values, "y"),
        rotation: int(values, "rotation"),
    }
}

fn cell(values: &Value) -> CellCode {
    CellCode {
        cell: maybe(values, "cell").unwrap_or_default(),
        voltage: maybe(values, "voltage").unwrap_or_default(),
    }
}

fn double(values: &Value) -> Binary64 {
    match &values["double"] {
        Value::Null => Binary64::default(),
        value => Binary64(number(value.as_str().expect("bits"))),
    }
}

fn sequence(values: &Value) -> Sequence {
    Sequence {
        own: maybe(values, "own").unwrap_or_default(),
        seen: maybe(values, "seen").unwrap_or_default(),
    }
}

/// A command of these values; those that are not there have their default.
pub fn command(values: &Value) -> Command {
    known(values, COMMAND_KEYS);
    Command {
        expected: pose(values),
        apply: values["apply"].as_bool().unwrap_or_default(),
        percent: double(values),
        velocity: Velocity {
            forward: maybe(values, "forward").unwrap_or_default(),
            yaw_rate: maybe(values, "yaw_rate").unwrap_or_default(),
        },
        sweep: maybe(values, "sweep").unwrap_or_default(),
        tune: cell(values),
        sequence: sequence(values),
        clear_faults: Faults::from_bits(maybe(values, "clear_faults").unwrap_or_default()),
        order: match &values["order"] {
            Value::Null => Order::default(),
            Value::String(word) => match word.as_str() {
                "none" => Order::None,
                "stop" => Order::Stop,
                "resume" => Order::Resume,
                _ => panic!("order {word}"),
            },
            other => panic!("order {other}"),
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
        ranges: [
            range("distance front"),
            range("distance right"),
            range("distance left"),
        ],
        bearing: maybe(values, "bearing").unwrap_or_default(),
        gyro: maybe(values, "gyro").map_or(GyroCode::NONE, GyroCode),
        obstacle_limited: values["obstacle_limited"].as_bool().unwrap_or_default(),
        clipped: values["clipped"].as_bool().unwrap_or_default(),
        sequence: sequence(values),
        faults: Faults::from_bits(maybe(values, "faults").unwrap_or_default()),
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
    (
        text(value, "strategy"),
        int(value, "offset"),
        cause.unwrap_or_else(|| panic!("cause {word}")),
    )
}

/// What of an error the vectors describe.
pub fn essence(error: &FrameError) -> (&str, usize, Cause) {
    (
        error.field.name(),
        error.offset.into(),
        error.reason.cause(),
    )
}

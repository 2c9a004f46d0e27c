//! Modes, strategies, faults, states, orders, causes, examples.

use crate::table::{file, rows, rows_for};
use std::collections::BTreeSet;

use fw_core::robot::leds;
use fw_core::types::Faults;
use fw_core::wire::{Cause, Field, Mode, Order, PiLink, Setup, State, StmLink, chain, frame_len};
use serde_json::Value;

fn vectors(name: &str) -> Vec<Value> {
    serde_json::from_str(&file(&format!("tests/vectors/{name}.json"))).expect("vectors")
}

// Requirement: DOC-5.2-4, DOC-5.2.1-3, DOC-5.2.2-3, DOC-5.2.3-2, WIRE-modes-5, WIRE-modes-6, WIRE-modes-7
#[test]
fn mode_table_matches_document() {
    for (row, &mode) in rows_for(&["mode", "name", "chain", "bytes"], Mode::ALL) {
        assert_eq!(row.number("mode"), u64::from(mode.code()));
        assert_eq!(row.get("name"), mode.name());
        let names: Vec<_> = chain(mode).iter().map(|field| field.name()).collect();
        assert_eq!(row.get("chain"), names.join(", "), "{mode:?}");
        assert_eq!(row.number("bytes"), frame_len(mode) as u64, "{mode:?}");
    }
}

// Requirement: DOC-5-1
#[test]
fn strategy_table_matches_document() {
    let rows = rows(&["strategy", "bytes", "Pi → STM", "STM → Pi"]);
    assert_eq!(rows.len(), Field::ALL.len());
    for row in rows {
        let name = row.get("strategy");
        let field = Field::ALL.iter().find(|field| field.name() == name);
        let field = field.unwrap_or_else(|| panic!("no strategy {name}"));
        assert_eq!(row.number("bytes"), field.byte_len() as u64, "{name}");
    }
}

// Requirement: WIRE-status-1
#[test]
fn fault_table_matches_document() {
    let columns = ["bit", "fault", "meaning", "motors", "raised in"];
    for (row, fault) in rows_for(&columns, Faults::TABLE) {
        assert_eq!(1 << row.number("bit"), u64::from(fault.faults.bits()));
        let name = row.get("fault").to_lowercase().replace('_', "-");
        assert_eq!(name, fault.name);
        assert_eq!(row.get("meaning"), fault.text);
        let motors = if fault.blocking { "off" } else { "" };
        assert_eq!(row.get("motors"), motors, "{name}");
        assert_eq!(row.get("raised in"), fault.raised_in);
        let raised = format!("Faults::{}", row.get("fault"));
        assert!(file(fault.raised_in).contains(&raised), "{raised}");
    }
}

// Requirement: WIRE-status-2, WIRE-status-6
#[test]
fn state_table_matches_document() {
    let states = (0..=u8::MAX).filter_map(State::from_code);
    for (row, state) in rows_for(&["code", "state", "meaning", "LED 1 2 3 4"], states) {
        assert_eq!(row.number("code"), state as u64);
        assert_eq!(row.get("state"), state.name());
        let lit = (0..4).map(|led| ["○", "●"][usize::from(leds(state) >> led & 1)]);
        assert_eq!(row.get("LED 1 2 3 4"), lit.collect::<Vec<_>>().join(" "));
    }
}

// Requirement: WIRE-status-2
#[test]
fn order_table_matches_document() {
    let orders = (0..=u8::MAX).filter_map(Order::from_code);
    for (row, order) in rows_for(&["code", "order", "meaning"], orders) {
        assert_eq!(row.number("code"), order as u64);
        assert_eq!(row.get("order"), format!("{order:?}").to_lowercase());
    }
}

/// Every strategy that the table gives a cause rejects some vector for it, and no vector is rejected
/// by a pair that the table does not have. That the code rejects them so is the vectors' own test.
// Requirement: WIRE-rejected-2
#[test]
fn cause_table_matches_document() {
    let rows = rows(&["cause", "strategies", "when"]);
    let names: Vec<_> = rows.iter().map(|row| row.get("cause")).collect();
    assert_eq!(names, Cause::ALL.map(Cause::name));
    let listed = rows.iter().flat_map(|row| {
        let names = row.get("strategies").split(", ");
        names.map(|name| (row.get("cause").to_owned(), name.to_owned()))
    });
    let vectors = vectors("rejected");
    let seen = vectors.iter().map(|vector| {
        let word = |key| vector["rejected"][key].as_str().expect("a word").to_owned();
        (word("cause"), word("strategy"))
    });
    assert_eq!(listed.collect::<BTreeSet<_>>(), seen.collect());
}

#[test]
fn example_frames_are_accepted() {
    for row in rows(&["mode", "from", "says", "frame"]) {
        let byte = |byte| u8::from_str_radix(byte, 16).expect("a byte");
        let frame: Vec<u8> = row.get("frame").split(' ').map(byte).collect();
        let mode = u8::try_from(row.number("mode")).unwrap();
        let setup = Setup::first_board(Mode::from_code(mode).expect("a mode"));
        match row.get("from") {
            "Pi" => drop(StmLink::new(setup).receive(&frame, 0, 1).expect("accepted")),
            "STM" => drop(PiLink::new(setup).receive(&frame).expect("accepted")),
            other => panic!("{other}"),
        }
        // What it says is checked where the vectors are.
        let text = row.get("frame").to_lowercase().replace(' ', "");
        let known = |vector: &Value| vector["bytes"] == *text && vector["mode"] == mode;
        assert!(vectors("frames").iter().any(known), "{text} is no vector");
    }
}

//! Modes, strategies, faults, states, orders, causes, examples.

use crate::table::rows;
use fw_core::robot::leds;
use fw_core::types::Faults;
use fw_core::wire::{chain, frame_len, Cause, Field, Mode, Order, PiLink, Setup, State, StmLink};
use serde_json::Value;

fn vectors(name: &str) -> Vec<Value> {
    let path = format!(
        "{}/../tests/vectors/{name}.json",
        env!("CARGO_MANIFEST_DIR")
    );
    let text = std::fs::read_to_string(&path).unwrap_or_else(|error| panic!("{path}: {error}"));
    serde_json::from_str(&text).unwrap_or_else(|error| panic!("{path}: {error}"))
}

// Requirement: DOC-5.2-4, DOC-5.2.1-3, DOC-5.2.2-3, DOC-5.2.3-2, WIRE-modes-5, WIRE-modes-6, WIRE-modes-7
#[test]
fn mode_table_matches_document() {
    let rows = rows(&["mode", "name", "chain", "bytes"]);
    assert_eq!(rows.len(), Mode::ALL.len());
    for (row, &mode) in rows.iter().zip(Mode::ALL) {
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
    let rows = rows(&["bit", "fault", "meaning", "motors", "raised in"]);
    assert_eq!(rows.len(), Faults::TABLE.len());
    for (row, fault) in rows.iter().zip(Faults::TABLE) {
        assert_eq!(1 << row.number("bit"), u64::from(fault.faults.bits()));
        let name = row.get("fault").to_lowercase().replace('_', "-");
        assert_eq!(name, fault.name);
        assert_eq!(row.get("meaning"), fault.text);
        let motors = if fault.blocking { "off" } else { "" };
        assert_eq!(row.get("motors"), motors, "{name}");
        assert_eq!(row.get("raised in"), fault.raised_in);
        let path = format!("{}/../{}", env!("CARGO_MANIFEST_DIR"), fault.raised_in);
        let source =
            std::fs::read_to_string(&path).unwrap_or_else(|error| panic!("{path}: {error}"));
        assert!(
            source.contains(&format!("Faults::{}", row.get("fault"))),
            "{path}"
        );
    }
}

// Requirement: WIRE-status-2, WIRE-status-6
#[test]
fn state_table_matches_document() {
    let rows = rows(&["code", "state", "meaning", "LED 1 2 3 4"]);
    let states: Vec<_> = (0..=u8::MAX).filter_map(State::from_code).collect();
    assert_eq!(rows.len(), states.len());
    for (row, state) in rows.iter().zip(states) {
        assert_eq!(row.number("code"), state as u64);
        assert_eq!(row.get("state"), state.name());
        let lit = (0..4).map(|led| {
            if leds(state) >> led & 1 == 1 {
                "●"
            } else {
                "○"
            }
        });
        assert_eq!(row.get("LED 1 2 3 4"), lit.collect::<Vec<_>>().join(" "));
    }
}

// Requirement: WIRE-status-2
#[test]
fn order_table_matches_document() {
    let rows = rows(&["code", "order", "meaning"]);
    let orders: Vec<_> = (0..=u8::MAX).filter_map(Order::from_code).collect();
    assert_eq!(rows.len(), orders.len());
    for (row, order) in rows.iter().zip(orders) {
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
    let mut listed: Vec<_> = rows
        .iter()
        .flat_map(|row| {
            row.get("strategies")
                .split(", ")
                .map(|name| (row.get("cause"), name))
        })
        .collect();
    let vectors = vectors("rejected");
    let mut seen: Vec<_> = vectors
        .iter()
        .map(|vector| {
            let rejected = &vector["rejected"];
            (
                rejected["cause"].as_str().unwrap(),
                rejected["strategy"].as_str().unwrap(),
            )
        })
        .collect();
    listed.sort_unstable();
    seen.sort_unstable();
    seen.dedup();
    assert_eq!(listed, seen);
}

#[test]
fn example_frames_are_accepted() {
    for row in rows(&["mode", "from", "says", "frame"]) {
        let frame: Vec<u8> = row
            .get("frame")
            .split(' ')
            .map(|byte| u8::from_str_radix(byte, 16).expect("a byte"))
            .collect();
        let setup = Setup {
            mode: Mode::from_code(u8::try_from(row.number("mode")).unwrap()).expect("a mode"),
            key_from_pi: 0x96,
            key_from_stm: 0x5A,
            cells: 2,
        };
        match row.get("from") {
            "Pi" => drop(StmLink::new(setup).receive(&frame, 0, 1).expect("accepted")),
            "STM" => drop(PiLink::new(setup).receive(&frame).expect("accepted")),
            other => panic!("{other}"),
        }
        // What it says is checked where the vectors are.
        let text = row.get("frame").to_lowercase().replace(' ', "");
        let known = |vector: &Value| {
            vector["bytes"] == text.as_str() && vector["mode"] == setup.mode.code()
        };
        assert!(vectors("frames").iter().any(known), "{text} is no vector");
    }
}

//! The register map: addresses, types, names, units, accepted ranges, the first board's values.

use crate::table::{Row, number, rows};
use fw_core::eeprom::{
    Accepted, CONSTRAINTS, CRC_ADDRESS, FIELDS, Field, Image, KEY, Kind, PLATFORM_LEN, SPANS,
};
use fw_core::log::Line;

const COLUMNS: &str = "address|type|field|meaning|unit|accepted|first board";

fn accepted(field: &Field) -> String {
    match *field.accepted {
        Accepted::IntRange { min: 0, max } if u64::from(max) >= field.kind.max() && max > 1 => {
            "any".to_owned()
        }
        accepted => {
            let mut line = Line::new();
            accepted.log(&mut line);
            line.as_str().to_owned()
        }
    }
}

fn kind(kind: Kind) -> String {
    match kind {
        Kind::U8 => "u8".to_owned(),
        Kind::U16 => "u16".to_owned(),
        Kind::U32 => "u32".to_owned(),
        Kind::Binary64 => "double".to_owned(),
        Kind::Bits { shift, width: 1 } => format!("bit {shift}"),
        Kind::Bits { shift, width } => format!("bits {shift}–{}", shift + width - 1),
    }
}

/// A unit as the log writes it.
fn ascii(unit: &str) -> String {
    unit.replace('µ', "u")
        .replace('Ω', "ohm")
        .replace('°', "deg")
}

/// The fields of a row: address and name. `0x0220 … 0x0248 | tap_3.upper … tap_8.upper` are six, 8 bytes apart.
fn expanded(row: &Row) -> Vec<(u64, String, &Row)> {
    let (address, name) = (row.get("address"), row.get("field"));
    let Some((first, last)) = address.split_once(" … ") else {
        return vec![(number(address), name.to_owned(), row)];
    };
    let (name, end) = name.split_once(" … ").expect("names");
    let addresses = (number(first)..=number(last)).step_by(8).zip('3'..);
    let rows: Vec<_> = addresses
        .map(|(address, tap)| (address, name.replace('3', &tap.to_string()), row))
        .collect();
    assert_eq!(rows.last().expect("a row").1, end);
    rows
}

fn value(row: &Row) -> u64 {
    let text = row.get("first board");
    if row.get("type") == "double" {
        text.parse::<f64>().expect("a number").to_bits()
    } else {
        number(text)
    }
}

// Requirement: DOC-6.0.1-2, DOC-6.0.2-1, DOC-6.0.3-1, WIRE-eeprom-8
#[test]
fn fields_are_those_of_the_tables() {
    let rows = rows(&COLUMNS.split('|').collect::<Vec<_>>());
    let (key, rest) = rows.split_first().expect("the key");
    let (crc, rows) = rest.split_last().expect("the checksum");

    let hex = KEY.map(|byte| format!("{byte:02X}")).concat();
    assert_eq!((key.number("address"), key.get("type")), (0, "u8 × 10"));
    assert_eq!([key.get("accepted"), key.get("first board")], [&*hex; 2]);
    assert_eq!(crc.number("address"), u64::from(CRC_ADDRESS));
    assert_eq!((crc.get("type"), crc.get("field")), ("u32", "crc"));
    assert_eq!(usize::from(CRC_ADDRESS) + 4, 0x0300 + PLATFORM_LEN);

    let mut rows: Vec<_> = rows.iter().flat_map(expanded).collect();
    rows.sort_by_key(|row| row.0);
    assert_eq!(rows.len(), FIELDS.len());
    for ((address, name, row), field) in rows.into_iter().zip(&FIELDS) {
        assert_eq!(address, u64::from(field.address), "{row:?}");
        assert_eq!(name, field.name());
        assert_eq!(row.get("type"), kind(field.kind), "{row:?}");
        assert_eq!(ascii(row.get("unit")), field.unit.symbol(), "{row:?}");
        assert_eq!(row.get("accepted"), accepted(field), "{row:?}");
        assert_eq!(value(row), Image::FIRST_BOARD.get(field), "{row:?}");
    }
}

#[test]
fn spans_are_those_of_the_text() {
    let ends = SPANS.map(|span| (span.address, span.address + span.len - 1));
    let [a, b, c, d] = ends.map(|(first, last)| {
        let last = last.min(CRC_ADDRESS - 1);
        format!("0x{first:04X}–0x{last:04X}")
    });
    let text = include_str!("../../../docs/interfaces.md").replace('\n', " ");
    assert!(text.contains(&format!("{a}, {b}, {c} and {d}")));
}

// Requirement: WIRE-refused-1
#[test]
fn constraints_are_those_of_the_table() {
    let rows = rows(&["address", "field", "accepted"]);
    let listed = rows.iter().flat_map(|row| {
        let addresses = row.get("address").split(", ").map(number);
        addresses.map(|address| (address, row.get("field"), row.get("accepted")))
    });
    let constraints = CONSTRAINTS.iter().map(|constraint| {
        let name = match constraint.field.tap {
            0 => constraint.field.name(),
            _ => "upper resistor of a tap in use",
        };
        (constraint.field.address.into(), name, constraint.expected)
    });
    assert!(listed.eq(constraints));
}

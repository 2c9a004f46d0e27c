//! The register map: addresses, types, names, units, accepted ranges, the first board's values.

use crate::table::{number, rows, Row};
use fw_core::binary64::Binary64;
use fw_core::eeprom::rule::RULES;
use fw_core::eeprom::{
    encode, first_board, Accepted, Field, Kind, CRC_ADDRESS, FIELDS, IMAGE_LEN, KEY, PLATFORM_LEN,
};
use fw_core::log::Line;

const COLUMNS: [&str; 7] = [
    "address",
    "type",
    "field",
    "meaning",
    "unit",
    "accepted",
    "first board",
];

fn accepted(field: &Field) -> String {
    let widest = u32::MAX >> (32 - 8 * field.kind.len().min(4));
    match *field.accepted {
        Accepted::Whole { min: 0, max } if max >= widest => "any".to_owned(),
        accepted => {
            let mut line = Line::new();
            accepted.log(&mut line);
            line.as_str().to_owned()
        }
    }
}

fn kind(kind: Kind) -> &'static str {
    match kind {
        Kind::U8 => "u8",
        Kind::U16 => "u16",
        Kind::U32 => "u32",
        Kind::Binary64 => "double",
    }
}

/// A unit as the log writes it.
fn ascii(unit: &str) -> String {
    unit.replace('µ', "u")
        .replace('Ω', "ohm")
        .replace('°', "deg")
}

fn value(row: &Row) -> u64 {
    let text = row.get("first board");
    if row.get("type") == "double" {
        let number: f64 = text.parse().expect("a number");
        Binary64(number.to_bits()).0
    } else {
        number(text)
    }
}

// Requirement: DOC-6.0.1-2, DOC-6.0.2-1, DOC-6.0.3-1
#[test]
fn field_tables_match_document() {
    let rows = rows(&COLUMNS);
    let (key, rest) = rows.split_first().expect("the key");
    let (crc, rows) = rest.split_last().expect("the checksum");

    let hex = KEY.map(|byte| format!("{byte:02X}")).concat();
    assert_eq!((key.number("address"), key.get("type")), (0, "u8 × 10"));
    assert_eq!(
        (key.get("accepted"), key.get("first board")),
        (&*hex, &*hex)
    );
    assert_eq!(crc.number("address"), u64::from(CRC_ADDRESS));
    assert_eq!((crc.get("type"), crc.get("field")), ("u32", "crc"));
    assert_eq!(usize::from(CRC_ADDRESS) + 4, 0x0300 + PLATFORM_LEN);

    assert_eq!(rows.len(), FIELDS.len());
    let config = first_board();
    for (row, field) in rows.iter().zip(FIELDS) {
        assert_eq!(row.number("address"), u64::from(field.address), "{row:?}");
        assert_eq!(row.get("type"), kind(field.kind), "{row:?}");
        assert_eq!(row.get("field"), field.name);
        assert_eq!(ascii(row.get("unit")), field.unit, "{row:?}");
        assert_eq!(row.get("accepted"), accepted(field), "{row:?}");
        assert_eq!(value(row), field.get(&config), "{row:?}");
    }
}

// Requirement: WIRE-eeprom-8
#[test]
fn document_tables_make_first_board_image() {
    let mut by_table = [0xFF_u8; IMAGE_LEN];
    by_table[..KEY.len()].copy_from_slice(&KEY);
    for row in rows(&COLUMNS) {
        let at = usize::try_from(row.number("address")).unwrap();
        let len = match row.get("type") {
            "u8" => 1,
            "u16" => 2,
            "u32" => 4,
            "double" => 8,
            _ => continue,
        };
        if row.get("field") != "crc" {
            by_table[at..at + len].copy_from_slice(&value(&row).to_le_bytes()[..len]);
        }
    }
    let mut by_code = [0xFF_u8; IMAGE_LEN];
    encode(&first_board(), &mut by_code);
    let covered = usize::from(CRC_ADDRESS);
    assert_eq!(by_table[..covered], by_code[..covered]);
}

// Requirement: WIRE-refused-1
#[test]
fn rule_table_matches_document() {
    let listed: Vec<_> = rows(&["address", "field", "accepted"])
        .iter()
        .flat_map(|row| {
            let addresses: Vec<_> = row.get("address").split(", ").map(number).collect();
            for &address in &addresses {
                let field = Field::at(u16::try_from(address).unwrap()).expect("a field");
                let name = match field.tap {
                    0 => field.name,
                    _ => "upper resistor of a tap in use",
                };
                assert_eq!(row.get("field"), name);
            }
            let accepted = row.get("accepted");
            addresses
                .into_iter()
                .map(move |address| (address, accepted))
        })
        .collect();
    let rules: Vec<_> = RULES
        .iter()
        .map(|rule| (u64::from(rule.address), rule.expected))
        .collect();
    assert_eq!(listed, rules);
}

//! `docs/extending.md` names places in files: they must be there.

use crate::table::{file, rows_of};

// Requirement: WIRE-chain-3
#[test]
fn extending_guide_names_existing_code() {
    let document = include_str!("../../../docs/extending.md");
    let rows = rows_of(document, &["file", "at", "what"]);
    assert!(rows.len() > 20);
    for row in rows {
        let (path, place) = (row.get("file"), row.get("at"));
        assert!(file(path).contains(place), "no {place} in {path}");
    }
}

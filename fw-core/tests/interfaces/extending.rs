//! `docs/extending.md` names places in files: they must be there.

use crate::table::rows_of;

// Requirement: WIRE-chain-3
#[test]
fn extending_guide_names_existing_code() {
    let rows = rows_of(
        include_str!("../../../docs/extending.md"),
        &["file", "at", "what"],
    );
    assert!(rows.len() > 20);
    for row in rows {
        let path = format!("{}/../{}", env!("CARGO_MANIFEST_DIR"), row.get("file"));
        let text = std::fs::read_to_string(&path).unwrap_or_else(|error| panic!("{path}: {error}"));
        assert!(
            text.contains(row.get("at")),
            "no {} in {path}",
            row.get("at")
        );
    }
}

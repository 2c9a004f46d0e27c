//! The citations in the source.

use super::Requirements;

/// What begins a citation; the requirements follow, parted by commas.
const MARK: &str = "// Requirement: ";

/// Notes a file's citations.
pub fn read(name: &str, source: &str, requirements: &mut Requirements, wrong: &mut Vec<String>) {
    let mut checks = is_check(name);
    let mut lines = source.lines().zip(1..).peekable();
    while let Some((line, number)) = lines.next() {
        let line = line.trim();
        // A module that stands in a file of its own says nothing of this one's rest.
        let inside = lines.peek().is_some_and(|(next, _)| next.ends_with('{'));
        checks |= line == "#[cfg(test)]" && inside;
        let Some(ids) = line.strip_prefix(MARK) else {
            continue;
        };
        let place = format!("{name}:{number}");
        if lines.peek().is_none_or(|(next, _)| next.trim().is_empty()) {
            wrong.push(format!("{place}: cites above nothing"));
        }
        for id in ids.split(',').map(str::trim) {
            match requirements.get_mut(id) {
                Some(requirement) if checks => requirement.checks.push(place.clone()),
                Some(requirement) => requirement.code.push(place.clone()),
                None => wrong.push(format!("{place}: {id} is no requirement")),
            }
        }
    }
}

/// Whether all of a file checks and meets nothing: tests, properties, models of the hardware.
fn is_check(name: &str) -> bool {
    let first = name.split('/').next().unwrap_or("");
    ["tests", "proofs", "fuzz", "twin"].contains(&first)
        || name.contains("/tests/")
        || name.ends_with("/tests.rs")
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::trace::Requirement;

    fn judged(files: &[(&str, &str)]) -> (Requirements, Vec<String>) {
        let mut requirements: Requirements = ["DOC-1-1", "WIRE-a-1"]
            .into_iter()
            .map(|id| (id.to_owned(), Requirement::default()))
            .collect();
        let mut wrong = Vec::new();
        for (name, source) in files {
            // Written apart, for this file is read by the gate as well.
            let source = source.replace("CITES ", MARK);
            read(name, &source, &mut requirements, &mut wrong);
        }
        (requirements, wrong)
    }

    #[test]
    fn code_and_checks_are_told_apart_by_where_they_stand() {
        let code =
            "    CITES DOC-1-1, WIRE-a-1\nfn f() {}\n#[cfg(test)]\nmod a;\n#[cfg(test)]\nmod b {\nCITES DOC-1-1\nfn t() {}\n";
        let (found, wrong) = judged(&[
            ("a/src/b.rs", code),
            ("proofs/src/c.rs", "CITES WIRE-a-1\nx"),
        ]);
        assert!(wrong.is_empty(), "{wrong:?}");
        assert_eq!(found["DOC-1-1"].code, ["a/src/b.rs:1"]);
        assert_eq!(found["DOC-1-1"].checks, ["a/src/b.rs:7"]);
        assert_eq!(found["WIRE-a-1"].checks, ["proofs/src/c.rs:1"]);
    }

    #[test]
    fn a_citation_of_nothing_or_above_nothing_is_named() {
        let (_, wrong) = judged(&[("a.rs", "CITES DOC-1-2\nfn f() {}\nCITES DOC-1-1\n\n")]);
        assert_eq!(
            wrong,
            [
                "a.rs:1: DOC-1-2 is no requirement",
                "a.rs:3: cites above nothing"
            ]
        );
    }
}

//! The trace of requirements: each stands as a row of `docs/requirements.md`, and is cited by
//! `// Requirement: ID` above the code that meets it and above the test or property that checks it.

use std::collections::BTreeMap;

use crate::error::{failed, Of, Result};
use crate::gates::sources;
use crate::place::Place;

/// The page with a row for each requirement.
const PAGE: &str = "docs/requirements.md";
/// What begins a citation; the requirements follow, parted by commas.
const MARK: &str = "// Requirement: ";

/// A requirement, and where it is cited, as `file:line`.
#[derive(Debug, Default, PartialEq, Eq)]
pub struct Requirement {
    /// What it says.
    pub text: String,
    /// Above code that meets it.
    pub code: Vec<String>,
    /// Above what checks that code.
    pub checks: Vec<String>,
}

/// The requirements by their names.
pub type Requirements = BTreeMap<String, Requirement>;

/// Reads the page and every citation.
///
/// # Errors
/// Names all requirements that nobody meets or checks, and all citations of what is none.
pub fn trace(place: &Place) -> Result<Requirements> {
    let mut requirements = rows(&place.read(PAGE)?)?;
    let mut wrong = Vec::new();
    let mut files = Vec::new();
    sources(&place.root, &place.target, &mut files)?;
    for file in files {
        let name = place.short(&file).to_string();
        let source = std::fs::read_to_string(&file).of(&name)?;
        cited(&name, &source, &mut requirements, &mut wrong);
    }
    for (id, requirement) in &requirements {
        if requirement.code.is_empty() {
            wrong.push(format!("{id}: no code cites it"));
        }
        if requirement.checks.is_empty() {
            wrong.push(format!("{id}: no test or property cites it"));
        }
    }
    for line in &wrong {
        println!("  {line}");
    }
    match wrong.first() {
        None => Ok(requirements),
        Some(first) => failed(format!("{} finding(s), the first: {first}", wrong.len())),
    }
}

/// Prints each requirement with its citations.
pub fn print(requirements: &Requirements) {
    for (id, requirement) in requirements {
        println!("{id}: {}", requirement.text);
        println!("    met in      {}", requirement.code.join(", "));
        println!("    checked in  {}", requirement.checks.join(", "));
    }
}

/// The page's rows: `| ID | what it says |`.
fn rows(page: &str) -> Result<Requirements> {
    let mut requirements = Requirements::new();
    for line in page.lines() {
        let cells: Vec<&str> = line.split('|').map(str::trim).collect();
        let ["", id, text, ""] = cells[..] else {
            continue;
        };
        if !(id.starts_with("DOC-") || id.starts_with("WIRE-")) {
            continue;
        }
        let requirement = Requirement {
            text: text.to_owned(),
            ..Requirement::default()
        };
        if requirements.insert(id.to_owned(), requirement).is_some() {
            return failed(format!("{PAGE}: {id} stands there twice"));
        }
    }
    if requirements.is_empty() {
        return failed(format!("{PAGE} has no requirement"));
    }
    Ok(requirements)
}

/// Notes a file's citations.
fn cited(name: &str, source: &str, requirements: &mut Requirements, wrong: &mut Vec<String>) {
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

    const PAGE: &str =
        "# Requirements\n\n| requirement | says |\n|---|---|\n| DOC-1-1 | It knows. |\n\
                        | WIRE-a-1 | It tells. |\n";

    fn judged(files: &[(&str, &str)]) -> (Requirements, Vec<String>) {
        let mut requirements = rows(PAGE).unwrap();
        let mut wrong = Vec::new();
        for (name, source) in files {
            // Written apart, for this file is read by the gate as well.
            let source = source.replace("CITES ", MARK);
            cited(name, &source, &mut requirements, &mut wrong);
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

    #[test]
    fn a_page_without_requirements_or_with_one_twice_is_none() {
        assert!(rows("# Requirements\n").is_err());
        assert!(rows(&PAGE.repeat(2)).is_err());
    }
}

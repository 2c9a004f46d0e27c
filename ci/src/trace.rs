//! The trace of requirements: each is a line of `docs/requirements.md`, has its text in the original
//! document or in a section of `docs/interfaces.md`, and is cited above the code that meets it and above
//! the test or property that checks it.

use std::collections::BTreeMap;

use crate::error::{bail, ensure, Result};
use crate::workspace::Workspace;

const REQUIREMENTS: &str = "docs/requirements.md";
const INTERFACES: &str = "docs/interfaces.md";

/// Every section of the original document that has a text of its own.
const DOCUMENT: &str =
    "1 2.1 2.2 2.3 3.1 3.2 3.3 4 4.1 5 5.1 5.1.1 5.1.2 5.1.3 5.1.4 5.1.5 5.1.6 5.2 \
                        5.2.1 5.2.2 5.2.3 6 6.0.1 6.0.2 6.0.3";

/// A requirement, and where it is cited, as `file:line`.
#[derive(Debug, Default, PartialEq, Eq)]
pub struct Requirement {
    text: String,
    /// The sections of `docs/interfaces.md` that it is taken from.
    sections: Vec<String>,
    /// Above code that meets it.
    pub code: Vec<String>,
    /// Above what checks that code.
    pub checks: Vec<String>,
}

/// The requirements by their names.
pub type Requirements = BTreeMap<String, Requirement>;

/// Reads both pages and every citation. An error counts the requirements without code, check or text,
/// the sections of either document that are not accounted for, and the citations of nothing; all of
/// them are printed.
pub fn trace(workspace: &Workspace) -> Result<Requirements> {
    let mut findings = Vec::new();
    let mut requirements = read_requirements(&workspace.read(REQUIREMENTS)?, &mut findings)?;
    read_interfaces(
        &workspace.read(INTERFACES)?,
        &mut requirements,
        &mut findings,
    );
    for file in workspace.rust_files()? {
        let (name, source) = (
            workspace.relative(&file).to_string(),
            workspace.read(&file)?,
        );
        read_source(&name, &source, &mut requirements, &mut findings);
    }
    for (id, requirement) in &requirements {
        if requirement.code.is_empty() {
            findings.push(format!("{id}: no code cites it"));
        }
        if requirement.checks.is_empty() {
            findings.push(format!("{id}: no test or property cites it"));
        }
    }
    for finding in &findings {
        println!("  {finding}");
    }
    if let Some(first) = findings.first() {
        bail!("{} finding(s), the first: {first}", findings.len());
    }
    Ok(requirements)
}

/// Prints each requirement with its citations.
pub fn print(requirements: &Requirements) {
    for (
        id,
        Requirement {
            text,
            sections,
            code,
            checks,
        },
    ) in requirements
    {
        println!("{id}: {text}");
        let places = [
            ("text in", sections),
            ("met in", code),
            ("checked in", checks),
        ];
        for (what, places) in places.into_iter().filter(|(_, places)| !places.is_empty()) {
            println!("    {what:<11} {}", places.join(", "));
        }
    }
}

/// The requirements of the page: `- ID: sentence`. The middle of a `DOC-…` is a section of the
/// document; a section without requirement has a line `- SECTION: what it says, and why that is none`.
fn read_requirements(page: &str, findings: &mut Vec<String>) -> Result<Requirements> {
    let mut requirements = Requirements::new();
    let mut accounted = Vec::new();
    for line in page.lines().filter_map(|line| line.strip_prefix("- ")) {
        let Some((id, text)) = line.split_once(": ") else {
            continue;
        };
        if id.starts_with(|first: char| first.is_ascii_digit()) {
            accounted.push(id);
        } else if id.starts_with("DOC-") || id.starts_with("WIRE-") {
            let section = id.strip_prefix("DOC-").and_then(|id| id.rsplit_once('-'));
            accounted.extend(section.map(|(section, _)| section));
            let text = text.to_owned();
            let requirement = Requirement {
                text,
                ..Requirement::default()
            };
            let twice = requirements.insert(id.to_owned(), requirement).is_some();
            ensure!(!twice, "{REQUIREMENTS}: {id} for the second time");
        }
    }
    ensure!(
        !requirements.is_empty(),
        "{REQUIREMENTS} has no requirement"
    );
    let document: Vec<&str> = DOCUMENT.split(' ').collect();
    for section in document
        .iter()
        .filter(|section| !accounted.contains(section))
    {
        findings.push(format!(
            "{REQUIREMENTS}: no line of the document's section {section}"
        ));
    }
    accounted.retain(|section| !document.contains(section));
    accounted.dedup();
    for section in accounted {
        findings.push(format!(
            "{REQUIREMENTS}: the document has no section {section}"
        ));
    }
    Ok(requirements)
}

/// Notes the requirements of each section of `docs/interfaces.md`: a paragraph `Requirements: A, B-1 to
/// 3`, or `Background: …` where a section demands nothing. Every `WIRE-…` must be some section's.
fn read_interfaces(page: &str, requirements: &mut Requirements, findings: &mut Vec<String>) {
    let mut number = 0;
    for section in page.split("\n#") {
        let (first, name) = (number + 1, section.lines().next().unwrap_or_default());
        let name = name.trim_start_matches(['#', ' ']);
        let (mut has_text, mut accounted, mut cites) = (false, false, false);
        for line in section.split('\n') {
            number += 1;
            let ids = line.strip_prefix("Requirements: ");
            cites = ids.is_some() || cites && !line.is_empty();
            accounted |= cites || line.starts_with("Background: ");
            has_text |= number > first && !line.is_empty();
            let ids = ids.unwrap_or(line).trim_end_matches([',', '.']).split(',');
            for id in ids.filter(|_| cites).flat_map(|item| expand(item.trim())) {
                match requirements.get_mut(&id) {
                    Some(requirement) => requirement.sections.push(name.to_owned()),
                    None => findings.push(format!("{INTERFACES}:{number}: {id} is no requirement")),
                }
            }
        }
        if has_text && !accounted {
            let missing = "names no requirement and is not marked as background";
            findings.push(format!("{INTERFACES}:{first}: \"{name}\" {missing}"));
        }
    }
    for (id, requirement) in requirements {
        if id.starts_with("WIRE-") && requirement.sections.is_empty() {
            findings.push(format!("{id}: no section of {INTERFACES} is its text"));
        }
    }
}

/// The requirements that an item of a list stands for: `A-1 to 3` is three.
fn expand(item: &str) -> Vec<String> {
    let several = || {
        let (first, last) = item.split_once(" to ")?;
        let (group, from) = first.rsplit_once('-')?;
        let (from, to): (u32, u32) = (from.parse().ok()?, last.parse().ok()?);
        Some((from..=to).map(|n| format!("{group}-{n}")).collect())
    };
    several().unwrap_or_else(|| vec![item.to_owned()])
}

/// What begins a citation; the requirements follow, parted by commas.
const CITATION: &str = "// Requirement: ";

/// Notes a file's citations.
fn read_source(
    name: &str,
    source: &str,
    requirements: &mut Requirements,
    findings: &mut Vec<String>,
) {
    // Tests, properties and models of the hardware check and meet nothing.
    let folder = name.split('/').next().unwrap_or("");
    let mut checks = ["tests", "proofs", "fuzz", "twin"].contains(&folder)
        || name.contains("/tests/")
        || name.ends_with("tests.rs");
    let mut lines = source.lines().zip(1..).peekable();
    while let Some((line, number)) = lines.next() {
        let line = line.trim();
        // A test module in a file of its own does not make this one's rest a test.
        let inline = lines.peek().is_some_and(|(next, _)| next.ends_with('{'));
        checks |= line == "#[cfg(test)]" && inline;
        let Some(ids) = line.strip_prefix(CITATION) else {
            continue;
        };
        let place = format!("{name}:{number}");
        if lines.peek().is_none_or(|(next, _)| next.trim().is_empty()) {
            findings.push(format!("{place}: cites above nothing"));
        }
        for id in ids.split(',').map(str::trim) {
            match requirements.get_mut(id) {
                Some(requirement) if checks => requirement.checks.push(place.clone()),
                Some(requirement) => requirement.code.push(place.clone()),
                None => findings.push(format!("{place}: {id} is no requirement")),
            }
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    fn some() -> Requirements {
        let ids = ["DOC-1-1", "WIRE-a-1", "WIRE-a-2"];
        ids.map(|id| (id.to_owned(), Requirement::default())).into()
    }

    /// A page with a line for each section but these.
    fn without(left_out: &[&str]) -> String {
        let sections = DOCUMENT
            .split(' ')
            .filter(|section| !left_out.contains(section));
        let lines = sections.map(|section| format!("- DOC-{section}-1: It does.\n"));
        lines.collect()
    }

    #[test]
    fn section_of_the_document_without_a_line_is_named() {
        let judged = |page: &str| {
            let mut findings = Vec::new();
            read_requirements(page, &mut findings).map(|_| findings)
        };
        let complete = without(&[]);
        assert_eq!(judged(&complete).unwrap(), [""; 0]);
        let page = without(&["4", "5.1.3"]);
        let missing = ["4", "5.1.3"]
            .map(|section| format!("{REQUIREMENTS}: no line of the document's section {section}"));
        assert_eq!(judged(&page).unwrap(), missing);
        let page = page + "- 4: the chapter's title.\n- 5.1.3: the union, a means.\n";
        assert_eq!(judged(&page).unwrap(), [""; 0]);
        let page = complete.clone() + "- DOC-5.1.7-1: It does.\n- 9: this.\n";
        let unknown = ["5.1.7", "9"]
            .map(|section| format!("{REQUIREMENTS}: the document has no section {section}"));
        assert_eq!(judged(&page).unwrap(), unknown);
        assert!(judged("# Requirements\n").is_err());
        assert!(judged(&complete.repeat(2)).is_err());
    }

    #[test]
    fn requirement_belongs_to_the_sections_that_name_it() {
        let (mut found, mut findings) = (some(), Vec::new());
        let page = "# Title\n\nBackground: words.\n\n## A\n\n### B\n\nIt does.\n\nRequirements: WIRE-a-1, \
                    DOC-1-1,\nWIRE-a-2.\n\nMore, and no list.\n\n## C\n\nRequirements: WIRE-a-1 to 2\n";
        read_interfaces(page, &mut found, &mut findings);
        assert_eq!(findings, [""; 0]);
        assert_eq!(found["DOC-1-1"].sections, ["B"]);
        assert_eq!(found["WIRE-a-1"].sections, ["B", "C"]);
        assert_eq!(found["WIRE-a-2"].sections, ["B", "C"]);
        let page = "# Title\n\nWords.\n\n## A\n\nRequirements: WIRE-a-1, WIRE-a-3 to 3, none\n\n## B\n\n| a |\n";
        read_interfaces(page, &mut some(), &mut findings);
        let expected = [
            format!(
                "{INTERFACES}:1: \"Title\" names no requirement and is not marked as background"
            ),
            format!("{INTERFACES}:7: WIRE-a-3 is no requirement"),
            format!("{INTERFACES}:7: none is no requirement"),
            format!("{INTERFACES}:9: \"B\" names no requirement and is not marked as background"),
            format!("WIRE-a-2: no section of {INTERFACES} is its text"),
        ];
        assert_eq!(findings, expected);
    }

    #[test]
    fn citation_is_code_or_check_by_its_place() {
        let (mut found, mut findings) = (some(), Vec::new());
        // Written apart, for this file is read by the gate as well.
        let mut read = |name: &str, source: &str| {
            let source = source.replace("CITES ", CITATION);
            read_source(name, &source, &mut found, &mut findings);
        };
        let code =
            "    CITES DOC-1-1, WIRE-a-1\nfn f() {}\n#[cfg(test)]\nmod a;\n#[cfg(test)]\nmod b {\n\
                    CITES DOC-1-1\nfn t() {}\n";
        read("a/src/b.rs", code);
        read("proofs/src/c.rs", "CITES WIRE-a-1\nx");
        read("a.rs", "CITES DOC-1-2\nfn f() {}\nCITES WIRE-a-2\n\n");
        let expected = [
            "a.rs:1: DOC-1-2 is no requirement",
            "a.rs:3: cites above nothing",
        ];
        assert_eq!(findings, expected);
        assert_eq!(found["DOC-1-1"].code, ["a/src/b.rs:1"]);
        assert_eq!(found["DOC-1-1"].checks, ["a/src/b.rs:7"]);
        assert_eq!(found["WIRE-a-1"].checks, ["proofs/src/c.rs:1"]);
    }
}

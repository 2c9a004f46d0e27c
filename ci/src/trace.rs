//! The trace of requirements: each is a line of `docs/requirements.md`, has its text in the original
//! document or in a section of `docs/interfaces.md`, and is cited above the code that meets it and above
//! the test or property that checks it.

use std::collections::{BTreeMap, BTreeSet};

use crate::error::Result;
use crate::process::pattern;
use crate::workspace::Workspace;

const REQUIREMENTS: &str = "docs/requirements.md";
const INTERFACES: &str = "docs/interfaces.md";

/// Every section of the original document that has a text of its own.
const DOCUMENT: &str = "1 2.1 2.2 2.3 3.1 3.2 3.3 4 4.1 5 5.1 5.1.1 5.1.2 5.1.3 5.1.4 5.1.5 5.1.6 5.2 \
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

/// The requirements by their names, and what is wrong with them.
#[derive(Default)]
pub struct Trace {
    pub requirements: BTreeMap<String, Requirement>,
    pub findings: Vec<String>,
}

impl Trace {
    /// Reads both pages and every citation.
    pub fn read(workspace: &Workspace) -> Result<Self> {
        let mut trace = Self::default();
        trace.read_requirements(&workspace.sh.read_file(REQUIREMENTS)?);
        trace.read_interfaces(&workspace.sh.read_file(INTERFACES)?);
        for (name, source) in workspace.rust_files()? {
            trace.read_source(&name, &source);
        }
        for (id, Requirement { code, checks, .. }) in &trace.requirements {
            if code.is_empty() {
                trace.findings.push(format!("{id}: no code cites it"));
            }
            if checks.is_empty() {
                trace
                    .findings
                    .push(format!("{id}: no test or property cites it"));
            }
        }
        Ok(trace)
    }

    /// Prints each requirement with its citations.
    pub fn print(&self) {
        for (id, one) in &self.requirements {
            println!("{id}: {}", one.text);
            let places = [&one.sections, &one.code, &one.checks];
            let what = ["text in", "met in", "checked in"].iter();
            for (what, places) in what.zip(places).filter(|(_, places)| !places.is_empty()) {
                println!("    {what:<11} {}", places.join(", "));
            }
        }
    }

    /// The requirements of the page: `- ID: sentence`. The middle of a `DOC-…` is a section of the
    /// document; a section without requirement has a line `- SECTION: what it says, and why that is none`.
    fn read_requirements(&mut self, page: &str) {
        let mut accounted = BTreeSet::new();
        let line = pattern(r"(?m)^- (?:((?:DOC-([\d.]+)|WIRE-\w+)-\d+)|([\d.]+)): (.*)$");
        for line in line.captures_iter(page) {
            accounted.extend(line.get(2).or(line.get(3)).map(|section| section.as_str()));
            if let Some(id) = line.get(1).map(|id| id.as_str()) {
                let (text, rest) = (line[4].to_owned(), Requirement::default());
                let requirement = Requirement { text, ..rest };
                if self
                    .requirements
                    .insert(id.to_owned(), requirement)
                    .is_some()
                {
                    self.findings
                        .push(format!("{REQUIREMENTS}: {id} for the second time"));
                }
            }
        }
        let document: BTreeSet<_> = DOCUMENT.split(' ').collect();
        let missing = document.difference(&accounted);
        let missing =
            missing.map(|section| format!("{REQUIREMENTS}: no line of section {section}"));
        self.findings.extend(missing);
        let unknown = accounted.difference(&document);
        let unknown =
            unknown.map(|section| format!("{REQUIREMENTS}: there is no section {section}"));
        self.findings.extend(unknown);
    }

    /// Notes the requirements of each section of `docs/interfaces.md`: a paragraph `Requirements: A, B-1
    /// to 3`, or `Background: …` where a section demands nothing. Every `WIRE-…` must be some section's.
    fn read_interfaces(&mut self, page: &str) {
        let cited = pattern(r"(?m)^Requirements: ((?:.|\n[^\n])*)");
        let item = pattern(r"([A-Z]+-[\w.]+-)(\d+)(?:\s+to\s+(\d+))?");
        let background = pattern(r"(?m)^Background: ");
        for section in page.split("\n#") {
            let (name, body) = section.split_once('\n').unwrap_or((section, ""));
            let name = name.trim_start_matches(['#', ' ']);
            let accounted = cited.is_match(body) || background.is_match(body);
            if !accounted && !body.trim().is_empty() {
                let missing = "names no requirement and is not marked as background";
                self.findings
                    .push(format!("{INTERFACES}: \"{name}\" {missing}"));
            }
            let items = cited.captures_iter(body).map(|cited| cited[1].to_owned());
            let items = items.collect::<Vec<_>>().join(",");
            for item in item.captures_iter(&items) {
                let first: u32 = item[2].parse().unwrap_or(0);
                let last = item.get(3).and_then(|last| last.as_str().parse().ok());
                for number in first..=last.unwrap_or(first) {
                    let id = format!("{}{number}", &item[1]);
                    match self.requirements.get_mut(&id) {
                        Some(requirement) => requirement.sections.push(name.to_owned()),
                        None => self
                            .findings
                            .push(format!("{INTERFACES}: {id} is no requirement")),
                    }
                }
            }
        }
        for (id, requirement) in &self.requirements {
            if id.starts_with("WIRE-") && requirement.sections.is_empty() {
                self.findings
                    .push(format!("{id}: no section of {INTERFACES} is its text"));
            }
        }
    }

    /// Notes a file's citations.
    fn read_source(&mut self, name: &str, source: &str) {
        // Tests, properties and models of the hardware check and meet nothing, nor do test modules.
        let check = pattern(r"^(tests|proofs|fuzz|twin)/|/tests/|tests\.rs$").is_match(name);
        let tests = pattern(r"(?m)^ *#\[cfg\(test\)\]\n.*\{$").find(source);
        let tests = tests.map_or(source.len(), |tests| tests.start());
        for citation in pattern(CITATION).captures_iter(source) {
            let at = citation.get(1).map_or(0, |ids| ids.start());
            let place = format!("{name}:{}", source[..at].lines().count());
            if source[at..]
                .lines()
                .nth(1)
                .is_none_or(|below| below.trim().is_empty())
            {
                self.findings.push(format!("{place}: cites above nothing"));
            }
            for id in citation[1].split(',').map(str::trim) {
                match self.requirements.get_mut(id) {
                    Some(one) if check || at > tests => one.checks.push(place.clone()),
                    Some(one) => one.code.push(place.clone()),
                    None => self
                        .findings
                        .push(format!("{place}: {id} is no requirement")),
                }
            }
        }
    }
}

/// A citation of requirements, parted by commas.
const CITATION: &str = r"(?m)^ *// Requirement: (.*)$";

#[cfg(test)]
mod tests {
    use super::*;

    fn some() -> Trace {
        let ids = ["DOC-1-1", "WIRE-a-1", "WIRE-a-2"];
        let requirements = ids.map(|id| (id.to_owned(), Requirement::default())).into();
        Trace {
            requirements,
            findings: Vec::new(),
        }
    }

    #[test]
    fn section_of_the_document_without_a_line_is_named() {
        let findings = |left_out: &[&str], more: &str| {
            let sections = DOCUMENT
                .split(' ')
                .filter(|section| !left_out.contains(section));
            let lines = sections.map(|section| format!("- DOC-{section}-1: It does.\n"));
            let mut trace = Trace::default();
            trace.read_requirements(&(lines.collect::<String>() + more));
            trace.findings.join("; ").replace(REQUIREMENTS, "")
        };
        assert_eq!(findings(&[], ""), "");
        assert_eq!(
            findings(&["4", "5.1.3"], ""),
            ": no line of section 4; : no line of section 5.1.3"
        );
        assert_eq!(findings(&["4"], "- 4: the chapter's title.\n"), "");
        assert_eq!(
            findings(&[], "- DOC-5.1.7-1: It does.\n"),
            ": there is no section 5.1.7"
        );
        assert_eq!(
            findings(&[], "- DOC-1-1: It does.\n"),
            ": DOC-1-1 for the second time"
        );
    }

    #[test]
    fn requirement_belongs_to_the_sections_that_name_it() {
        let mut trace = some();
        trace.read_interfaces(
            "# Title\n\nBackground: words.\n\n## A\n\n### B\n\nIt does.\n\nRequirements: WIRE-a-1, \
             DOC-1-1,\nWIRE-a-2.\n\nMore, WIRE-a-3.\n\n## C\n\nRequirements: WIRE-a-1 to 2\n",
        );
        assert_eq!(trace.findings, [""; 0]);
        let sections = trace
            .requirements
            .values()
            .map(|one| one.sections.join(" "));
        assert_eq!(sections.collect::<Vec<_>>(), ["B", "B C", "B C"]);
        let mut trace = some();
        trace.read_interfaces(
            "# Title\n\nWords.\n\n## A\n\nRequirements: WIRE-a-1, WIRE-a-3\n\n## B\n",
        );
        let expected = [
            format!("{INTERFACES}: \"Title\" names no requirement and is not marked as background"),
            format!("{INTERFACES}: WIRE-a-3 is no requirement"),
            format!("WIRE-a-2: no section of {INTERFACES} is its text"),
        ];
        assert_eq!(trace.findings, expected);
    }

    #[test]
    fn citation_is_code_or_check_by_its_place() {
        let mut trace = some();
        // Written apart, for this file is read by the gate as well.
        let mut read = |name: &str, source: &str| {
            trace.read_source(name, &source.replace("CITES", "// Requirement:"));
        };
        let code = "    CITES DOC-1-1\nCITES WIRE-a-1\nfn f() {}\n#[cfg(test)]\nmod a;\n#[cfg(test)]\nmod b {\n\
                    CITES DOC-1-1\nfn t() {}\n";
        read("a/src/b.rs", code);
        read("proofs/src/c.rs", "CITES WIRE-a-1\nx");
        read("a.rs", "CITES DOC-1-2\nfn f() {}\nCITES WIRE-a-2\n\n");
        let expected = [
            "a.rs:1: DOC-1-2 is no requirement",
            "a.rs:3: cites above nothing",
        ];
        assert_eq!(trace.findings, expected);
        let [doc, wire, _] = trace.requirements.values().collect::<Vec<_>>()[..] else {
            panic!("three requirements");
        };
        assert_eq!(
            (doc.code.join(" "), doc.checks.join(" ")),
            ("a/src/b.rs:1".into(), "a/src/b.rs:8".into())
        );
        assert_eq!(wire.checks, ["proofs/src/c.rs:1"]);
    }
}

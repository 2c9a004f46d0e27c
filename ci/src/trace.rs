//! The trace of requirements: each is a row of `docs/requirements.md` or ends a text of `docs/interfaces.md`,
//! and is cited above the code that meets it and above the test or property that checks it.

use std::collections::{BTreeMap, BTreeSet};

use crate::error::Result;
use crate::process::{captures, pattern};
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
        trace.read_interfaces(&workspace.sh.read_file(INTERFACES)?);
        trace.read_requirements(&workspace.sh.read_file(REQUIREMENTS)?);
        for (name, source) in workspace.texts("", "rs")? {
            trace.read_source(&name, &source);
        }
        for (id, Requirement { code, checks, .. }) in &trace.requirements {
            for (places, what) in [(code, "code"), (checks, "test or property")] {
                if places.is_empty() {
                    trace.findings.push(format!("{id}: no {what} cites it"));
                }
            }
        }
        Ok(trace)
    }

    /// Prints each requirement with its citations.
    pub fn print(&self) {
        for (id, one) in &self.requirements {
            println!("{id}: {}", one.text);
            for (what, places) in [("met in", &one.code), ("checked in", &one.checks)] {
                println!("    {what:<11} {}", places.join(", "));
            }
        }
    }

    fn add(&mut self, id: String, text: String) {
        if self.requirements.contains_key(&id) {
            self.findings.push(format!("{id} for the second time"));
        }
        self.requirements.entry(id).or_default().text = text;
    }

    /// The requirements of the page: `- ID: sentence`; and of the document, by the middle of `DOC-…`: each
    /// section has one, or a line `- SECTION: what it says, and why that is none`.
    fn read_requirements(&mut self, page: &str) {
        let rows = pattern(r"(?m)^- ((?:DOC|NAV|SERVE|WIRE)-[\w.]+-\d+): (.*)$");
        for row in rows.captures_iter(page) {
            self.add(row[1].to_owned(), row[2].to_owned());
        }
        let ids = self.requirements.keys();
        let demanding = ids.filter_map(|id| id.strip_prefix("DOC-")?.split('-').next());
        let mut accounted: BTreeSet<_> = demanding.collect();
        accounted.extend(captures(page, r"(?m)^- ([\d.]+): "));
        let document: BTreeSet<_> = DOCUMENT.split(' ').collect();
        for section in document.symmetric_difference(&accounted) {
            let known = document.contains(section);
            let what = if known { "no line of" } else { "there is no" };
            self.findings.push(format!("{what} section {section}"));
        }
    }

    /// The requirements of `docs/interfaces.md`: `[A, B-1 to 3]` ends the text of A, B-1, B-2 and B-3, which
    /// begins where the paragraph does or behind the mark before. A section without any is a finding.
    fn read_interfaces(&mut self, page: &str) {
        let mark = pattern(
            r"(?s)[.,;\s]*(.*?)\[((?:(?:DOC|NAV|WIRE)-[\w.]+-\d+(?:\s+to\s+\d+)?,?\s*)+)\]",
        );
        let item = pattern(r"([A-Z]+-[\w.]+-)(\d+)(?:\s+to\s+(\d+))?");
        for section in page.split("\n#") {
            let (name, body) = section.split_once('\n').unwrap_or((section, ""));
            let name = name.trim_start_matches(['#', ' ']);
            if !mark.is_match(body) && !body.trim().is_empty() {
                self.findings
                    .push(format!("{INTERFACES}: \"{name}\" states no requirement"));
            }
            for paragraph in body.split("\n\n") {
                for found in mark.captures_iter(paragraph) {
                    let (_, [words, items]) = found.extract();
                    let words = words.split_whitespace().collect::<Vec<_>>().join(" ");
                    for item in item.captures_iter(items) {
                        let first: u32 = item[2].parse().unwrap_or(0);
                        let last = item.get(3).and_then(|last| last.as_str().parse().ok());
                        for number in first..=last.unwrap_or(first) {
                            self.add(format!("{}{number}", &item[1]), format!("{name}: {words}"));
                        }
                    }
                }
            }
        }
    }

    /// Notes a file's citations.
    fn read_source(&mut self, name: &str, source: &str) {
        // Tests, properties and models of the hardware check and meet nothing, nor do test modules.
        let check = pattern(r"^(tests|proofs|fuzz|twin)/|/tests/|tests\.rs$").is_match(name);
        let tests = pattern(r"(?m)^ *#\[cfg\(test\)\]\n.*\{$|^(// Requirement: .*\n)?#\[test\]")
            .find(source);
        let tests = tests.map_or(source.len(), |tests| tests.start());
        for citation in pattern(r"(?m)^ *// Requirement: (.*)$").captures_iter(source) {
            let at = citation.get(1).map_or(0, |ids| ids.start());
            let place = format!("{name}:{}", source[..at].lines().count());
            let below = source[at..].lines().nth(1).unwrap_or_default();
            if below.trim().is_empty() {
                self.findings.push(format!("{place}: cites above nothing"));
            }
            for id in citation[1].split(',').map(str::trim) {
                let unknown = format!("{place}: {id} is no requirement");
                match self.requirements.get_mut(id) {
                    Some(one) if check || at > tests => one.checks.push(place.clone()),
                    Some(one) => one.code.push(place.clone()),
                    None => self.findings.push(unknown),
                }
            }
        }
    }
}

#[test]
fn section_of_the_document_without_a_line_is_named() {
    let findings = |left_out: &[&str], more: &str| {
        let sections = DOCUMENT.split(' ');
        let sections = sections.filter(|section| !left_out.contains(section));
        let lines = sections.map(|section| format!("- DOC-{section}-1: It does.\n"));
        let mut trace = Trace::default();
        trace.read_requirements(&(lines.collect::<String>() + more));
        trace.findings.join("; ")
    };
    let missing = "no line of section 4; no line of section 5.1.3";
    assert_eq!(findings(&["4", "5.1.3"], ""), missing);
    for (left_out, more, found) in [
        ("", "", ""),
        ("4", "- 4: the chapter's title.\n", ""),
        ("", "- DOC-5.1.7-1: It does.\n", "there is no section 5.1.7"),
        ("", "- DOC-1-1: It does.\n", "DOC-1-1 for the second time"),
    ] {
        assert_eq!(findings(&[left_out], more), found);
    }
}

#[test]
fn mark_ends_the_text_of_its_requirements() {
    let mut trace = Trace::default();
    trace.read_interfaces(
        "# Title\n\nWords.\n\n## A\n\n### B\n\nIt [does](x.md) [WIRE-a-1,\nDOC-1-1]. Then\nit\nstops \
         [WIRE-b-1\nto 2].\n\nMore [WIRE-a-1].\n",
    );
    let found = trace.findings.join("; ").replace(INTERFACES, "");
    assert_eq!(
        found,
        ": \"Title\" states no requirement; WIRE-a-1 for the second time"
    );
    let found = trace.requirements.iter();
    let found = found.map(|(id, one)| format!("{id} {}", one.text));
    let expected = "DOC-1-1 B: It [does](x.md)|WIRE-a-1 B: More|WIRE-b-1 B: Then it stops|\
                    WIRE-b-2 B: Then it stops";
    assert_eq!(found.collect::<Vec<_>>().join("|"), expected);
}

#[test]
fn citation_is_code_or_check_by_its_place() {
    let mut trace = Trace::default();
    for id in ["DOC-1-1", "WIRE-a-1", "WIRE-a-2"] {
        trace.add(id.into(), String::new());
    }
    // Written apart, for this file is read by the gate as well.
    let mut read = |name: &str, source: &str| {
        trace.read_source(name, &source.replace("CITES", "// Requirement:"));
    };
    let code = "    CITES DOC-1-1\nCITES WIRE-a-1\nfn f() {}\n#[cfg(test)]\nmod a;\n#[cfg(test)]\nmod b {\n\
                CITES DOC-1-1\nfn t() {}\n";
    read("a/src/b.rs", code);
    read("proofs/src/c.rs", "CITES WIRE-a-1\nx");
    let test = "CITES WIRE-a-2\nfn f() {}\nCITES WIRE-a-2\n#[test]\nfn t() {}\n";
    read("c.rs", test);
    read("a.rs", "CITES DOC-1-2\nfn f() {}\nCITES WIRE-a-2\n\n");
    let expected = "a.rs:1: DOC-1-2 is no requirement; a.rs:3: cites above nothing";
    assert_eq!(trace.findings.join("; "), expected);
    let [doc, wire, last] = trace.requirements.values().collect::<Vec<_>>()[..] else {
        panic!("three requirements");
    };
    let of_doc = [doc.code.join(" "), doc.checks.join(" ")];
    assert_eq!(of_doc, ["a/src/b.rs:1", "a/src/b.rs:8"]);
    assert_eq!(wire.checks, ["proofs/src/c.rs:1"]);
    let of_last = [last.code.join(" "), last.checks.join(" ")];
    assert_eq!(of_last, ["c.rs:1 a.rs:3", "c.rs:3"]);
}

//! The seeded defects as they stand in `ci/defects/*.txt`: what is wrong, where, and who must notice.
//!
//! ```text
//! checksum-start                              a name, at the line's beginning
//!   The checksum of a frame starts from 0.    what is wrong, in words
//!   in fw-core/src/wire/crc.rs                the file
//!   - let mut crc = 0xFFFF_u32;               lines that stand in it once, one after the other
//!   + let mut crc = 0_u32;                    what stands there instead
//!   by unit wire::crc                         a gate, and which of its tests
//!   sample                                    tried by every `cargo xtask test`
//! ```
//!
//! Lines are compared without their indentation, so that neither moving nor formatting the code
//! disturbs a defect.

use std::path::Path;

use crate::compat::{failed, Of};
use crate::error::Result;

/// Who is asked whether it notices.
#[derive(Clone, Debug, PartialEq, Eq)]
pub struct Judge {
    /// The gate.
    pub gate: Gate,
    /// Which of its tests, or nothing for all of them.
    pub filter: String,
}

/// The gates that defects are shown to.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Gate {
    /// The tests beside the core's code.
    Unit,
    /// The core against the test vectors.
    Vectors,
    /// The core against the tables of `docs/interfaces.md`.
    Interfaces,
    /// The properties, exhaustive or sampled.
    Properties,
    /// The tests beside the Pi's code.
    Host,
    /// The release ELF's contents.
    Elf,
    /// The release ELF's stack.
    Stack,
    /// The firmware in the loop; the filter begins with the test file.
    Loop,
}

impl Gate {
    /// In the order of the gates' table.
    pub const ALL: [Self; 8] = [
        Self::Unit,
        Self::Vectors,
        Self::Interfaces,
        Self::Properties,
        Self::Host,
        Self::Elf,
        Self::Stack,
        Self::Loop,
    ];

    /// Its name in the lists and tables.
    pub const fn name(self) -> &'static str {
        match self {
            Self::Unit => "unit",
            Self::Vectors => "vectors",
            Self::Interfaces => "interfaces",
            Self::Properties => "properties",
            Self::Host => "host",
            Self::Elf => "elf",
            Self::Stack => "stack",
            Self::Loop => "loop",
        }
    }
}

/// One defect.
#[derive(Clone, Debug, Default, PartialEq, Eq)]
pub struct Defect {
    /// Its name.
    pub name: String,
    /// What is wrong with it, one sentence.
    pub what: String,
    /// The file, from the workspace's root.
    pub file: String,
    /// The lines it takes out.
    pub old: Vec<String>,
    /// The lines it puts there.
    pub new: Vec<String>,
    /// Who must notice: any of them.
    pub judges: Vec<Judge>,
    /// Whether every run of the gates tries it.
    pub sample: bool,
}

impl Defect {
    /// The file's text with the defect in it.
    ///
    /// # Errors
    /// Where the lines it takes out do not stand there exactly once.
    pub fn applied(&self, text: &str) -> Result<String> {
        let lines: Vec<&str> = text.lines().collect();
        let fits = |at: &usize| {
            let here = lines[*at..].iter().map(|line| line.trim());
            here.take(self.old.len())
                .eq(self.old.iter().map(String::as_str))
        };
        let places: Vec<usize> = (0..lines.len()).filter(fits).collect();
        let [at] = places[..] else {
            return failed(format!(
                "defect {}: its lines stand {} times in {}, not once",
                self.name,
                places.len(),
                self.file
            ));
        };
        let before = lines[..at].iter().copied();
        let after = lines[at + self.old.len()..].iter().copied();
        let changed: Vec<&str> = before
            .chain(self.new.iter().map(String::as_str))
            .chain(after)
            .collect();
        Ok(changed.join("\n") + "\n")
    }
}

/// Every defect of the folder, by file and then in the file's order.
///
/// # Errors
/// Names the line that says nothing, or the defect that lacks a part.
pub fn read(folder: &Path) -> Result<Vec<Defect>> {
    let entries = std::fs::read_dir(folder).of(folder.display())?;
    let mut files: Vec<_> = entries.flatten().map(|entry| entry.path()).collect();
    files.retain(|file| file.extension().is_some_and(|ending| ending == "txt"));
    files.sort();
    let mut all: Vec<Defect> = Vec::new();
    for file in files {
        let text = std::fs::read_to_string(&file).of(file.display())?;
        all.extend(parse(&text)?);
    }
    for (at, defect) in all.iter().enumerate() {
        if all[..at].iter().any(|other| other.name == defect.name) {
            return failed(format!("two defects are called {}", defect.name));
        }
    }
    Ok(all)
}

fn parse(text: &str) -> Result<Vec<Defect>> {
    let mut all: Vec<Defect> = Vec::new();
    for line in text.lines() {
        if line.trim().is_empty() || line.starts_with('#') {
            continue;
        }
        if !line.starts_with(' ') {
            all.push(Defect {
                name: line.trim().to_owned(),
                ..Defect::default()
            });
            continue;
        }
        let line = line.trim();
        let Some(defect) = all.last_mut() else {
            return failed(format!("a line before the first defect: {line}"));
        };
        let (word, rest) = line.split_once(' ').unwrap_or((line, ""));
        match word {
            "in" => rest.clone_into(&mut defect.file),
            "-" => defect.old.push(rest.trim().to_owned()),
            "+" => defect.new.push(rest.trim().to_owned()),
            "by" => defect.judges.push(judge(&defect.name, rest)?),
            "sample" => defect.sample = true,
            _ if defect.what.is_empty() => line.clone_into(&mut defect.what),
            _ => return failed(format!("defect {}: what is `{line}`?", defect.name)),
        }
    }
    for defect in &all {
        let whole = !(defect.what.is_empty()
            || defect.file.is_empty()
            || defect.old.is_empty()
            || defect.judges.is_empty()
            || defect.old == defect.new);
        if !whole {
            return failed(format!("defect {} is not whole", defect.name));
        }
    }
    Ok(all)
}

fn judge(name: &str, words: &str) -> Result<Judge> {
    let (gate, filter) = words.split_once(' ').unwrap_or((words, ""));
    let known = Gate::ALL.into_iter().find(|known| known.name() == gate);
    match known {
        Some(gate) => Ok(Judge {
            gate,
            filter: filter.to_owned(),
        }),
        None => failed(format!("defect {name}: no gate {gate}")),
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    const LIST: &str =
        "# wire\nstart\n  It starts from 0.\n  in a.rs\n  - let a = 1;\n  - let b = 2;\n  \
                        + let a = 0;\n  by unit wire::crc\n  by loop link torn\n  sample\n";

    #[test]
    fn a_defect_is_found_wherever_its_lines_have_moved() {
        let defects = parse(LIST).unwrap();
        let [defect] = &defects[..] else { panic!() };
        assert!(defect.sample);
        assert_eq!(defect.judges[1].filter, "link torn");
        let moved = "fn f() {\n        let a = 1;\n        let b = 2;\n}\n";
        assert_eq!(defect.applied(moved).unwrap(), "fn f() {\nlet a = 0;\n}\n");
        assert!(defect.applied("let a = 1;\n").is_err(), "half of it");
        let twice = moved.repeat(2);
        assert!(defect.applied(&twice).is_err(), "nobody knows which");
    }

    #[test]
    fn a_defect_that_lacks_something_is_named() {
        let why = |text: &str| parse(text).unwrap_err().to_string();
        assert!(why("a\n  b\n  in c\n  - d\n  + d\n  by unit\n").contains("not whole"));
        assert!(why("a\n  b\n  in c\n  - d\n  + e\n").contains("not whole"));
        assert!(why("a\n  by nobody\n").contains("no gate nobody"));
        assert!(why("  - b\n").contains("before the first"));
    }
}

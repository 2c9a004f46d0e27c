//! The mutants of `fw-core` as cargo-mutants lists them.

use std::path::Path;

use tinyjson::JsonValue;

use crate::compat::{failed, Of};
use crate::error::Result;
use crate::json;

/// One mutant.
#[derive(Clone, Debug, Default, PartialEq, Eq)]
pub struct Mutant {
    /// `FILE:LINE:COLUMN: CHANGE`, as cargo-mutants calls it.
    pub name: String,
    /// The file, from the workspace's root.
    pub file: String,
    /// `replace + with - in f`: which change, wherever it stands.
    pub change: String,
    /// The line with what is changed between `«` and `»`; nothing where more than a line is.
    pub place: String,
}

/// Every mutant of the answer to `cargo mutants --list --json`, read beside the code in `root`.
///
/// # Errors
/// Where the answer does not fit the code.
pub fn parse(answer: &str, root: &Path) -> Result<Vec<Mutant>> {
    let listed = json::parse(answer, "cargo mutants --list")?;
    let mut mutants = Vec::new();
    let mut file = (String::new(), String::new());
    for mutant in json::entries(&listed) {
        let (Some(name), Some(of)) = (json::text(mutant, "name"), json::text(mutant, "file"))
        else {
            return failed("cargo mutants --list: a mutant without a name");
        };
        if file.0 != of {
            file = (
                of.to_owned(),
                std::fs::read_to_string(root.join(of)).of(of)?,
            );
        }
        let span = Span::of(mutant);
        let start = format!("{of}:{}:{}: ", span.from.0, span.from.1);
        let Some(change) = name.strip_prefix(&start) else {
            return failed(format!("cargo mutants --list: {name} does not stand there"));
        };
        mutants.push(Mutant {
            change: change.to_owned(),
            place: span.shown(&file.1),
            name: name.to_owned(),
            file: file.0.clone(),
        });
    }
    Ok(mutants)
}

/// Lines and columns, from 1; up to before the end.
#[derive(Default)]
struct Span {
    from: (usize, usize),
    to: (usize, usize),
}

impl Span {
    fn of(mutant: &JsonValue) -> Self {
        let end = |key| {
            let end = json::at(mutant, "span").and_then(|span| json::at(span, key));
            let number = |what| {
                end.and_then(|end| json::at(end, what))
                    .map_or(0, json::count)
            };
            (number("line"), number("column"))
        };
        Self {
            from: end("start"),
            to: end("end"),
        }
    }

    fn shown(&self, text: &str) -> String {
        let line = text.lines().nth(self.from.0.saturating_sub(1));
        let (Some(line), true) = (line, self.from.0 == self.to.0) else {
            return String::new();
        };
        let part = |from: usize, to: usize| -> String {
            line.chars().take(to - 1).skip(from - 1).collect()
        };
        let (from, to) = (self.from.1.max(1), self.to.1.max(1));
        let whole = line.chars().count() + 1;
        let (before, after) = (part(1, from), part(to, whole));
        format!("{before}«{}»{after}", part(from, to))
            .trim()
            .to_owned()
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_mutant_is_known_by_its_change_and_its_line_wherever_that_has_moved() {
        let folder = std::env::temp_dir().join(format!("listed-{}", std::process::id()));
        std::fs::create_dir_all(&folder).unwrap();
        std::fs::write(folder.join("a.rs"), "fn f() {\n    a + b + c\n}\n").unwrap();
        let answer = r#"[
            {"name": "a.rs:2:11: replace + with - in f", "file": "a.rs",
             "span": {"start": {"line": 2, "column": 11}, "end": {"line": 2, "column": 12}}},
            {"name": "a.rs:1:8: replace f with ()", "file": "a.rs",
             "span": {"start": {"line": 1, "column": 8}, "end": {"line": 3, "column": 2}}}]"#;
        let mutants = parse(answer, &folder).unwrap();
        assert_eq!(mutants[0].change, "replace + with - in f");
        assert_eq!(mutants[0].place, "a + b «+» c");
        assert_eq!(mutants[1].change, "replace f with ()");
        assert_eq!(mutants[1].place, "");
        std::fs::remove_dir_all(&folder).unwrap();
    }
}

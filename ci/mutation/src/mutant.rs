//! The mutants of a package, as cargo-mutants lists them.

use std::collections::BTreeMap;
use std::path::Path;

use anyhow::{Context, Result, bail};
use serde::Deserialize;
use serde_json::Value;

/// A line and a column, both from 1.
#[derive(Clone, Copy, Debug, Default, Deserialize, PartialEq, Eq, PartialOrd, Ord)]
pub struct Position {
    /// The line.
    pub line: usize,
    /// The column, in characters.
    pub column: usize,
}

/// A piece of source text, up to before its end.
#[derive(Clone, Copy, Debug, Default, Deserialize, PartialEq, Eq)]
pub struct Span {
    /// Its first character.
    pub start: Position,
    /// Behind its last character.
    pub end: Position,
}

/// One change of the source.
#[derive(Clone, Debug, Default, Deserialize, PartialEq, Eq)]
pub struct Mutant {
    /// The file, from the workspace's root.
    pub file: String,
    /// The function it is in; empty outside of functions.
    #[serde(skip)]
    pub function: String,
    /// The kind of change: `BinaryOperator`, as cargo-mutants names it.
    pub genre: String,
    /// What changes, wherever it is: `replace + with -`.
    #[serde(rename = "name")]
    pub change: String,
    /// The line with the changed part between `«` and `»`; of several lines the first.
    #[serde(skip)]
    pub at: String,
    /// The text that it replaces.
    pub span: Span,
    /// What stands there instead.
    pub replacement: String,
}

/// A function of the list, in which own operators look for mutants.
#[derive(Clone, Debug, Default, Deserialize, PartialEq, Eq)]
pub struct Function {
    /// Its path: `Pid::step`.
    #[serde(rename = "function_name")]
    pub name: String,
    /// Its text.
    pub span: Span,
}

/// The mutants of a list, and the functions they are in by file.
pub type List = (Vec<Mutant>, BTreeMap<String, Vec<Function>>);

/// What prints the list.
const LIST: &str = "cargo mutants --list";

/// Reads the answer of `cargo mutants --list --json`, beside the sources in `root`.
///
/// # Errors
/// Where the answer is none, or does not fit the sources.
pub fn parse(answer: &str, root: &Path) -> Result<List> {
    if answer.trim().is_empty() {
        return Ok(List::default());
    }
    let listed: Vec<Value> = serde_json::from_str(answer).context(LIST)?;
    let (mut mutants, mut functions) = List::default();
    let mut text = (String::new(), String::new());
    for listed in listed {
        let mut mutant = Mutant::deserialize(&listed).context(LIST)?;
        let function = Option::<Function>::deserialize(&listed["function"]).context(LIST)?;
        if text.0 != mutant.file {
            let read = std::fs::read_to_string(root.join(&mutant.file));
            text = (mutant.file.clone(), read.context(mutant.file.clone())?);
        }
        let known: &mut Vec<Function> = functions.entry(mutant.file.clone()).or_default();
        if let Some(function) = function {
            mutant.function.clone_from(&function.name);
            if !known.contains(&function) {
                known.push(function);
            }
        }
        let Position { line, column } = mutant.span.start;
        let start = format!("{}:{line}:{column}: ", mutant.file);
        let Some(change) = mutant.change.strip_prefix(&start) else {
            bail!("{LIST}: {} is not there", mutant.change);
        };
        let end = format!(" in {}", mutant.function);
        let change = change.strip_suffix(&end).unwrap_or(change);
        mutant.change = String::from(change);
        mutant.at = mutant.span.marked(&text.1);
        mutants.push(mutant);
    }
    Ok((mutants, functions))
}

impl std::fmt::Display for Mutant {
    fn fmt(&self, f: &mut std::fmt::Formatter<'_>) -> std::fmt::Result {
        let Position { line, column } = self.span.start;
        write!(f, "{}:{line}:{column}: {}", self.file, self.change)?;
        if !self.function.is_empty() && !self.change.contains(&self.function) {
            write!(f, " in {}", self.function)?;
        }
        Ok(())
    }
}

impl Mutant {
    /// The source with this change alone.
    pub fn applied(&self, text: &str) -> String {
        let (from, to) = self.span.bytes(text);
        [&text[..from], &self.replacement, &text[to..]].concat()
    }
}

impl Span {
    /// Its bytes in the file's text.
    pub fn bytes(&self, text: &str) -> (usize, usize) {
        let byte = |position: Position| {
            let lines = text.split_inclusive('\n').take(position.line - 1);
            let start: usize = lines.map(str::len).sum();
            let mut letters = text[start..].char_indices();
            let inside = letters.nth(position.column - 1);
            inside.map_or(text.len(), |(inside, _)| start + inside)
        };
        (byte(self.start), byte(self.end))
    }

    /// The line with this part marked; of several lines the first.
    pub fn marked(&self, text: &str) -> String {
        let line = text.lines().nth(self.start.line.saturating_sub(1));
        let Some(line) = line else {
            return String::new();
        };
        let one_line = self.start.line == self.end.line;
        let (mut marked, mut column) = (String::new(), 1);
        for letter in line.chars().map(Some).chain([None]) {
            if column == self.start.column {
                marked.push('«');
            }
            if one_line && column == self.end.column {
                marked.push('»');
            }
            marked.extend(letter);
            column += 1;
        }
        marked.trim().to_owned()
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn mutant_is_known_by_change_and_line() {
        let folder = tempfile::tempdir().unwrap();
        let folder = folder.path();
        let text = "fn f() {\n    a + b + c\n}\n";
        std::fs::write(folder.join("a.rs"), text).unwrap();
        let answer = r#"[
            {"name": "a.rs:2:11: replace + with - in f", "file": "a.rs", "genre": "BinaryOperator",
             "replacement": "-", "span": {"start": {"line": 2, "column": 11}, "end": {"line": 2, "column": 12}},
             "function": {"function_name": "f",
                          "span": {"start": {"line": 1, "column": 1}, "end": {"line": 3, "column": 2}}}},
            {"name": "a.rs:1:8: replace f with ()", "file": "a.rs", "genre": "FnValue", "replacement": "()",
             "span": {"start": {"line": 1, "column": 8}, "end": {"line": 3, "column": 2}}, "function": null}]"#;
        let (mutants, functions) = parse(answer, folder).unwrap();
        assert_eq!(mutants[0].change, "replace + with -");
        assert_eq!(mutants[0].at, "a + b «+» c");
        assert_eq!(mutants[0].applied(text), "fn f() {\n    a + b - c\n}\n");
        assert_eq!(mutants[1].to_string(), "a.rs:1:8: replace f with ()");
        assert_eq!(mutants[1].at, "fn f() «{");
        assert_eq!(functions["a.rs"][0].name, "f");
    }
}

//! What is wrong with a file, with its line and a caret.

use std::fmt::Write as _;
use std::ops::Range;
use std::path::Path;

/// Longest part of a line that a fault shows, characters.
const MAX_SHOWN: usize = 160;

/// One thing that is wrong with a file.
#[derive(Clone, Debug, PartialEq, Eq)]
pub struct FileFault {
    /// 1-based line, where one can be named.
    pub line: Option<usize>,
    /// That line, and the columns to blame.
    pub shown: Option<(String, Range<usize>)>,
    /// What is wrong and what is accepted.
    pub what: String,
}

impl FileFault {
    /// Something is wrong with the file as a whole.
    pub fn whole(what: impl Into<String>) -> Self {
        let what = what.into();
        let (line, shown) = (None, None);
        Self { line, shown, what }
    }

    /// The bytes `span` of `text` are wrong.
    pub fn at(text: &str, span: Range<usize>, what: impl Into<String>) -> Self {
        let before = text.get(..span.start).unwrap_or(text);
        let from = before.rfind('\n').map_or(0, |newline| newline + 1);
        let line = text.get(from..).and_then(|rest| rest.lines().next());
        let columns = |bytes: Option<&str>| bytes.map_or(0, |bytes| bytes.chars().count());
        let start = columns(text.get(from..span.start));
        let width = columns(text.get(span).and_then(|bad| bad.lines().next())).max(1);
        Self {
            line: Some(before.matches('\n').count() + 1),
            shown: line
                .filter(|_| start + width <= MAX_SHOWN)
                .map(|line| line.chars().take(MAX_SHOWN).collect())
                .map(|line| (line, start..start + width)),
            what: what.into(),
        }
    }

    /// With the file's name, the line and a caret below it.
    pub fn describe(&self, path: &Path) -> String {
        let mut text = path.display().to_string();
        if let Some(line) = self.line {
            let _ = write!(text, ", line {line}");
        }
        let _ = write!(text, ": {}", self.what);
        if let Some((line, columns)) = &self.shown {
            let indent: String = line
                .chars()
                .take(columns.start)
                .map(|letter| if letter == '\t' { '\t' } else { ' ' })
                .collect();
            let _ = write!(
                text,
                "\n    {line}\n    {indent}{}",
                "^".repeat(columns.len())
            );
        }
        text
    }
}

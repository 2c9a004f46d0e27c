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
            let before = line.chars().take(columns.start);
            let blank = |letter| if letter == '\t' { '\t' } else { ' ' };
            let indent: String = before.map(blank).collect();
            let _ = write!(
                text,
                "\n    {line}\n    {indent}{}",
                "^".repeat(columns.len())
            );
        }
        text
    }
}

#[test]
fn fault_shows_its_line_and_columns_up_to_160() {
    let shown = |text: &str, span: Range<usize>| {
        let fault = FileFault::at(text, span, "wrong");
        (fault.line, fault.shown)
    };
    let line = |line: &str, columns| Some((line.to_owned(), columns));
    assert_eq!(shown("ab cd\nef", 3..5), (Some(1), line("ab cd", 3..5)));
    assert_eq!(shown("ab\nä cd", 6..8), (Some(2), line("ä cd", 2..4)));
    // One column at least, and those of the first line only.
    assert_eq!(shown("ab", 2..2), (Some(1), line("ab", 2..3)));
    assert_eq!(shown("ab\ncd", 1..5), (Some(1), line("ab", 1..2)));
    let long = "x".repeat(200);
    assert_eq!(
        shown(&long, 159..160),
        (Some(1), line(&long[..160], 159..160))
    );
    assert_eq!(shown(&long, 159..161), (Some(1), None));
    assert!(shown(&long, 100..160).1.is_some());
}

//! The table of what came of the mutants, file by file.

use std::collections::BTreeMap;
use std::fmt::Write;

use super::runner::Outcome;

/// What came of one file's mutants.
#[derive(Clone, Debug, Default, PartialEq, Eq)]
pub struct Row {
    /// The file's text when they were tried: how git names it.
    pub text: String,
    /// How many were caught, ran for ever, did not compile, survived with an excuse.
    pub counts: [usize; 4],
}

impl Row {
    /// Counts the outcomes of all of a file's mutants, of which none survived without an excuse.
    pub fn of(text: String, outcomes: impl Iterator<Item = Outcome>) -> Self {
        let mut counts = [0; 4];
        for outcome in outcomes {
            counts[match outcome {
                Outcome::Caught => 0,
                Outcome::Endless => 1,
                Outcome::Unviable => 2,
                Outcome::Survived => 3,
            }] += 1;
        }
        Self { text, counts }
    }

    fn all(&self) -> usize {
        self.counts.iter().sum()
    }
}

/// Rows by the file, from the workspace's root.
pub type Rows = BTreeMap<String, Row>;

/// The rows of a table as [`show`] writes it.
pub fn parse(table: &str) -> Rows {
    let mut rows = Rows::new();
    for line in table.lines() {
        let cells: Vec<&str> = line.split('|').map(str::trim).collect();
        let ["", file, text, _, caught, endless, unviable, excused, ""] = cells[..] else {
            continue;
        };
        let name = |cell: &str| Some(cell.strip_prefix('`')?.strip_suffix('`')?.to_owned());
        let counts = [caught, endless, unviable, excused].map(str::parse);
        if let (Some(file), Some(text), [Ok(a), Ok(b), Ok(c), Ok(d)]) =
            (name(file), name(text), counts)
        {
            let counts = [a, b, c, d];
            rows.insert(file, Row { text, counts });
        }
    }
    rows
}

/// The document; `all` is how many mutants each file has today.
pub fn show(rows: &Rows, all: &BTreeMap<String, usize>) -> String {
    let sum: usize = all.values().sum();
    let tried: usize = rows.values().map(Row::all).sum();
    let mut text = format!(
        "# Mutants\n\n\
         `cargo-mutants` changes `fw-core` in every way it knows: an operator for another, a function's \
         body for a\nconstant, a match arm left out. Each change is put into a copy of the code, and some \
         test has to fail. `cargo xtask\nmutants` tries all of them, `--file` those of some files, and \
         renews the rows of the files it has tried whole, if\nno mutant survived there but those that \
         [`ci/mutants.txt`](../ci/mutants.txt) excuses, each with the reason why no test\ncan notice it. \
         An excuse that is about no mutant, or about one that is caught, fails. The gate `mutants` \
         tries\nthose in the lines that changed.\n\n\
         Of {sum} mutants in {} files the table counts {tried} in {}. Each row is of the file's text that \
         `git hash-object`\nnames so; where the file has another by now, the row is of an earlier one.\n\n\
         | file | text | mutants | caught | ran for ever | do not compile | excused |\n\
         |---|---|---|---|---|---|---|\n",
        all.len(),
        rows.len(),
    );
    for (file, row) in rows {
        let _ = write!(text, "| `{file}` | `{}` | {} |", row.text, row.all());
        for count in row.counts {
            let _ = write!(text, " {count} |");
        }
        text += "\n";
    }
    let total = |column: usize| -> usize { rows.values().map(|row| row.counts[column]).sum() };
    let _ = writeln!(
        text,
        "| together | | {tried} | {} | {} | {} | {} |",
        total(0),
        total(1),
        total(2),
        total(3)
    );
    let missing: Vec<_> = all
        .iter()
        .filter(|(file, _)| !rows.contains_key(*file))
        .collect();
    if !missing.is_empty() {
        text += "\n## Not tried whole yet\n\n| file | mutants |\n|---|---|\n";
        for (file, count) in missing {
            let _ = writeln!(text, "| `{file}` | {count} |");
        }
    }
    text
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_table_is_read_back_as_it_was_written() {
        let outcomes = [Outcome::Caught, Outcome::Survived, Outcome::Caught];
        let row = Row::of("0a1b2c3d".into(), outcomes.into_iter());
        assert_eq!(row.counts, [2, 0, 0, 1]);
        let rows = Rows::from([("fw-core/src/log.rs".to_owned(), row)]);
        let all = BTreeMap::from([
            ("fw-core/src/log.rs".to_owned(), 3),
            ("fw-core/src/units.rs".to_owned(), 9),
        ]);
        let text = show(&rows, &all);
        assert!(text.contains("Of 12 mutants in 2 files the table counts 3 in 1."));
        assert!(text.contains("| `fw-core/src/units.rs` | 9 |"));
        assert_eq!(parse(&text), rows);
    }
}

//! The result of a run.

use std::collections::BTreeMap;
use std::fmt;

use crate::suite::Outcome;

/// How many mutants ended how: caught, timed out, unviable, survived with an excuse, without.
pub type Counts = [usize; 5];

/// Counts by file, and what is wrong; displayed as a table in Markdown.
#[derive(Clone, Debug, Default)]
pub struct Report {
    /// By the file, from the workspace's root.
    pub files: BTreeMap<String, Counts>,
    /// Survivors without an excuse, excuses without a survivor.
    pub findings: Vec<String>,
    /// How many mutants were to be tried.
    pub chosen: usize,
}

impl Report {
    /// Counts a file's mutant.
    pub fn add(&mut self, file: &str, outcome: Outcome, excused: bool) {
        let column = match (outcome, excused) {
            (Outcome::Caught, _) => 0,
            (Outcome::TimedOut, _) => 1,
            (Outcome::Unviable, _) => 2,
            (Outcome::Survived, true) => 3,
            (Outcome::Survived, false) => 4,
        };
        self.files.entry(file.to_owned()).or_default()[column] += 1;
    }

    /// How many mutants were tried.
    pub fn tried(&self) -> usize {
        self.files.values().flatten().sum()
    }
}

impl fmt::Display for Report {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        let head = "| file | mutants | caught | timed out | unviable | excused | survived |";
        writeln!(f, "{head}\n|---|---|---|---|---|---|---|")?;
        let column = |column: usize| self.files.values().map(|counts| counts[column]).sum();
        let total = ("all".to_owned(), [0, 1, 2, 3, 4].map(column));
        for (file, counts) in self.files.iter().chain([(&total.0, &total.1)]) {
            let [caught, timed_out, unviable, excused, survived] = counts;
            let sum: usize = counts.iter().sum();
            let noticed = format!("{caught} | {timed_out} | {unviable}");
            writeln!(f, "| {file} | {sum} | {noticed} | {excused} | {survived} |")?;
        }
        for finding in &self.findings {
            write!(f, "\n- {finding}")?;
        }
        Ok(())
    }
}

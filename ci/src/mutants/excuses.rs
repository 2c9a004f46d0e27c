//! The mutants that nobody can notice, each with the reason, as they stand in `ci/mutants.txt`:
//!
//! ```text
//! The shift is even, so that or and exclusive or are the same.    why, at the line's beginning
//!   fw-core/src/units.rs: replace | with ^ in f                   a file and a change
//!     at (a << 1) «|» 1                                           the line, the changed part marked
//! ```
//!
//! A change of several lines, a whole function's body above all, has no `at`.

use super::listed::Mutant;
use crate::compat::failed;
use crate::error::Result;

/// A mutant that may survive.
#[derive(Debug, Default, PartialEq, Eq)]
pub struct Excuse {
    /// Why no test can notice it.
    pub why: String,
    /// The file, from the workspace's root.
    pub file: String,
    /// What cargo-mutants calls the change.
    pub change: String,
    /// Where it stands, as [`Mutant::place`].
    pub place: String,
}

impl Excuse {
    /// Whether it is about this mutant.
    pub fn covers(&self, mutant: &Mutant) -> bool {
        self.file == mutant.file && self.change == mutant.change && self.place == mutant.place
    }
}

impl std::fmt::Display for Excuse {
    fn fmt(&self, f: &mut std::fmt::Formatter<'_>) -> std::fmt::Result {
        write!(f, "{}: {}", self.file, self.change)?;
        if self.place.is_empty() {
            Ok(())
        } else {
            write!(f, " at {}", self.place)
        }
    }
}

/// # Errors
/// Names the line that says nothing.
pub fn parse(text: &str) -> Result<Vec<Excuse>> {
    let mut excuses: Vec<Excuse> = Vec::new();
    let mut why = String::new();
    // A reason may take several lines.
    let mut in_reason = false;
    for (number, line) in text.lines().enumerate() {
        let words = line.trim();
        if words.is_empty() || words.starts_with('#') {
            in_reason = false;
        } else if !line.starts_with(' ') {
            if in_reason {
                why.push(' ');
            } else {
                why.clear();
            }
            why.push_str(words);
            in_reason = true;
        } else if let Some(place) = words.strip_prefix("at ") {
            let last = excuses.last_mut().filter(|last| last.place.is_empty());
            let Some(last) = last else {
                return failed(format!("ci/mutants.txt:{}: at what?", number + 1));
            };
            place.clone_into(&mut last.place);
        } else {
            in_reason = false;
            let Some((file, change)) = words.split_once(": ").filter(|_| !why.is_empty()) else {
                return failed(format!("ci/mutants.txt:{}: {words}?", number + 1));
            };
            excuses.push(Excuse {
                why: why.clone(),
                file: file.to_owned(),
                change: change.to_owned(),
                place: String::new(),
            });
        }
    }
    Ok(excuses)
}

/// The excuses that no longer are about any mutant.
pub fn stale<'a>(excuses: &'a [Excuse], mutants: &[Mutant]) -> Vec<&'a Excuse> {
    let covers_none = |excuse: &&Excuse| !mutants.iter().any(|mutant| excuse.covers(mutant));
    excuses.iter().filter(covers_none).collect()
}

#[cfg(test)]
mod tests {
    use super::*;

    const LIST: &str =
        "# wire\nIt is even,\nso that both are one.\n  a.rs: replace | with ^ in f\n    \
                        at (a << 1) «|» 1\n  a.rs: replace g with ()\n\nNobody looks.\n  \
                        b.rs: replace + with - in h\n    at c «+» d\n";

    #[test]
    fn an_excuse_is_about_one_place_and_says_why() {
        let excuses = parse(LIST).unwrap();
        assert_eq!(excuses.len(), 3);
        assert_eq!(excuses[1].why, "It is even, so that both are one.");
        assert_eq!(excuses[2].why, "Nobody looks.");
        let mutant = Mutant {
            name: "a.rs:7:9: replace | with ^ in f".into(),
            file: "a.rs".into(),
            change: "replace | with ^ in f".into(),
            place: "(a << 1) «|» 1".into(),
        };
        assert!(excuses[0].covers(&mutant));
        let elsewhere = Mutant {
            place: "(b << 1) «|» 1".into(),
            ..mutant.clone()
        };
        assert!(!excuses[0].covers(&elsewhere));
        assert_eq!(
            stale(&excuses, &[mutant]),
            [&excuses[1], &excuses[2]],
            "what is about nothing is found"
        );
    }

    #[test]
    fn a_line_that_says_nothing_is_named() {
        let why = |text: &str| parse(text).unwrap_err().to_string();
        assert!(
            why("  a.rs: replace f with ()\n").contains(":1:"),
            "no reason"
        );
        assert!(why("So.\n  at b\n").contains("at what"));
        assert!(why("So.\n  a.rs\n").contains(":2:"));
    }
}

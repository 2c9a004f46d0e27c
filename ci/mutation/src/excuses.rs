//! Mutants that no test can notice, each with the reason.
//!
//! ```toml
//! [[excuse]]
//! reason = "The shift is even, so that or and exclusive or are the same."
//! mutants = [
//!     { file = "src/units.rs", function = "f", change = "replace | with ^", at = "(a << 1) «|» 1" },
//! ]
//! ```
//!
//! A change outside of functions has no `function`.

use anyhow::{Result, ensure};
use serde::Deserialize;

use crate::mutant::Mutant;

/// Excuses, by reason.
#[derive(Debug, Default, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct Excuses {
    #[serde(default)]
    excuse: Vec<Excuse>,
}

#[derive(Debug, Deserialize)]
#[serde(deny_unknown_fields)]
struct Excuse {
    reason: String,
    mutants: Vec<Excused>,
}

/// A mutant that may survive, wherever in its function it has moved.
#[derive(Debug, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct Excused {
    file: String,
    #[serde(default)]
    function: String,
    change: String,
    #[serde(default)]
    at: String,
}

impl Excuses {
    /// # Errors
    /// Names the line that cannot be read, or the excuse without a reason.
    pub fn parse(text: &str) -> Result<Self> {
        let excuses: Self = toml::from_str(text)?;
        for Excuse { reason, mutants } in &excuses.excuse {
            ensure!(!reason.trim().is_empty(), "no reason for {mutants:?}");
        }
        Ok(excuses)
    }

    fn all(&self) -> impl Iterator<Item = &Excused> {
        self.excuse.iter().flat_map(|excuse| &excuse.mutants)
    }

    /// Whether this mutant may survive.
    pub fn cover(&self, mutant: &Mutant) -> bool {
        self.all().any(|excused| excused.is(mutant))
    }

    /// The excuses of mutants that are not in the list.
    pub fn stale(&self, all: &[Mutant]) -> Vec<&Excused> {
        let stale = |excused: &&Excused| !all.iter().any(|mutant| excused.is(mutant));
        self.all().filter(stale).collect()
    }
}

impl Excused {
    fn is(&self, mutant: &Mutant) -> bool {
        self.file == mutant.file
            && self.function == mutant.function
            && self.change == mutant.change
            && self.at == mutant.at
    }
}

impl std::fmt::Display for Excused {
    fn fmt(&self, f: &mut std::fmt::Formatter<'_>) -> std::fmt::Result {
        write!(f, "{}: {} in ", self.file, self.change)?;
        write!(f, "{} at {}", self.function, self.at)
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn excuse_covers_one_place() {
        let text = r#"
            [[excuse]]
            reason = "The shift is even."
            mutants = [
                { file = "a.rs", function = "f", change = "replace | with ^", at = "a «|» 1" },
                { file = "a.rs", change = "replace g with ()" },
            ]"#;
        let excuses = Excuses::parse(text).unwrap();
        let mutant = Mutant {
            file: "a.rs".into(),
            function: "f".into(),
            change: "replace | with ^".into(),
            at: "a «|» 1".into(),
            ..Mutant::default()
        };
        assert!(excuses.cover(&mutant));
        let elsewhere = Mutant {
            at: "b «|» 1".into(),
            ..mutant.clone()
        };
        assert!(!excuses.cover(&elsewhere));
        let stale = excuses.stale(&[mutant]);
        assert_eq!(stale.len(), 1);
        assert_eq!(stale[0].change, "replace g with ()");
    }

    #[test]
    fn excuse_without_reason_is_refused() {
        assert!(Excuses::parse("[[excuse]]\nreason = \" \"\nmutants = []").is_err());
        assert!(Excuses::parse("[[excuse]]\nmutants = []").is_err());
    }
}

//! Checks of everything between the kernel and the wheels. Every finding names one cause: what depends on a
//! failed check is skipped.

mod board;
pub mod bringup;
mod computer;
mod wheels;

pub use board::check as check_board;
pub use computer::check as check_computer;
pub use wheels::{check as check_wheels, skip as skip_wheels};

use serde::Serialize;

/// How a check ended.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Serialize)]
#[serde(rename_all = "lowercase")]
pub enum Outcome {
    /// As it should be.
    Passed,
    /// Something is to be done.
    Failed,
    /// Not checked, because of another finding or because it is not fitted.
    Skipped,
}

/// One check.
#[derive(Clone, Debug, PartialEq, Eq, Serialize)]
pub struct Finding {
    /// Its name.
    pub check: &'static str,
    /// How it ended.
    pub outcome: Outcome,
    /// What was found.
    pub found: String,
    /// What to do about a failure.
    pub advice: Option<&'static str>,
}

/// All findings, in the order of the checks.
#[derive(Clone, Debug, Default, PartialEq, Eq, Serialize)]
pub struct Findings(pub Vec<Finding>);

impl Findings {
    fn add(
        &mut self,
        check: &'static str,
        outcome: Outcome,
        found: impl Into<String>,
        advice: Option<&'static str>,
    ) {
        self.0.push(Finding {
            check,
            outcome,
            found: found.into(),
            advice,
        });
    }

    fn pass(&mut self, check: &'static str, found: impl Into<String>) {
        self.add(check, Outcome::Passed, found, None);
    }

    fn fail(&mut self, check: &'static str, found: impl Into<String>, advice: &'static str) {
        self.add(check, Outcome::Failed, found, Some(advice));
    }

    fn skip(&mut self, checks: &[&'static str], why: &str) {
        for check in checks {
            self.add(check, Outcome::Skipped, why, None);
        }
    }

    /// Passes with `found`, or fails with the same.
    fn judge(&mut self, check: &'static str, good: bool, found: String, advice: &'static str) {
        if good {
            self.pass(check, found);
        } else {
            self.fail(check, found, advice);
        }
    }

    /// The names of the checks that failed.
    pub fn failed(&self) -> Vec<&'static str> {
        let failed = self.0.iter().filter(|one| one.outcome == Outcome::Failed);
        failed.map(|finding| finding.check).collect()
    }
}

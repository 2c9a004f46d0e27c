//! Kani over the theorems: what it prints, harness by harness, and what of that is a failure.
//!
//! Kani calls a harness successful whose covers cannot be reached; here that is a failure, for such a
//! harness proves nothing.

use crate::error::{failed, Result};
use crate::place::Place;
use crate::shell;

/// Why Kani is not run, and how it would be.
pub const MISSING: &str =
    "Kani is not installed (`cargo install --locked kani-verifier && cargo kani \
    setup`); the same properties ran exhaustively or sampled among the unit tests";

/// Kani's version, where it is installed with its bundle.
pub fn version(place: &Place) -> Option<String> {
    shell::ask(place.cargo().args(["kani", "--version"]))
}

/// Proves every harness; the closing figure.
///
/// # Errors
/// Names the harnesses that fail, and those with a cover that cannot be reached.
pub fn prove(place: &Place) -> Result<String> {
    let mut kani = place.cargo();
    kani.arg("kani").current_dir(place.root.join("proofs"));
    let (status, text) = shell::tee_any_end(&mut kani)?;
    let figure = judge(&text)?;
    if status.success() {
        Ok(figure)
    } else {
        failed(format!("`{}` ended with {status}", shell::shown(&kani)))
    }
}

/// What Kani printed about one harness.
#[derive(Debug)]
struct Harness<'a> {
    name: &'a str,
    successful: bool,
    /// Covers that were reached, and all; `None` until the line that says so.
    covers: Option<(u32, u32)>,
    seconds: f64,
}

impl Harness<'_> {
    /// What is wrong with it, or nothing.
    fn complaint(&self) -> Option<String> {
        let name = self.name;
        match self.covers {
            _ if !self.successful => Some(format!("{name} is not proven")),
            None => Some(format!("{name} has no cover: it may prove nothing")),
            Some((some, all)) if some < all => Some(format!(
                "{name} has {} cover(s) that cannot be reached: it proves less than it says",
                all - some
            )),
            Some(_) => None,
        }
    }
}

/// The harnesses in the order Kani checked them.
fn harnesses(text: &str) -> Vec<Harness<'_>> {
    let mut all = Vec::<Harness>::new();
    for line in text.lines() {
        if let Some(name) = between(line, "Checking harness ", "...") {
            all.push(Harness {
                name,
                successful: false,
                covers: None,
                seconds: 0.0,
            });
        }
        let Some(harness) = all.last_mut() else {
            continue;
        };
        if line == "VERIFICATION:- SUCCESSFUL" {
            harness.successful = true;
        }
        if let Some(covers) = between(line, " ** ", " cover properties satisfied") {
            let numbers = covers.split_once(" of ");
            harness.covers =
                numbers.and_then(|(some, all)| some.parse().ok().zip(all.parse().ok()));
        }
        if let Some(seconds) = between(line, "Verification Time: ", "s") {
            harness.seconds = seconds.parse().unwrap_or_default();
        }
    }
    all
}

/// What stands in `line` after `before`, which it begins with, and up to `after`.
fn between<'a>(line: &'a str, before: &str, after: &str) -> Option<&'a str> {
    let (inner, _) = line.strip_prefix(before)?.split_once(after)?;
    Some(inner)
}

fn judge(text: &str) -> Result<String> {
    let harnesses = harnesses(text);
    let complaints: Vec<_> = harnesses.iter().filter_map(Harness::complaint).collect();
    if !complaints.is_empty() {
        return failed(complaints.join("; "));
    }
    // After the last harness: a run that was cut short has no such line.
    let complete = text
        .lines()
        .rev()
        .find_map(|line| line.strip_prefix("Complete - "));
    let slowest = harnesses
        .iter()
        .max_by(|one, other| one.seconds.total_cmp(&other.seconds));
    match (complete, slowest) {
        (Some(complete), Some(slowest)) => Ok(format!(
            "{} The longest, {}, took {:.0} s.",
            complete, slowest.name, slowest.seconds
        )),
        _ => failed("Kani said nothing of having completed"),
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    /// What Kani 0.65 prints, without the checks and most of what its solver says.
    const GOOD: &str = "\
Kani Rust Verifier 0.65.0 (cargo plugin)
    Finished `dev` profile [optimized + debuginfo] target(s) in 5.40s
Checking harness units::shortest_way_arrives::harness::proof...
CBMC version 6.6.0 (cbmc-6.6.0) 64-bit x86_64 linux
SAT checker: instance is UNSATISFIABLE
RESULTS:
Check 9: units::shortest_way_arrives::harness::proof.cover.3
\t - Status: SATISFIED
\t - Description: \"across a full turn\"

Check 10: units::shortest_way_arrives::harness::proof.assertion.1
\t - Status: UNREACHABLE

SUMMARY:
 ** 0 of 7 failed (1 unreachable)

 ** 3 of 3 cover properties satisfied


VERIFICATION:- SUCCESSFUL
Verification Time: 4.7749815s

Checking harness units::span_survives_the_wrap::harness::proof...

SUMMARY:
 ** 0 of 6 failed

 ** 2 of 2 cover properties satisfied


VERIFICATION:- SUCCESSFUL
Verification Time: 1.4145411s

Manual Harness Summary:
Complete - 2 successfully verified harnesses, 0 failures, 2 total.
";

    fn complaint(text: &str) -> String {
        judge(text).unwrap_err().to_string()
    }

    #[test]
    fn a_good_run_is_its_last_line_and_its_longest_harness() {
        assert_eq!(
            judge(GOOD).unwrap(),
            "2 successfully verified harnesses, 0 failures, 2 total. \
             The longest, units::shortest_way_arrives::harness::proof, took 5 s."
        );
    }

    #[test]
    fn a_dead_cover_is_a_failure_whichever_way_it_is_dead() {
        let unsatisfiable = GOOD.replace(" ** 2 of 2 cover", " ** 1 of 2 cover");
        let said = complaint(&unsatisfiable);
        assert!(said.starts_with("units::span_survives_the_wrap::harness::proof has 1 cover"));
        let unreachable = GOOD.replace(
            " ** 3 of 3 cover properties satisfied",
            " ** 1 of 3 cover properties satisfied (1 unreachable)",
        );
        let said = complaint(&unreachable);
        assert!(said.starts_with("units::shortest_way_arrives::harness::proof has 2 cover"));
    }

    #[test]
    fn a_harness_without_a_cover_is_a_failure() {
        let none = GOOD.replace(" ** 2 of 2 cover properties satisfied\n", "");
        assert!(complaint(&none).contains("has no cover"));
    }

    #[test]
    fn what_is_not_proven_is_named() {
        let failed = GOOD
            .replacen("VERIFICATION:- SUCCESSFUL", "VERIFICATION:- FAILED", 1)
            .replace(
                "2 successfully verified harnesses, 0",
                "1 successfully verified harnesses, 1",
            );
        assert_eq!(
            complaint(&failed),
            "units::shortest_way_arrives::harness::proof is not proven"
        );
        // Killed for want of memory or time: no checks, no covers.
        let (head, _) = GOOD.split_at(GOOD.find("SUMMARY").unwrap_or_default());
        let killed = format!("{head}\nCBMC failed\nVERIFICATION:- FAILED\n");
        assert!(complaint(&killed).contains("is not proven"));
        assert!(complaint(head).contains("is not proven"));
    }

    #[test]
    fn a_run_without_an_end_or_without_a_harness_is_a_failure() {
        let (cut, _) = GOOD.split_at(GOOD.find("Manual").unwrap_or_default());
        assert!(complaint(cut).contains("completed"));
        assert!(complaint("error: could not compile `proofs`\n").contains("completed"));
        assert!(complaint("No proof harnesses were found to verify.\n").contains("completed"));
    }
}

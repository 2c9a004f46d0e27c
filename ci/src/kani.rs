//! Kani over the theorems: what it prints, harness by harness, and what of that is a failure.
//!
//! Kani calls a harness successful whose covers cannot be reached; here that is a failure, for such a
//! harness proves nothing. So is one that takes longer than the budget allows, and one that was
//! declared but not checked.

use std::fmt;

use crate::error::{failed, Error, Result};
use crate::numbers::Budget;
use crate::place::Place;
use crate::shard::Shard;
use crate::shell;

/// Why Kani is not run, and how it would be.
pub const MISSING: &str =
    "Kani is not installed (`cargo install --locked kani-verifier && cargo kani \
    setup`); the same properties ran exhaustively or sampled among the unit tests";

/// Kani's version, where it is installed with its bundle.
pub fn version(place: &Place) -> Option<String> {
    shell::ask(place.cargo().args(["kani", "--version"]))
}

/// The harnesses that `proofs` declares, by the names that Kani gives them.
fn declared(place: &Place) -> Result<Vec<String>> {
    let list = "run --quiet --package proofs --example theorems -- --harnesses";
    match shell::ask(place.cargo().args(list.split(' '))) {
        Some(text) if !text.is_empty() => Ok(text.lines().map(str::to_owned).collect()),
        _ => failed(format!("`cargo {list}` failed")),
    }
}

/// Proves a shard of the harnesses; the closing figure.
///
/// # Errors
/// Names the harnesses that fail, take too long or were not checked, and those with a cover that
/// cannot be reached.
pub fn prove(place: &Place, shard: Shard) -> Result<String> {
    let limit = limit(&Budget::parse(&place.read("ci/budget.toml")?)?)?;
    let declared = declared(place)?;
    let chosen: Vec<_> = shard.of(declared.iter().map(String::as_str)).collect();
    if chosen.is_empty() {
        return failed(format!(
            "only {} harnesses for so many shards",
            declared.len()
        ));
    }
    let mut kani = place.cargo();
    kani.arg("kani").current_dir(place.root.join("proofs"));
    // From 0.59 on Kani can end a harness itself; without that, what takes too long fails afterwards.
    let help = shell::ask(place.cargo().args(["kani", "--help"])).unwrap_or_default();
    if help.contains("--harness-timeout") {
        let timeout = format!("{limit}s");
        kani.args(["-Z", "unstable-options", "--harness-timeout", &timeout]);
    }
    // A shard is chosen before anything is compiled; without a choice Kani finds every harness itself.
    if shard != Shard::ALL {
        kani.arg("--exact");
        for name in &chosen {
            kani.args(["--harness", name]);
        }
    }
    let (status, text) = shell::tee_some(&mut kani, telling)?;
    let harnesses = harnesses(&text);
    for harness in &harnesses {
        println!("  {harness}");
    }
    let figure = judge(&text, &harnesses, &chosen, limit)?;
    if status.success() {
        Ok(figure)
    } else {
        failed(format!("`{}` ended with {status}", shell::shown(&kani)))
    }
}

/// Seconds that a harness may take.
fn limit(budget: &Budget) -> Result<f64> {
    let mut bars = budget.section("kani.at_most");
    let bar = bars.find(|(key, _)| *key == "harness_seconds");
    bar.map(|(_, seconds)| seconds)
        .ok_or_else(|| Error::Failed("ci/budget.toml: kani.at_most has no harness_seconds".into()))
}

/// Whether a line is worth showing: Kani prints four for each of some thousand checks, and hands on
/// what its model checker says of its progress.
fn telling(line: &str) -> bool {
    const QUIET: [&str; 24] = [
        "RESULTS:",
        "SUMMARY:",
        "Check ",
        "\t - ",
        "CBMC version",
        "Reading GOTO",
        "Generating GOTO",
        "Adding CPROVER",
        "Removal of",
        "Generic Property",
        "Running with",
        "Starting Bounded",
        "aborting path",
        "Unwinding loop",
        "Not unwinding",
        "size of program",
        "slicing removed",
        "Generated ",
        "Passing problem",
        "converting SSA",
        "Post-processing",
        "SAT checker",
        "Solving with",
        "Run",
    ];
    let quiet = QUIET.iter().any(|start| line.starts_with(start));
    let quiet = quiet || line.contains(" variables, ") || line.contains("(cbmc-");
    !line.trim().is_empty() && !quiet
}

/// What Kani printed about one harness.
#[derive(Debug)]
struct Harness<'a> {
    name: &'a str,
    successful: bool,
    timed_out: bool,
    /// Covers that were reached, and all; `None` until the line that says so.
    covers: Option<(u32, u32)>,
    /// What the covers say that were not.
    dead: Vec<&'a str>,
    seconds: f64,
}

impl Harness<'_> {
    /// What is wrong with it, or nothing.
    fn complaint(&self, limit: f64) -> Option<String> {
        let (name, seconds) = (self.name, self.seconds);
        match self.covers {
            _ if self.timed_out => Some(format!("{name} took longer than {limit} s")),
            _ if !self.successful => Some(format!("{name} is not proven")),
            None => Some(format!("{name} has no cover: it may prove nothing")),
            Some((some, all)) if some < all => Some(format!(
                "{name} has {} cover(s) that cannot be reached, {}: it proves less than it says",
                all - some,
                self.dead.join(", ")
            )),
            Some(_) if seconds > limit => {
                Some(format!("{name} took {seconds:.0} s, the limit is {limit}"))
            }
            Some(_) => None,
        }
    }
}

/// A row of the table: seconds, covers, name.
impl fmt::Display for Harness<'_> {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        let (some, all) = self.covers.unwrap_or_default();
        let proven = if self.successful { "" } else { ": NOT PROVEN" };
        let (seconds, name) = (self.seconds, self.name);
        write!(f, "{seconds:7.1} s  {some} of {all} covers  {name}{proven}")
    }
}

/// The harnesses in the order Kani checked them.
fn harnesses(text: &str) -> Vec<Harness<'_>> {
    let mut all = Vec::<Harness>::new();
    let mut dead = false;
    for line in text.lines() {
        if let Some(name) = between(line, "Checking harness ", "...") {
            all.push(Harness {
                name,
                successful: false,
                timed_out: false,
                covers: None,
                dead: Vec::new(),
                seconds: 0.0,
            });
        }
        let Some(harness) = all.last_mut() else {
            continue;
        };
        if line == "VERIFICATION:- SUCCESSFUL" {
            harness.successful = true;
        }
        harness.timed_out |= line.starts_with("CBMC timed out");
        // Of a cover: an assertion that cannot be reached is none of our business.
        if line.starts_with("Check ") {
            dead = line.contains(".cover.");
        } else if let Some(status) = line.strip_prefix("\t - Status: ") {
            dead &= status != "SATISFIED";
        } else if let Some(said) = between(line, "\t - Description: \"", "\"") {
            if dead {
                harness.dead.push(said);
            }
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

/// All of `text` and its `harnesses`, of which the `chosen` ones must be there.
fn judge(text: &str, harnesses: &[Harness<'_>], chosen: &[&str], limit: f64) -> Result<String> {
    let mut complaints: Vec<_> = harnesses
        .iter()
        .filter_map(|harness| harness.complaint(limit))
        .collect();
    // After the last harness: a run that was cut short has no such line.
    let complete = text
        .lines()
        .rev()
        .find_map(|line| line.strip_prefix("Complete - "));
    let Some(complete) = complete else {
        complaints.push("Kani said nothing of having completed".into());
        return failed(complaints.join("; "));
    };
    for name in chosen {
        if !harnesses.iter().any(|harness| harness.name == *name) {
            complaints.push(format!("{name} was not checked"));
        }
    }
    if !complaints.is_empty() {
        return failed(complaints.join("; "));
    }
    let slowest = harnesses
        .iter()
        .max_by(|one, other| one.seconds.total_cmp(&other.seconds));
    let Some(slowest) = slowest else {
        return failed("Kani checked no harness");
    };
    let seconds: f64 = harnesses.iter().map(|harness| harness.seconds).sum();
    Ok(format!(
        "{complete} {seconds:.0} s in all; the longest, {}, took {:.0} s.",
        slowest.name, slowest.seconds
    ))
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

    const BOTH: [&str; 2] = [
        "units::shortest_way_arrives::harness::proof",
        "units::span_survives_the_wrap::harness::proof",
    ];

    fn verdict(text: &str) -> Result<String> {
        judge(text, &harnesses(text), &BOTH, 300.0)
    }

    fn complaint(text: &str) -> String {
        verdict(text).unwrap_err().to_string()
    }

    #[test]
    fn a_good_run_is_its_last_line_and_its_longest_harness() {
        assert_eq!(
            verdict(GOOD).unwrap(),
            "2 successfully verified harnesses, 0 failures, 2 total. \
             6 s in all; the longest, units::shortest_way_arrives::harness::proof, took 5 s."
        );
        assert_eq!(
            harnesses(GOOD)[0].to_string(),
            "    4.8 s  3 of 3 covers  units::shortest_way_arrives::harness::proof"
        );
    }

    #[test]
    fn a_dead_cover_is_a_failure_whichever_way_it_is_dead() {
        let unsatisfiable = GOOD.replace(" ** 2 of 2 cover", " ** 1 of 2 cover");
        let said = complaint(&unsatisfiable);
        assert!(said.starts_with("units::span_survives_the_wrap::harness::proof has 1 cover"));
        let unreachable = GOOD
            .replace(
                " ** 3 of 3 cover properties satisfied",
                " ** 2 of 3 cover properties satisfied (1 unreachable)",
            )
            .replace("Status: SATISFIED", "Status: UNREACHABLE");
        let said = complaint(&unreachable);
        assert!(said.starts_with(
            "units::shortest_way_arrives::harness::proof has 1 cover(s) that cannot be \
             reached, across a full turn:"
        ));
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
    fn what_takes_too_long_is_a_failure_whether_kani_ended_it_or_not() {
        let long = GOOD.replace("Time: 1.4145411s", "Time: 300.5s");
        assert_eq!(
            complaint(&long),
            "units::span_survives_the_wrap::harness::proof took 300 s, the limit is 300"
        );
        let ended = "CBMC failed\nVERIFICATION:- FAILED\nCBMC timed out. You may want to rerun";
        let ended = GOOD.replacen("VERIFICATION:- SUCCESSFUL", ended, 1);
        assert_eq!(
            complaint(&ended),
            "units::shortest_way_arrives::harness::proof took longer than 300 s"
        );
    }

    #[test]
    fn a_declared_harness_that_was_not_checked_is_a_failure() {
        let renamed = GOOD.replace("span_survives_the_wrap", "something_else");
        let said = "units::span_survives_the_wrap::harness::proof was not checked";
        assert_eq!(complaint(&renamed), said);
    }

    #[test]
    fn a_run_without_an_end_or_without_a_harness_is_a_failure() {
        let (cut, _) = GOOD.split_at(GOOD.find("Manual").unwrap_or_default());
        assert!(complaint(cut).contains("completed"));
        assert!(complaint("error: could not compile `proofs`\n").contains("completed"));
        assert!(complaint("No proof harnesses were found to verify.\n").contains("completed"));
    }

    #[test]
    fn what_kani_says_of_a_harness_is_shown_and_its_checks_are_not() {
        let shown: Vec<_> = GOOD.lines().filter(|line| telling(line)).collect();
        assert!(shown.contains(&" ** 3 of 3 cover properties satisfied"));
        assert!(
            shown.contains(&"Complete - 2 successfully verified harnesses, 0 failures, 2 total.")
        );
        assert!(!shown
            .iter()
            .any(|line| line.contains("Status") || line.contains("SAT")));
    }

    #[test]
    fn the_budget_names_the_limit() {
        let budget = Budget::parse("[kani.at_most]\nharness_seconds = 300\n").unwrap();
        assert_eq!(format!("{}s", limit(&budget).unwrap()), "300s");
        assert!(limit(&Budget::default()).is_err());
    }
}

//! Kani over the theorems: what it prints, harness by harness, and what of that is a failure.
//!
//! Kani calls a harness successful whose covers cannot be reached; here that is a failure, for such a
//! harness proves nothing. So is one that takes longer than the budget allows, and one that was
//! declared but not checked.

use std::fmt;

use xshell::cmd;

use crate::budget::Budget;
use crate::error::{bail, ensure, Context, Result};
use crate::process;
use crate::shard::Shard;
use crate::workspace::Workspace;

/// Why Kani is not run, and how it would be.
pub const MISSING: &str =
    "Kani is not installed (`cargo install --locked kani-verifier && cargo kani \
    setup`); the same properties ran exhaustively or sampled among the unit tests";

/// Kani's version, where it is installed with its bundle.
pub fn version(workspace: &Workspace) -> Option<String> {
    process::output(workspace.cargo("kani --version"))
}

/// The harnesses that `proofs` declares, by the names that Kani gives them.
fn declared(workspace: &Workspace) -> Result<Vec<String>> {
    let list = "run --quiet --package proofs --example theorems -- --harnesses";
    let text = process::output(workspace.cargo(list)).unwrap_or_default();
    ensure!(!text.is_empty(), "`cargo {list}` failed");
    Ok(text.lines().map(str::to_owned).collect())
}

/// Proves a shard of the harnesses; returns the closing figure. An error names the harnesses that
/// fail, take too long or were not checked, and those with a cover that cannot be reached.
pub fn prove(workspace: &Workspace, shard: Shard) -> Result<String> {
    let limit = Budget::read(workspace)?.figure("kani.at_most.harness_seconds")?;
    let declared = declared(workspace)?;
    let chosen: Vec<_> = shard.of(declared.iter().map(String::as_str)).collect();
    ensure!(
        !chosen.is_empty(),
        "only {} harnesses for so many shards",
        declared.len()
    );
    let sh = workspace.shell()?;
    sh.change_dir("proofs");
    let mut kani = cmd!(sh, "cargo kani");
    // From 0.59 on Kani can end a harness itself; without that, what takes too long fails afterwards.
    let help = process::output(workspace.cargo("kani --help")).unwrap_or_default();
    if help.contains("--harness-timeout") {
        let timeout = format!("{limit}s");
        kani = kani.args(["-Z", "unstable-options", "--harness-timeout", &timeout]);
    }
    // A shard is chosen before anything is compiled; without a choice Kani finds every harness itself.
    if shard != Shard::ALL {
        kani = kani.arg("--exact");
        kani = kani.args(chosen.iter().flat_map(|name| ["--harness", *name]));
    }
    let (status, text) = process::tee(kani, is_summary)?;
    let harnesses = harnesses(&text);
    for harness in &harnesses {
        println!("  {harness}");
    }
    let figure = judge(&text, &harnesses, &chosen, limit)?;
    ensure!(status.success(), "Kani ended with {status}");
    Ok(figure)
}

/// Whether a line is worth printing: Kani prints four for each of some thousand checks, and its model
/// checker's progress.
fn is_summary(line: &str) -> bool {
    const STARTS: [&str; 6] = [
        "Kani ",
        "Checking ",
        " ** ",
        "VERIFICATION",
        "Verification",
        "Complete",
    ];
    STARTS.iter().any(|start| line.starts_with(start)) || line.contains("error")
}

/// What Kani printed about one harness.
#[derive(Debug, Default)]
struct Harness<'a> {
    name: &'a str,
    successful: bool,
    timed_out: bool,
    /// Covers that were reached, and all; `None` until the line that says so.
    covers: Option<(u32, u32)>,
    /// The descriptions of the covers that were not.
    unreached: Vec<&'a str>,
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
                self.unreached.join(", ")
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
    let mut unreached_cover = false;
    for line in text.lines() {
        if let Some(name) = between(line, "Checking harness ", "...") {
            let harness = Harness::default();
            all.push(Harness { name, ..harness });
        }
        let Some(harness) = all.last_mut() else {
            continue;
        };
        harness.successful |= line == "VERIFICATION:- SUCCESSFUL";
        harness.timed_out |= line.starts_with("CBMC timed out");
        // Only covers count: an assertion that cannot be reached is none of our business.
        if line.starts_with("Check ") {
            unreached_cover = line.contains(".cover.");
        } else if let Some(status) = line.strip_prefix("\t - Status: ") {
            unreached_cover &= status != "SATISFIED";
        } else if let Some(description) = between(line, "\t - Description: \"", "\"") {
            harness
                .unreached
                .extend(unreached_cover.then_some(description));
        } else if let Some(covers) = between(line, " ** ", " cover properties satisfied") {
            let numbers = covers.split_once(" of ");
            harness.covers =
                numbers.and_then(|(some, all)| some.parse().ok().zip(all.parse().ok()));
        } else if let Some(seconds) = between(line, "Verification Time: ", "s") {
            harness.seconds = seconds.parse().unwrap_or_default();
        }
    }
    all
}

/// What `line` has after `before`, which it begins with, and up to `after`.
fn between<'a>(line: &'a str, before: &str, after: &str) -> Option<&'a str> {
    let (inner, _) = line.strip_prefix(before)?.split_once(after)?;
    Some(inner)
}

/// All of `text` and its `harnesses`, of which the `chosen` ones must be there.
fn judge(text: &str, harnesses: &[Harness<'_>], chosen: &[&str], limit: f64) -> Result<String> {
    let complaints = harnesses
        .iter()
        .filter_map(|harness| harness.complaint(limit));
    let mut complaints: Vec<_> = complaints.collect();
    // After the last harness: a run that was cut short has no such line.
    let complete = text
        .lines()
        .rev()
        .find_map(|line| line.strip_prefix("Complete - "));
    let Some(complete) = complete else {
        complaints.push("Kani did not complete".into());
        bail!(complaints.join("; "));
    };
    for name in chosen {
        if !harnesses.iter().any(|harness| harness.name == *name) {
            complaints.push(format!("{name} was not checked"));
        }
    }
    ensure!(complaints.is_empty(), complaints.join("; "));
    let by_time = |one: &&Harness, other: &&Harness| one.seconds.total_cmp(&other.seconds);
    let slowest = harnesses.iter().max_by(by_time);
    let Harness { name, seconds, .. } = slowest.context("Kani checked no harness")?;
    let sum: f64 = harnesses.iter().map(|harness| harness.seconds).sum();
    Ok(format!(
        "{complete} {sum:.0} s in all; the longest, {name}, took {seconds:.0} s."
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

    const NAMES: [&str; 2] = [
        "units::shortest_way_arrives::harness::proof",
        "units::span_survives_the_wrap::harness::proof",
    ];

    fn verdict(text: &str) -> Result<String> {
        judge(text, &harnesses(text), &NAMES, 300.0)
    }

    #[test]
    fn good_run_ends_with_its_longest_harness() {
        let figure = "2 successfully verified harnesses, 0 failures, 2 total. 6 s in all; the \
                      longest, units::shortest_way_arrives::harness::proof, took 5 s.";
        assert_eq!(verdict(GOOD).unwrap(), figure);
        let row = "    4.8 s  3 of 3 covers  units::shortest_way_arrives::harness::proof";
        assert_eq!(harnesses(GOOD)[0].to_string(), row);
        let shown: Vec<_> = GOOD.lines().filter(|line| is_summary(line)).collect();
        assert!(shown.contains(&" ** 3 of 3 cover properties satisfied"));
        assert!(!shown
            .iter()
            .any(|line| line.contains("Status") || line.contains("SAT")));
    }

    #[test]
    fn harness_that_proves_less_than_it_says_is_named() {
        const FAILED: &str = "VERIFICATION:- FAILED";
        let ended = format!("CBMC failed\n{FAILED}\nCBMC timed out. You may want to rerun");
        let unreachable = GOOD.replace("Status: SATISFIED", "Status: UNREACHABLE");
        let (before_summary, _) = GOOD.split_at(GOOD.find("SUMMARY").unwrap());
        let (before_end, _) = GOOD.split_at(GOOD.find("Manual").unwrap());
        let cases = [
            (
                GOOD.replace(" ** 2 of 2 cover", " ** 1 of 2 cover"),
                "units::span_survives_the_wrap::harness::proof has 1 cover(s) that cannot",
            ),
            (
                unreachable.replace("3 of 3 cover properties satisfied", "2 of 3 cover properties satisfied (1 unreachable)"),
                "units::shortest_way_arrives::harness::proof has 1 cover(s) that cannot be reached, across a full turn:",
            ),
            (
                GOOD.replace(" ** 2 of 2 cover properties satisfied\n", ""),
                "units::span_survives_the_wrap::harness::proof has no cover",
            ),
            (
                GOOD.replacen("VERIFICATION:- SUCCESSFUL", FAILED, 1),
                "units::shortest_way_arrives::harness::proof is not proven",
            ),
            (
                GOOD.replace("Time: 1.4145411s", "Time: 300.5s"),
                "units::span_survives_the_wrap::harness::proof took 300 s, the limit is 300",
            ),
            (
                GOOD.replacen("VERIFICATION:- SUCCESSFUL", &ended, 1),
                "units::shortest_way_arrives::harness::proof took longer than 300 s",
            ),
            (
                GOOD.replace("span_survives_the_wrap", "something_else"),
                "units::span_survives_the_wrap::harness::proof was not checked",
            ),
            (before_summary.to_owned(), "units::shortest_way_arrives::harness::proof is not proven"),
            (before_end.to_owned(), "Kani did not complete"),
            ("error: could not compile `proofs`\n".into(), "Kani did not complete"),
            ("No proof harnesses were found to verify.\n".into(), "Kani did not complete"),
        ];
        for (text, complaint) in cases {
            let error = verdict(&text).unwrap_err().to_string();
            assert!(error.contains(complaint), "{error}");
        }
    }
}

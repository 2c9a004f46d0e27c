//! Kani over the theorems: what it prints, harness by harness, and what of that is a failure.
//!
//! Kani calls a harness successful whose covers cannot be reached; here that is a failure, for such a
//! harness proves nothing. So is one that takes longer than the budget allows, and one that was
//! declared but not checked.

use crate::budget::Budget;
use crate::error::{Context, Result, ensure};
use crate::process::{self, pattern};
use crate::workspace::Workspace;

/// Why Kani is not run, and how it would be.
pub const MISSING: &str = "Kani is not installed (`cargo install --locked kani-verifier && cargo kani \
    setup`); the same properties ran exhaustively or sampled among the unit tests";

/// Kani's version, where it is installed with its bundle.
pub fn version(workspace: &Workspace) -> Option<String> {
    process::output(workspace.cargo("kani --version"))
}

/// `K/N`: every N-th harness, K from 0. Neighbours cost alike, so each machine of N gets one of them.
#[derive(Clone, Copy, Debug)]
pub struct Shard(usize, usize);

impl Shard {
    pub const ALL: Self = Self(0, 1);

    pub fn parse(text: &str) -> Result<Self> {
        let numbers = text.split_once('/').context("not K/N")?;
        let (number, count) = (numbers.0.parse()?, numbers.1.parse()?);
        ensure!(number < count, "K is not below N");
        Ok(Self(number, count))
    }
}

/// Proves a shard of the harnesses that `proofs` declares; returns the closing figure. An error names
/// the harnesses that fail, take too long or were not checked, and those with a cover that cannot be
/// reached.
pub fn prove(workspace: &Workspace, shard: Shard) -> Result<String> {
    let limit = Budget::read(workspace)?;
    let limit = limit.value("kani.at_most.harness_seconds")?.as_f64();
    let limit = limit.context("harness_seconds is no number")?;
    let list = "run --quiet --package proofs --example theorems -- --harnesses";
    let declared = workspace.cargo(list).read()?;
    let Shard(number, count) = shard;
    let chosen: Vec<_> = declared.lines().skip(number).step_by(count).collect();
    ensure!(!chosen.is_empty(), "fewer harnesses than shards");
    let _in_proofs = workspace.sh.push_dir("proofs");
    let mut kani = workspace.cargo("kani");
    // From 0.59 on Kani can end a harness itself; without that, what takes too long fails afterwards.
    let help = process::output(workspace.cargo("kani --help")).unwrap_or_default();
    if help.contains("--harness-timeout") {
        let timeout = format!("{limit}s");
        kani = kani.args(["-Z", "unstable-options", "--harness-timeout", &timeout]);
    }
    // A shard is chosen before anything is compiled; without a choice Kani finds every harness itself.
    if count > 1 {
        let names = chosen.iter().flat_map(|name| ["--harness", *name]);
        kani = kani.arg("--exact").args(names);
    }
    let (success, text) = process::tee(kani, is_summary)?;
    let figure = judge(&text, &chosen, limit)?;
    ensure!(success, "Kani did not end with 0");
    Ok(figure)
}

/// Whether a line is worth printing: Kani prints four for each of some thousand checks, and its model
/// checker's progress.
fn is_summary(line: &str) -> bool {
    pattern(r"^(Kani|Checking| \*\*|VERIF|Verif|Complete)|error").is_match(line)
}

/// What Kani printed about one harness.
#[derive(Debug)]
struct Harness<'a> {
    name: &'a str,
    successful: bool,
    /// Covers that were reached, and all.
    covers: (u32, u32),
    /// The descriptions of the covers that were not.
    unreached: Vec<&'a str>,
    seconds: f64,
}

impl Harness<'_> {
    /// What is wrong with it, or nothing.
    fn complaint(&self, limit: f64) -> Option<String> {
        let Self { name, seconds, .. } = self;
        match self.covers {
            _ if !self.successful => Some(format!("{name} is not proven")),
            (_, 0) => Some(format!("{name} has no cover: it may prove nothing")),
            (some, all) if some < all => Some(format!(
                "{name} has {} cover(s) that cannot be reached, {}: it proves less than it says",
                all - some,
                self.unreached.join(", ")
            )),
            _ if *seconds > limit => Some(format!("{name} took {seconds:.0} s of {limit}")),
            _ => None,
        }
    }
}

/// The harnesses in the order Kani checked them.
fn harnesses(text: &str) -> Vec<Harness<'_>> {
    let sections = text.split("Checking harness ").skip(1);
    sections.filter_map(harness).collect()
}

fn harness(section: &str) -> Option<Harness<'_>> {
    let (name, text) = section.split_once("...")?;
    let covers = pattern(r"(?m)^ \*\* (\d+) of (\d+) cover properties satisfied");
    let covers = covers.captures(text);
    let covers = covers.and_then(|found| found[1].parse().ok().zip(found[2].parse().ok()));
    let seconds = pattern(r"(?m)^Verification Time: ([\d.]+)s").captures(text);
    // An assertion that cannot be reached is no failure.
    let unreached = r#"\.cover\.\d+\n\t - Status: U\w+\n\t - Description: "(.*)""#;
    let unreached = pattern(unreached);
    let unreached = unreached
        .captures_iter(text)
        .filter_map(|found| found.get(1));
    Some(Harness {
        name,
        successful: text.contains("\nVERIFICATION:- SUCCESSFUL\n"),
        covers: covers.unwrap_or_default(),
        unreached: unreached.map(|found| found.as_str()).collect(),
        seconds: seconds
            .and_then(|found| found[1].parse().ok())
            .unwrap_or(0.0),
    })
}

/// Prints each harness; the closing figure of a run in which the `chosen` ones were proven.
fn judge(text: &str, chosen: &[&str], limit: f64) -> Result<String> {
    let harnesses = harnesses(text);
    for Harness {
        name,
        covers: (some, all),
        seconds,
        ..
    } in &harnesses
    {
        println!("  {seconds:7.1} s  {some} of {all} covers  {name}");
    }
    let complaints = harnesses
        .iter()
        .filter_map(|harness| harness.complaint(limit));
    let mut complaints: Vec<_> = complaints.collect();
    let checked = |name: &&&str| harnesses.iter().any(|harness| harness.name == **name);
    let unchecked = chosen.iter().filter(|name| !checked(name));
    complaints.extend(unchecked.map(|name| format!("{name} was not checked")));
    ensure!(complaints.is_empty(), complaints.join("; "));
    // After the last harness: a run that was cut short has no such line.
    let complete = text
        .lines()
        .rev()
        .find_map(|line| line.strip_prefix("Complete - "));
    let by_time = |one: &&Harness, other: &&Harness| one.seconds.total_cmp(&other.seconds);
    let slowest = harnesses.iter().max_by(by_time);
    let (complete, Harness { name, seconds, .. }) =
        complete.zip(slowest).context("Kani did not complete")?;
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

    #[test]
    fn good_run_ends_with_its_longest_harness() {
        let figure = "2 successfully verified harnesses, 0 failures, 2 total. 6 s in all; the \
                      longest, units::shortest_way_arrives::harness::proof, took 5 s.";
        assert_eq!(judge(GOOD, &NAMES, 300.0).unwrap(), figure);
        let printed: Vec<_> = GOOD.lines().filter(|line| is_summary(line)).collect();
        assert!(printed.contains(&" ** 3 of 3 cover properties satisfied"));
        assert!(
            !printed
                .iter()
                .any(|line| line.contains("Status") || line.contains("SAT"))
        );
    }

    #[test]
    fn harness_that_proves_less_than_it_says_is_named() {
        // What replaces what in the good run, and the complaint.
        let cases = "\
2 of 2 cover => 1 of 2 cover => wrap::harness::proof has 1 cover(s)
3 of 3 cover => 2 of 3 cover => has 1 cover(s) that cannot be reached, across a full turn:
 ** 2 of 2 cover =>  => wrap::harness::proof has no cover
VERIFICATION:- SUCCESSFUL => VERIFICATION:- FAILED => arrives::harness::proof is not proven
1.4145411s => 300.5s => wrap::harness::proof took 300 s of 300
span_survives => x => span_survives_the_wrap::harness::proof was not
Complete -  => error: => Kani did not complete";
        for case in cases.lines() {
            let [from, to, complaint] = case.split(" => ").collect::<Vec<_>>()[..] else {
                panic!("{case}");
            };
            let mut text = GOOD.replacen(from, to, 1);
            if complaint.contains("across") {
                text = text.replacen("SATISFIED", "UNREACHABLE", 1);
            }
            let error = judge(&text, &NAMES, 300.0).unwrap_err().to_string();
            assert!(error.contains(complaint), "{error}");
        }
        let cut = &GOOD[..GOOD.find("SUMMARY").unwrap()];
        let error = judge(cut, &NAMES, 300.0).unwrap_err().to_string();
        assert!(
            error.contains("arrives::harness::proof is not proven"),
            "{error}"
        );
    }
}

//! Kani over the theorems: what it prints, harness by harness, and what of that is a failure.
//!
//! Kani calls a harness successful whose covers cannot be reached; here that is a failure, for such a
//! harness proves nothing. So is one that takes longer than the budget allows, and one that was
//! declared but not checked.

use crate::budget::Budget;
use crate::error::{Context, Kind, Result, ensure, fail};
use crate::process::{self, captures, pattern};
use crate::workspace::Workspace;

/// Why Kani is not run, and how it would be.
const MISSING: &str = "Kani is not installed (`cargo install --locked kani-verifier && cargo kani \
    setup`); the same properties ran exhaustively or sampled among the unit tests";

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
    let Some(version) = process::output(workspace.cargo("kani --version")) else {
        return fail(Kind::MissingProgram, MISSING);
    };
    let limit = Budget::read(workspace)?;
    let limit = limit.value("kani.at_most.harness_seconds")?.as_f64();
    let limit = limit.context("harness_seconds is no number")?;
    let list = "run --quiet --package proofs --example theorems -- --harnesses";
    let declared = workspace.cargo(list).read()?;
    let Shard(number, count) = shard;
    let chosen: Vec<_> = declared.lines().skip(number).step_by(count).collect();
    ensure!(!chosen.is_empty(), "fewer harnesses than shards");
    let _in_proofs = workspace.sh.push_dir("proofs");
    // From 0.59 on Kani can end a harness itself; without that, what takes too long fails afterwards.
    let help = process::output(workspace.cargo("kani --help")).unwrap_or_default();
    let timeout = format!("kani -Z unstable-options --harness-timeout {limit}s");
    let can_end = help.contains("--harness-timeout");
    let mut kani = workspace.cargo(if can_end { &timeout } else { "kani" });
    // A shard is chosen before anything is compiled; without a choice Kani finds every harness itself.
    if count > 1 {
        let names = chosen.iter().flat_map(|name| ["--harness", *name]);
        kani = kani.arg("--exact").args(names);
    }
    let (success, text) = process::tee_lines(kani, is_summary)?;
    let figure = judge(&text, &chosen, limit)?;
    ensure!(success, "Kani did not end with 0");
    Ok(format!("{version}: {figure}"))
}

/// Whether a line is worth printing: Kani prints four for each of some thousand checks, and its model
/// checker's progress.
fn is_summary(line: &str) -> bool {
    pattern(r"^(Kani|Checking| \*\*|VERIF|Verif|Complete)|error").is_match(line)
}

/// A harness that Kani checked: its name, its seconds, and what is wrong with it, if anything.
type Harness<'a> = (&'a str, f64, Option<String>);

/// Prints and judges what Kani printed about one harness.
fn harness(section: &str, limit: f64) -> Option<Harness<'_>> {
    let (name, text) = section.split_once("...")?;
    let covers = pattern(r"(?m)^ \*\* (\d+) of (\d+) cover properties satisfied").captures(text);
    let covers = covers.and_then(|found| found[1].parse().ok().zip(found[2].parse().ok()));
    let (some, all): (u32, u32) = covers.unwrap_or_default();
    let seconds = captures(text, r"(?m)^Verification Time: ([\d.]+)s");
    let seconds = seconds.first().and_then(|seconds| seconds.parse().ok());
    let seconds: f64 = seconds.unwrap_or(0.0);
    println!("  {seconds:7.1} s  {some} of {all} covers  {name}");
    // An assertion that cannot be reached is no failure.
    let unreached = r#"\.cover\.\d+\n\t - Status: U\w+\n\t - Description: "(.*)""#;
    let unreached = captures(text, unreached).join(", ");
    let complaint = if !text.contains("\nVERIFICATION:- SUCCESSFUL\n") {
        "is not proven".into()
    } else if all == 0 {
        "has no cover: it may prove nothing".into()
    } else if some < all {
        let missing = format!("has {} cover(s) that cannot be reached", all - some);
        format!("{missing}, {unreached}: it proves less than it says")
    } else if seconds > limit {
        format!("took {seconds:.0} s of {limit}")
    } else {
        return Some((name, seconds, None));
    };
    Some((name, seconds, Some(format!("{name} {complaint}"))))
}

/// Prints each harness; the closing figure of a run in which the `chosen` ones were proven.
fn judge(text: &str, chosen: &[&str], limit: f64) -> Result<String> {
    let sections = text.split("Checking harness ").skip(1);
    let harnesses = sections.filter_map(|section| harness(section, limit));
    let harnesses: Vec<_> = harnesses.collect();
    let complaints = harnesses.iter().filter_map(|harness| harness.2.clone());
    let checked = |name: &str| harnesses.iter().any(|harness| harness.0 == name);
    let unchecked = chosen.iter().filter(|name| !checked(name));
    let complaints = complaints.chain(unchecked.map(|name| format!("{name} was not checked")));
    let complaints = complaints.collect::<Vec<_>>().join("; ");
    ensure!(complaints.is_empty(), complaints);
    // After the last harness: a run that was cut short has no such line.
    let complete = captures(text, r"(?m)^Complete - (.*)$").pop();
    let slowest = harnesses.iter().max_by(|one, two| one.1.total_cmp(&two.1));
    let both = complete.zip(slowest);
    let (complete, (name, seconds, _)) = both.context("Kani did not complete")?;
    let sum: f64 = harnesses.iter().map(|harness| harness.1).sum();
    let longest = format!("the longest, {name}, took {seconds:.0} s.");
    Ok(format!("{complete} {sum:.0} s in all; {longest}"))
}

/// What Kani 0.65 prints, without the checks and most of what its solver says.
#[cfg(test)]
const GOOD: &str = "\
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
 ** 3 of 3 cover properties satisfied
VERIFICATION:- SUCCESSFUL
Verification Time: 4.7749815s
Checking harness units::span_survives_the_wrap::harness::proof...

SUMMARY:
 ** 2 of 2 cover properties satisfied
VERIFICATION:- SUCCESSFUL
Verification Time: 1.4145411s
Manual Harness Summary:
Complete - 2 successfully verified harnesses, 0 failures, 2 total.
";

#[test]
fn harness_that_proves_less_than_it_says_is_named() {
    let names = ["shortest_way_arrives", "span_survives_the_wrap"];
    let names = names.map(|name| format!("units::{name}::harness::proof"));
    let judge = |text: &str| judge(text, &[&names[0], &names[1]], 300.0);
    let figure = "2 successfully verified harnesses, 0 failures, 2 total. 6 s in all; the longest, \
                  units::shortest_way_arrives::harness::proof, took 5 s.";
    assert_eq!(judge(GOOD).unwrap(), figure);
    let printed: Vec<_> = GOOD.lines().filter(|line| is_summary(line)).collect();
    assert!(printed.contains(&" ** 3 of 3 cover properties satisfied"));
    assert!(!printed.concat().contains("Status") && !printed.concat().contains("SAT"));
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
        let parts: Vec<_> = case.split(" => ").collect();
        let (from, to, complaint) = (parts[0], parts[1], parts[2]);
        let mut text = GOOD.replacen(from, to, 1);
        if complaint.contains("across") {
            text = text.replacen("SATISFIED", "UNREACHABLE", 1);
        }
        let error = judge(&text).unwrap_err().to_string();
        assert!(error.contains(complaint), "{error}");
    }
    let cut = &GOOD[..GOOD.find("SUMMARY").unwrap()];
    let error = judge(cut).unwrap_err().to_string();
    assert!(error.contains("arrives::harness::proof is not proven"));
}

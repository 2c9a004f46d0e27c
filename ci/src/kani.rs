//! Kani over the theorems: what it prints, harness by harness, and what of that is a failure.
//!
//! Kani calls a harness successful whose covers cannot be reached; here that is a failure, for such a
//! harness proves nothing. So is one that takes longer than the budget allows, and one that was
//! declared but not checked.

use std::collections::BTreeSet;

use clap::Args;

use crate::budget::Budget;
use crate::error::{Context, Kind, Result, ensure, fail};
use crate::evidence::{self, Sources, Verdict, Verdicts};
use crate::process::{self, captures, pattern};
use crate::workspace::Workspace;

/// Why Kani is not run, and how it would be.
const MISSING: &str =
    "Kani is not installed (`cargo install --locked kani-verifier && cargo kani setup`)";

/// Which harnesses to prove.
#[derive(Args, Default)]
pub struct Choice {
    /// Only every N-th harness, K from 0
    #[arg(long, value_name = "K/N", default_value = "0/1", value_parser = parse_shard)]
    shard: Option<(usize, usize)>,
    /// Only harnesses with this in their name
    #[arg(long, value_name = "TEXT", default_value = "")]
    only: String,
    /// Only those that proofs/evidence.toml has no verdict on for the present sources; theirs are
    /// written there
    #[arg(long)]
    evidence: bool,
}

/// `K/N`: every N-th harness, K from 0. Neighbours cost alike, so each machine of N gets one of them.
fn parse_shard(text: &str) -> Result<(usize, usize)> {
    let numbers = text.split_once('/').context("not K/N")?;
    let (number, count) = (numbers.0.parse()?, numbers.1.parse()?);
    ensure!(number < count, "K is not below N");
    Ok((number, count))
}

/// What `proofs` declares, as its example `theorems` lists it: a table, or with `--harnesses` those, one a line.
pub fn declared(workspace: &Workspace, arguments: &[&str]) -> Result<String> {
    let list = workspace.cargo("run --quiet --release --package proofs --example theorems --");
    Ok(list.args(arguments).read()?)
}

/// The installed Kani.
fn version(workspace: &Workspace) -> Option<String> {
    process::output(workspace.cargo("kani --version"))
}

/// Proves every harness where Kani is installed; reads the evidence where it is not.
pub fn gate(workspace: &Workspace) -> Result<String> {
    if version(workspace).is_some() {
        return prove(workspace, &Choice::default());
    }
    let declared = declared(workspace, &["--harnesses"])?;
    let declared: Vec<_> = declared.lines().collect();
    let (figure, missing) = evidence::judge(&declared, &declared, &evidence::read(workspace)?)?;
    if missing.is_empty() {
        return Ok(figure);
    }
    let missing = missing.join(", ");
    let reason = format!("{figure}; no verdict on the present sources of {missing}");
    fail(Kind::Skipped, reason)
}

/// Proves the chosen harnesses; returns the closing figure. An error names the harnesses that fail, take
/// too long or come to no verdict, and those with a cover that cannot be reached.
pub fn prove(workspace: &Workspace, choice: &Choice) -> Result<String> {
    let missing = || fail(Kind::MissingProgram, MISSING);
    let version = version(workspace).map_or_else(missing, Ok)?;
    let limit = Budget::read(workspace)?;
    let limit = limit.value("kani.at_most.harness_seconds")?.as_f64();
    let limit = limit.context("harness_seconds is no number")?;
    let declared = declared(workspace, &["--harnesses"])?;
    let declared: Vec<_> = declared.lines().collect();
    let sources = Sources::read(workspace)?;
    let mut known = Verdicts::new();
    if choice.evidence {
        known = evidence::read(workspace)?;
    }
    let (number, count) = choice.shard.unwrap_or((0, 1));
    let chosen = declared.iter().skip(number).step_by(count).copied();
    let chosen = chosen.filter(|name| name.contains(&choice.only) && !known.contains_key(*name));
    let chosen: Vec<_> = chosen.collect();
    ensure!(!chosen.is_empty(), "no harness is left to prove");
    let pushed = workspace.sh.push_dir("proofs");
    // From 0.59 on Kani can end a harness itself; without that, what takes too long fails afterwards.
    let help = process::output(workspace.cargo("kani --help")).unwrap_or_default();
    let timeout = format!("kani -Z unstable-options --harness-timeout {limit}s");
    let can_end = help.contains("--harness-timeout");
    let mut kani = workspace.cargo(if can_end { &timeout } else { "kani" });
    // A choice is made before anything is compiled; without one Kani finds every harness itself.
    if chosen.len() < declared.len() {
        let names = chosen.iter().flat_map(|name| ["--harness", *name]);
        kani = kani.arg("--exact").args(names);
    }
    let (_, text) = process::tee_lines(kani, is_summary)?;
    drop(pushed);
    let found = verdicts(&text, &version, limit);
    if choice.evidence {
        known.extend(found.clone());
        known.retain(|name, _| declared.contains(&name.as_str()));
        evidence::write(workspace, &known, &sources)?;
    }
    known.extend(found);
    let (figure, missing) = evidence::judge(&chosen, &declared, &known)?;
    ensure!(missing.is_empty(), "no verdict on {}", missing.join(", "));
    Ok(figure)
}

/// Whether a line is worth printing: Kani prints four for each of some thousand checks, and its model
/// checker's progress.
fn is_summary(line: &str) -> bool {
    pattern(r"^(Kani|Checking| \*\*|VERIF|Verif|Complete)|error").is_match(line)
}

/// What Kani printed as verdicts.
fn verdicts(text: &str, version: &str, limit: f64) -> Verdicts {
    let sections = text.split("Checking harness ").skip(1);
    let verdicts = sections.filter_map(|section| verdict(section, version, limit));
    verdicts.collect()
}

/// Prints and judges what Kani printed about one harness; nothing where it came to no verdict.
fn verdict(section: &str, version: &str, limit: f64) -> Option<(String, Verdict)> {
    let (name, text) = section.split_once("...")?;
    let covers = pattern(r"(?m)^ \*\* (\d+) of (\d+) cover properties satisfied").captures(text);
    let covers = covers.and_then(|found| found[1].parse().ok().zip(found[2].parse().ok()));
    let (some, all): (u32, u32) = covers.unwrap_or_default();
    // Out of memory or of time, or cut short: no time is printed.
    let seconds = captures(text, r"(?m)^Verification Time: ([\d.]+)s");
    let seconds: f64 = seconds.first()?.parse().ok()?;
    println!("  {seconds:7.1} s  {some} of {all} covers  {name}");
    let unreached = r#"\.cover\.\d+\n\t - Status: U\w+\n\t - Description: "(.*)""#;
    let unreached = captures(text, unreached).join(", ");
    let finding = if !text.contains("\nVERIFICATION:- SUCCESSFUL\n") {
        "is not proven".into()
    } else if all == 0 {
        "has no cover: it may prove nothing".into()
    } else if some < all {
        let missing = format!("has {} cover(s) that cannot be reached", all - some);
        format!("{missing}, {unreached}: it proves less than it says")
    } else if seconds > limit {
        format!("took {seconds:.0} s of {limit}")
    } else {
        String::new()
    };
    let cbmc = captures(text, r"CBMC version (\S+)").concat();
    // Checks that the compiler adds, of a sum or an index, are of class `assertion`, too; so are those of core.
    let assertion = |status: &str| {
        let head = format!(r"\.assertion\.\d+\n\t - Status: {status}\n\t - Description: ");
        let ours = r#""(assertion failed: .*"\n\t - Location: (?:\S*proofs/)?src/\S+) in "#;
        captures(text, &(head + ours)).into_iter()
    };
    let reached: BTreeSet<_> = assertion("SUCCESS").collect();
    let unreached = assertion("UNREACHABLE").filter(|one| !reached.contains(one));
    let unreached = unreached
        .map(|one| one.replace("\"\n\t - Location:", " at"))
        .collect();
    let verdict = Verdict {
        finding,
        unreached,
        covers: [some, all],
        seconds,
        tools: format!("{}, CBMC {cbmc}", version.trim()),
        sources: String::new(),
    };
    Some((name.to_owned(), verdict))
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

Check 10: units::shortest_way_arrives.assertion.1
\t - Status: SUCCESS
\t - Description: \"assertion failed: near == far\"
\t - Location: src/units.rs:20:9 in function units::shortest_way_arrives

Check 11: units::shortest_way_arrives.assertion.2
\t - Status: UNREACHABLE
\t - Description: \"attempt to add with overflow\"
\t - Location: src/units.rs:21:9 in function units::shortest_way_arrives

Check 12: fw_core::types::f.assertion.1
\t - Status: UNREACHABLE
\t - Description: \"assertion failed: true\"
\t - Location: ../fw-core/src/types.rs:21:9 in function fw_core::types::f

SUMMARY:
 ** 3 of 3 cover properties satisfied
VERIFICATION:- SUCCESSFUL
Verification Time: 4.7749815s
Checking harness units::span_survives_the_wrap::harness::proof...
CBMC version 6.7

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
    let judge = |text: &str| {
        let verdicts = verdicts(text, "Kani 1", 300.0);
        let names = [&*names[0], &names[1]];
        let (figure, missing) = evidence::judge(&names, &names, &verdicts)?;
        ensure!(missing.is_empty(), "no verdict on {}", missing.concat());
        Ok(figure)
    };
    let figure = "Kani 1, CBMC 6.6.0 and Kani 1, CBMC 6.7: 2 of 2 harnesses proven, 5 covers, 6 s, the longest \
                  units::shortest_way_arrives::harness::proof, 5 s";
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
Status: SUCCESS => Status: UNREACHABLE => assertion failed: near == far at src/units.rs:20:9 is never reached
1.4145411s => 300.5s => wrap::harness::proof took 300 s of 300
span_survives => x => no verdict on units::span_survives_the_wrap::harness::proof";
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
    // Out of time or of memory.
    let cut = GOOD.replace("Verification Time: 4", "CBMC failed");
    let error = judge(&cut).unwrap_err().to_string();
    assert_eq!(error, format!("no verdict on {}", names[0]));
}

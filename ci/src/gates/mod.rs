//! The gates: what a change must pass, in order, with a table at the end.

mod firmware;
mod modules;
mod proofs;
mod source;
mod structure;
mod tests;

use std::time::Instant;

use clap::Args;

use crate::budget::{Budget, Report};
use crate::error::{bail, missing_program, Failure, Result};
use crate::session::Session;
use crate::trace;

/// How a gate ended where it did not fail.
pub enum Outcome {
    /// With the figure worth a column of the table.
    Passed(String),
    /// It could not be decided here, and why. Never counts as passed.
    Skipped(String),
}

use Outcome::{Passed, Skipped};

/// The command that runs a gate.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
enum When {
    /// `test`, also with `--quick`.
    Quick,
    /// `test`.
    Change,
    /// `night`.
    Night,
}

use When::{Change, Night, Quick};

struct Gate {
    name: &'static str,
    when: When,
    about: &'static str,
    run: fn(&Session) -> Result<Outcome>,
}

const fn gate(
    name: &'static str,
    when: When,
    about: &'static str,
    run: fn(&Session) -> Result<Outcome>,
) -> Gate {
    Gate {
        name,
        when,
        about,
        run,
    }
}

/// Cheap and telling ones first.
const GATES: [Gate; 28] = [
    gate("setup", Quick, "a toolchain for the robot", setup),
    gate("fmt", Quick, "formatted source", source::fmt),
    gate("hygiene", Quick, "unsafe code, files", structure::hygiene),
    gate("modules", Quick, "dead files, cycles", modules::gate),
    gate("depend", Quick, "dependency arrows", structure::arrows),
    gate("size", Quick, "lines and words", structure::size),
    gate("trace", Quick, "met and checked", requirements),
    gate("vectors", Quick, "as generated", source::vectors),
    gate("clippy", Quick, "lints", source::clippy),
    gate("docs", Change, "rustdoc", source::docs),
    gate("unit", Quick, "unit tests, properties", tests::unit),
    gate("floors", Quick, "count of theorems", proofs::floors),
    gate("msrv", Change, "oldest compiler", source::msrv),
    gate("firmware", Quick, "flash and RAM", firmware::budget),
    gate("elf", Quick, "symbols, vectors", firmware::contents),
    gate("stack", Quick, "worst stack depth", firmware::stack),
    gate(
        "reproducible",
        Change,
        "same bytes elsewhere",
        firmware::reproducible,
    ),
    gate("defects", Change, "sample of defects", proofs::defects),
    gate("mutants", Change, "mutants of the change", proofs::mutants),
    gate("loop", Change, "firmware in the loop", tests::in_the_loop),
    gate("demo", Change, "demo within its bars", tests::demo),
    gate("figures", Change, "figures within bars", tests::figures),
    gate("kani", Change, "theorems proven", proofs::kani),
    gate("supply", Change, "licences and sources", source::supply),
    gate("fuzz", Night, "fuzz targets", proofs::fuzz),
    gate(
        "coverage",
        Night,
        "regions that tests run",
        proofs::coverage,
    ),
    gate(
        "all-defects",
        Night,
        "every seeded defect",
        proofs::all_defects,
    ),
    gate(
        "all-mutants",
        Night,
        "every mutant of the core",
        proofs::all_mutants,
    ),
];

/// Which gates to run.
#[derive(Args, Default)]
pub struct Choice {
    /// Only these gates
    #[arg(long, value_name = "GATE", value_delimiter = ',')]
    pub only: Vec<String>,
    /// The gates that may be SKIPPED; any other that is fails the run
    #[arg(long, value_name = "GATE", value_delimiter = ',')]
    pub may_skip: Option<Vec<String>>,
}

impl Choice {
    /// Every name must be a gate's.
    fn check(&self) -> Result<()> {
        let mut names = self.only.iter().chain(self.may_skip.iter().flatten());
        let unknown = names.find(|name| GATES.iter().all(|gate| gate.name != **name));
        if let Some(unknown) = unknown {
            let all = GATES.each_ref().map(|gate| gate.name).join(", ");
            bail!(Failure::Usage(format!("{unknown}: the gates are {all}")));
        }
        Ok(())
    }

    fn may_skip(&self, gate: &str) -> bool {
        let named = |names: &Vec<String>| names.iter().any(|name| name == gate);
        self.may_skip.as_ref().is_none_or(named)
    }
}

const PASSED: &str = "passed";
const FAILED: &str = "FAILED";
const SKIPPED: &str = "SKIPPED";

struct Row {
    name: &'static str,
    result: &'static str,
    figure: String,
    seconds: f64,
}

/// `cargo xtask test`, see [`run`].
pub fn test(session: &Session, quick: bool, choice: &Choice) -> Result<bool> {
    run(session, choice, |when| match when {
        Quick => Some(true),
        Change => Some(!quick),
        Night => None,
    })
}

/// `cargo xtask night`, see [`run`].
pub fn night(session: &Session, choice: &Choice) -> Result<bool> {
    run(session, choice, |when| (when == Night).then_some(true))
}

/// Runs the chosen gates, or all that `chosen` takes: `Some(false)` prints the gate as skipped. Prints
/// the table; returns whether none failed.
fn run(session: &Session, choice: &Choice, chosen: impl Fn(When) -> Option<bool>) -> Result<bool> {
    choice.check()?;
    let mut rows = Vec::new();
    for Gate {
        name,
        when,
        about,
        run,
    } in &GATES
    {
        let wanted = if choice.only.is_empty() {
            chosen(*when)
        } else {
            choice.only.iter().any(|only| only == name).then_some(true)
        };
        let Some(run_it) = wanted else { continue };
        let start = Instant::now();
        let outcome = if run_it {
            println!("\n== {name}: {about}");
            run(session)
        } else {
            Ok(Skipped("left out by --quick".into()))
        };
        let (result, figure) = match outcome {
            Ok(Passed(figure)) => (PASSED, figure),
            Ok(Skipped(reason)) => (SKIPPED, reason),
            Err(error) => match missing_program(&error) {
                Some(reason) => (SKIPPED, reason.to_owned()),
                None => (FAILED, format!("{error:#}")),
            },
        };
        if result == FAILED {
            println!("{name}: FAILED: {figure}");
        }
        let seconds = start.elapsed().as_secs_f64();
        rows.push(Row {
            name,
            result,
            figure,
            seconds,
        });
    }
    Ok(summarise(&rows, choice))
}

/// Prints the table and, last, the line that sums it up; returns whether no gate failed, and none was
/// SKIPPED that may not be.
fn summarise(rows: &[Row], choice: &Choice) -> bool {
    println!("\n{:<13} {:<8} {:>7}  figure", "gate", "result", "seconds");
    for Row {
        name,
        result,
        figure,
        seconds,
    } in rows
    {
        println!(
            "{name:<13} {result:<8} {seconds:>7.1}  {}",
            one_line(figure)
        );
    }
    let count = |result: &str| rows.iter().filter(|row| row.result == result).count();
    if let Some(Row { name, .. }) = rows.iter().find(|row| row.result == FAILED) {
        println!("\n`cargo xtask test --only {name}` runs that gate alone");
    }
    let skipped = rows
        .iter()
        .filter(|row| row.result == SKIPPED)
        .map(|row| row.name);
    let missing: Vec<_> = skipped.filter(|name| !choice.may_skip(name)).collect();
    if !missing.is_empty() {
        println!("\nmay not be skipped here: {}", missing.join(", "));
    }
    let (passed, failed, skipped) = (count(PASSED), count(FAILED), count(SKIPPED));
    println!("\n{passed} passed, {failed} failed, {skipped} skipped");
    failed == 0 && missing.is_empty()
}

fn one_line(text: &str) -> String {
    const WIDTH: usize = 160;
    let line = text.split_whitespace().collect::<Vec<_>>().join(" ");
    match line.char_indices().nth(WIDTH) {
        Some((end, _)) => format!("{}…", &line[..end]),
        None => line,
    }
}

/// Prints every finding; passed with `figure` where there is none.
fn passed_without(findings: &[String], figure: String) -> Result<Outcome> {
    for finding in findings {
        println!("  {finding}");
    }
    match findings.first() {
        None => Ok(Passed(figure)),
        Some(first) => bail!("{} finding(s), the first: {first}", findings.len()),
    }
}

/// Compares figures with every bar of `name` in the budget.
fn check_bars(session: &Session, name: &str, figures: serde_json::Value) -> Result<usize> {
    Budget::read(&session.workspace)?.check(name, &Report(figures))
}

fn setup(session: &Session) -> Result<Outcome> {
    let provider = session.toolchain()?.provider;
    Ok(Passed(format!("{provider:?}")))
}

/// Every requirement is met and checked, and every citation is of one.
fn requirements(session: &Session) -> Result<Outcome> {
    let all = trace::trace(&session.workspace)?;
    let code: usize = all.values().map(|one| one.code.len()).sum();
    let checks: usize = all.values().map(|one| one.checks.len()).sum();
    Ok(Passed(format!(
        "{} requirements, cited {code} times above code and {checks} times above what checks it",
        all.len()
    )))
}

#[cfg(test)]
mod unit_tests {
    use super::*;

    #[test]
    fn figure_stays_on_one_line() {
        assert_eq!(one_line("a\n  b"), "a b");
        assert_eq!(one_line(&"ä".repeat(500)).chars().count(), 161);
    }

    #[test]
    fn skipped_gate_fails_unless_it_may_be_skipped() {
        let row = |name, result| {
            let (figure, seconds) = (String::new(), 0.0);
            Row {
                name,
                result,
                figure,
                seconds,
            }
        };
        let rows = [row("fmt", PASSED), row("kani", SKIPPED)];
        let good = |may_skip: Option<&str>| {
            let may_skip = may_skip.map(|name| vec![name.to_owned()]);
            let choice = Choice {
                may_skip,
                only: Vec::new(),
            };
            choice.check().unwrap();
            summarise(&rows, &choice)
        };
        assert!(good(None));
        assert!(good(Some("kani")));
        assert!(!good(Some("fuzz")));
        assert!(!summarise(&[row("fmt", FAILED)], &Choice::default()));
        let only = vec!["kanu".into()];
        let unknown = Choice {
            only,
            may_skip: None,
        }
        .check()
        .unwrap_err();
        let expected = "kanu: the gates are setup, fmt";
        assert!(unknown.to_string().starts_with(expected), "{unknown}");
    }

    #[test]
    fn gate_names_are_unique() {
        let mut names = GATES.each_ref().map(|gate| gate.name).to_vec();
        names.sort_unstable();
        names.dedup();
        assert_eq!(names.len(), GATES.len());
    }
}

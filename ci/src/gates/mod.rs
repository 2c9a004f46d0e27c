//! The gates: what a change must pass, in order, with a table at the end.

mod beside;
mod firmware;
mod modules;
mod proofs;
mod source;
mod structure;
mod tests;

use std::time::Instant;

use clap::Args;

use self::beside::Beside;
use crate::error::{Failure, Kind, Result, bail, fail};
use crate::kani;
use crate::process;
use crate::session::Session;
use crate::trace::{Requirement, Trace};
use crate::{defects, fuzz};

pub use proofs::mutants;
pub use tests::coverage;

/// The commands that run a gate.
#[derive(Clone, Copy, PartialEq, Eq)]
pub enum When {
    /// `test`, also with `--quick`.
    Quick,
    /// `test`.
    Change,
    /// `night`.
    Night,
}

use When::{Change, Night, Quick};

/// A gate's name, the command that runs it, and what returns its figure.
type Gate = (&'static str, When, fn(&Session) -> Result<String>);

/// Cheap ones first; `docs/gates.md` says what each checks.
const GATES: [Gate; 40] = [
    ("setup", Quick, setup),
    ("fmt", Quick, source::fmt),
    ("hygiene", Quick, structure::hygiene),
    ("modules", Quick, modules::gate),
    ("arrows", Quick, structure::arrows),
    ("size", Quick, structure::size),
    ("trace", Quick, requirements),
    ("vectors", Quick, source::vectors),
    ("firmware", Quick, firmware::budget),
    ("elf", Quick, firmware::contents),
    ("reproducible", Change, firmware::reproducible),
    ("msrv", Change, source::msrv),
    ("clippy", Quick, source::clippy),
    ("docs", Change, source::docs),
    ("unit", Quick, tests::unit),
    ("exhaustive", Change, tests::exhaustive),
    ("floors", Quick, proofs::floors),
    ("stack", Quick, firmware::stack),
    ("defects", Change, proofs::defects),
    ("mutants", Change, proofs::mutants_of_the_change),
    ("loop", Change, |session| tests::in_the_loop(session, None)),
    ("page", Change, tests::page),
    ("kani", Change, |session| kani::gate(session)),
    ("qemu", Change, tests::qemu),
    ("demo", Change, |session| tests::demo(session, "demo")),
    ("tour", Change, |session| tests::demo(session, "tour")),
    ("recording", Change, |session| {
        tests::by_python(session, "recording/read.py")
    }),
    ("ros2", Change, |session| {
        tests::by_python(session, "ros2/bridge.py")
    }),
    ("figures", Change, tests::figures),
    ("seeds", Night, |session| {
        tests::in_the_loop(session, Some(process::days()?))
    }),
    ("fuzz", Night, |session| fuzz::run(session, None, None)),
    ("rooms", Night, tests::rooms),
    ("supply", Night, source::supply),
    ("packages", Night, tests::packages),
    ("coverage", Night, tests::coverage),
    ("all-defects", Night, |session| defects::run(session, &[])),
    ("all-mutants", Night, proofs::all_mutants),
    ("firmware-mutants", Night, proofs::firmware_mutants),
    ("host-link-mutants", Night, proofs::host_link_mutants),
    ("citations", Night, proofs::citations),
];

/// Which gates to run.
#[derive(Args, Default)]
pub struct Choice {
    /// Only these gates
    #[arg(long, value_name = "GATE", value_delimiter = ',', value_parser = GATES.map(|gate| gate.0))]
    pub only: Vec<String>,
    /// The gates that may be SKIPPED; any other that is fails the run
    #[arg(long, value_name = "GATE", value_delimiter = ',', value_parser = GATES.map(|gate| gate.0))]
    pub may_skip: Option<Vec<String>>,
}

impl Choice {
    fn may_skip(&self, gate: &str) -> bool {
        let named = |names: &Vec<String>| names.iter().any(|name| name == gate);
        self.may_skip.as_ref().is_none_or(named)
    }
}

const PASSED: &str = "passed";
const FAILED: &str = "FAILED";
const SKIPPED: &str = "SKIPPED";

struct Row(&'static str, &'static str, String);

/// Runs the gates of these commands, or the chosen ones; `quick` prints the slow ones as skipped.
/// Prints the table; returns whether none failed.
pub fn run(session: &Session, choice: &Choice, of: &[When], quick: bool) -> bool {
    let all = choice.only.is_empty();
    let is_beside = |name| all && !quick && of.contains(&Change) && beside::runs(name);
    let (mut rows, mut other) = (Vec::new(), None);
    for (name, when, gate) in GATES {
        let named = choice.only.iter().any(|only| only == name);
        let runs = if all { of.contains(&when) } else { named };
        if !runs {
            continue;
        }
        if is_beside(name) {
            other.get_or_insert_with(|| Beside::start(session));
            continue;
        }
        let start = Instant::now();
        let outcome = if named || !quick || when == Quick {
            println!("\n== {name}");
            gate(session)
        } else {
            fail(Kind::Skipped, "left out by --quick")
        };
        rows.push(row(name, outcome, start.elapsed().as_secs_f64()));
    }
    if let Some(other) = other {
        rows.extend(beside::rows(other));
        rows.sort_by_key(|row| GATES.iter().position(|gate| gate.0 == row.0));
    }
    summarise(&rows, choice)
}

/// Prints what a gate came to; its row of the table.
fn row(name: &'static str, outcome: Result<String>, seconds: f64) -> Row {
    let (result, figure) = match outcome {
        Ok(figure) => (PASSED, figure),
        Err(error) => match error.downcast_ref() {
            Some(Failure(Kind::MissingProgram | Kind::Skipped, why)) => (SKIPPED, why.clone()),
            _ => (FAILED, format!("{error:#}")),
        },
    };
    let figure = one_line(&figure);
    println!("{name}: {result}: {figure}");
    Row(name, result, format!("{seconds:>7.1}  {figure}"))
}

/// Prints the table and, last, the line that sums it up; returns whether no gate failed, and none was
/// SKIPPED that may not be.
fn summarise(rows: &[Row], choice: &Choice) -> bool {
    println!("\n{:<13} {:<8} {:>7}  figure", "gate", "result", "seconds");
    for Row(name, result, figure) in rows {
        println!("{name:<13} {result:<8} {figure}");
    }
    let all = |result| rows.iter().filter(move |row| row.1 == result);
    let of = |result| all(result).map(|row| row.0);
    if let Some(name) = of(FAILED).next() {
        println!("\n`cargo xtask test --only {name}` runs that gate alone");
    }
    let missing: Vec<_> = of(SKIPPED).filter(|name| !choice.may_skip(name)).collect();
    if !missing.is_empty() {
        println!("\nmay not be skipped here: {}", missing.join(", "));
    }
    let [passed, failed, skipped] = [PASSED, FAILED, SKIPPED].map(|result| of(result).count());
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
fn passed_without(findings: &[String], figure: String) -> Result<String> {
    for finding in findings {
        println!("  {finding}");
    }
    match findings.first() {
        None => Ok(figure),
        Some(first) => bail!("{} finding(s), the first: {first}", findings.len()),
    }
}

fn setup(session: &Session) -> Result<String> {
    Ok(format!("{:?}", session.toolchain()?.provider))
}

/// Every requirement is met and checked, and every citation is of one.
fn requirements(session: &Session) -> Result<String> {
    let trace = Trace::read(session)?;
    let cited = |of: fn(&Requirement) -> usize| trace.requirements.values().map(of).sum::<usize>();
    let (code, checks) = (cited(|one| one.code.len()), cited(|one| one.checks.len()));
    let figure = format!("requirements, cited {code} times above code, {checks} above checks");
    let figure = format!("{} {figure}", trace.requirements.len());
    passed_without(&trace.findings, figure)
}

#[test]
fn figure_stays_on_one_line() {
    assert_eq!(one_line("a\n  b"), "a b");
    assert_eq!(one_line(&"ä".repeat(500)).chars().count(), 161);
}

#[test]
fn skipped_gate_fails_unless_it_may_be_skipped() {
    let row = |name, result| Row(name, result, String::new());
    let rows = [row("fmt", PASSED), row("kani", SKIPPED)];
    for (may_skip, good) in [(None, true), (Some("kani"), true), (Some("fuzz"), false)] {
        let may_skip = may_skip.map(|name| vec![name.to_owned()]);
        let only = Vec::new();
        let choice = Choice { only, may_skip };
        assert_eq!(summarise(&rows, &choice), good);
    }
    assert!(!summarise(&[row("fmt", FAILED)], &Choice::default()));
}

//! The gates: what a change must pass, in order, with a table at the end.

mod hygiene;
mod machine_code;
mod proofs;
mod source;
mod stack;
mod supply;
mod tests;

pub use hygiene::sources;

use std::path::Path;
use std::time::Instant;

use crate::arm::{Arm, Way};
use crate::error::{Error, Result};
use crate::firmware::{self, Edition, Image};
use crate::numbers::Budget;
use crate::place::Place;

/// How a gate ended where it did not fail.
pub enum Verdict {
    /// With the figure worth a column of the table.
    Passed(String),
    /// It could not be decided here, and why. Never counts as passed.
    Skipped(String),
}

/// [`Verdict::Passed`], shorter.
#[expect(clippy::unnecessary_wraps, reason = "the last word of every gate")]
fn passed(figure: impl Into<String>) -> Result<Verdict> {
    Ok(Verdict::Passed(figure.into()))
}

/// [`Verdict::Skipped`], shorter.
#[expect(clippy::unnecessary_wraps, reason = "the last word of every gate")]
fn skipped(reason: impl Into<String>) -> Result<Verdict> {
    Ok(Verdict::Skipped(reason.into()))
}

/// One gate.
struct Gate {
    name: &'static str,
    about: &'static str,
    /// Left out by `--quick`.
    slow: bool,
    run: fn(&mut Context) -> Result<Verdict>,
}

const fn quick(
    name: &'static str,
    about: &'static str,
    run: fn(&mut Context) -> Result<Verdict>,
) -> Gate {
    Gate {
        name,
        about,
        slow: false,
        run,
    }
}

const fn slow(
    name: &'static str,
    about: &'static str,
    run: fn(&mut Context) -> Result<Verdict>,
) -> Gate {
    Gate {
        name,
        about,
        slow: true,
        run,
    }
}

/// Cheap and telling ones first.
const GATES: [Gate; 22] = [
    quick("setup", "a way to build for the robot's processor", setup),
    quick("fmt", "the source is formatted", source::fmt),
    quick(
        "hygiene",
        "unsafe only in fw-pac, licences, no toolchain file",
        hygiene::hygiene,
    ),
    quick(
        "trace",
        "every requirement has a text, is met and is checked",
        source::requirements,
    ),
    quick(
        "vectors",
        "the test vectors are what their generator calculates",
        source::vectors,
    ),
    quick(
        "clippy",
        "no lint warns; no float arithmetic in fw-core",
        source::clippy,
    ),
    slow("docs", "rustdoc does not warn", source::docs),
    quick(
        "unit",
        "unit tests, properties exhaustive or sampled",
        tests::unit,
    ),
    quick(
        "floors",
        "the number of theorems and harnesses only grows",
        proofs::floors,
    ),
    slow(
        "msrv",
        "fw-core and proofs build with the oldest compiler promised",
        source::msrv,
    ),
    quick(
        "firmware",
        "both release ELFs build within their budgets",
        machine_code::budget,
    ),
    quick(
        "elf",
        "no panic, formatting, soft float, heap, host path, open vector",
        machine_code::contents,
    ),
    quick(
        "stack",
        "the worst the stack can come to fits, computed from the ELF",
        stack::stack,
    ),
    slow(
        "reproducible",
        "the same ELF from another folder",
        machine_code::reproducible,
    ),
    slow(
        "defects",
        "seeded defects still fit the code, and the samples are noticed",
        proofs::defects,
    ),
    slow(
        "mutants",
        "mutants of what changed in fw-core are noticed, as far as a minute goes",
        proofs::mutants,
    ),
    quick(
        "loop",
        "the firmware in the loop on the virtual board",
        tests::in_the_loop,
    ),
    quick("demo", "the demo within its bars", tests::demo),
    slow(
        "figures",
        "the measured figures within their bars",
        tests::figures,
    ),
    slow("kani", "the theorems, proven", proofs::kani),
    slow(
        "fuzz",
        "every fuzz target on its corpus and half a million inputs more",
        proofs::fuzz,
    ),
    slow(
        "supply",
        "licences, bans and sources of the dependencies",
        supply::supply,
    ),
];

/// What the gates share: built once, at the first that needs it.
pub struct Context {
    place: Place,
    forced: Option<Way>,
    arm: Option<Arm>,
    /// By [`Edition`].
    images: [Option<Image>; 2],
}

impl Context {
    fn arm(&mut self) -> Result<&Arm> {
        if self.arm.is_none() {
            self.arm = Some(Arm::find(&self.place, self.forced)?);
        }
        self.arm.as_ref().ok_or_else(no_way)
    }

    /// What would be flashed as this edition.
    fn edition(&mut self, edition: Edition) -> Result<&Image> {
        let slot = edition as usize;
        if self.images[slot].is_none() {
            self.images[slot] = Some(self.built(edition, "")?);
        }
        self.images[slot].as_ref().ok_or_else(no_way)
    }

    fn image(&mut self) -> Result<&Image> {
        self.edition(Edition::Full)
    }

    fn built(&mut self, edition: Edition, features: &str) -> Result<Image> {
        self.arm()?;
        let arm = self.arm.as_ref().ok_or_else(no_way)?;
        firmware::build(&self.place, arm, edition, features)
    }

    /// A build with a `test-…` feature.
    fn built_with(&mut self, feature: &str) -> Result<Image> {
        self.built(Edition::Full, feature)
    }

    fn budget(&self) -> Result<Budget> {
        Budget::parse(&self.place.read("ci/budget.toml")?)
    }

    fn read(&self, file: &Path) -> Result<String> {
        self.place.read(&file.to_string_lossy())
    }
}

fn no_way() -> Error {
    Error::SetUp("no way to build the firmware".into())
}

fn setup(context: &mut Context) -> Result<Verdict> {
    let arm = context.arm()?;
    passed(format!("way '{}'", arm.way.name()))
}

/// Which gates to run.
#[derive(Default)]
pub struct Choice {
    /// Only these, in the table's order; empty for all.
    pub only: Vec<String>,
    /// Without the slow ones.
    pub quick: bool,
    /// The gates that may be SKIPPED, where not every gate may: a machine that should have everything
    /// is asked for everything.
    pub may_skip: Option<Vec<String>>,
}

impl Choice {
    /// # Errors
    /// [`Error::Usage`] where a gate that is named does not exist.
    fn check(&self) -> Result<()> {
        let only = self.only.iter().map(|name| ("--only", name));
        let may_skip = self.may_skip.iter().flatten();
        let mut named = only.chain(may_skip.map(|name| ("--may-skip", name)));
        let unknown = named.find(|(_, name)| GATES.iter().all(|gate| gate.name != *name));
        unknown.map_or(Ok(()), |(option, unknown)| {
            let all: Vec<_> = GATES.iter().map(|gate| gate.name).collect();
            let all = all.join(", ");
            Err(Error::Usage(format!(
                "{option} {unknown}: the gates are {all}"
            )))
        })
    }

    fn takes(&self, gate: &Gate) -> bool {
        self.only.is_empty() || self.only.iter().any(|name| name == gate.name)
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

/// Runs the chosen gates and prints the table; whether none failed.
///
/// # Errors
/// [`Error::Usage`] where a chosen gate does not exist.
pub fn run(place: Place, forced: Option<Way>, choice: &Choice) -> Result<bool> {
    choice.check()?;
    let mut context = Context {
        place,
        forced,
        arm: None,
        images: [None, None],
    };
    let mut rows = Vec::new();
    for gate in &GATES {
        if !choice.takes(gate) {
            continue;
        }
        let start = Instant::now();
        let outcome = if gate.slow && choice.quick && choice.only.is_empty() {
            skipped("left out by --quick")
        } else {
            println!("\n== {}: {}", gate.name, gate.about);
            (gate.run)(&mut context)
        };
        let (result, figure) = match outcome {
            Ok(Verdict::Passed(figure)) => (PASSED, figure),
            Ok(Verdict::Skipped(reason)) => (SKIPPED, reason),
            Err(error) => {
                println!("{}: FAILED: {error}", gate.name);
                (FAILED, error.to_string())
            }
        };
        rows.push(Row {
            name: gate.name,
            result,
            figure,
            seconds: start.elapsed().as_secs_f64(),
        });
    }
    Ok(close(&rows, choice))
}

/// Prints the table and, last, the line that sums it up; whether no gate failed, and none was SKIPPED
/// that may not be.
fn close(rows: &[Row], choice: &Choice) -> bool {
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
    let of = |result: &str| rows.iter().filter(|row| row.result == result).count();
    if let Some(first) = rows.iter().find(|row| row.result == FAILED) {
        println!(
            "\n`cargo xtask test --only {}` runs that gate alone",
            first.name
        );
    }
    let skipped = rows.iter().filter(|row| row.result == SKIPPED);
    let missing: Vec<_> = skipped
        .map(|row| row.name)
        .filter(|name| !choice.may_skip(name))
        .collect();
    if !missing.is_empty() {
        println!("\nmay not be skipped here: {}", missing.join(", "));
    }
    println!(
        "\n{} passed, {} failed, {} skipped",
        of(PASSED),
        of(FAILED),
        of(SKIPPED)
    );
    of(FAILED) == 0 && missing.is_empty()
}

fn one_line(text: &str) -> String {
    const WIDTH: usize = 160;
    let line = text.split_whitespace().collect::<Vec<_>>().join(" ");
    if line.chars().count() <= WIDTH {
        line
    } else {
        line.chars().take(WIDTH).chain("…".chars()).collect()
    }
}

#[cfg(test)]
mod unit_tests {
    use super::*;

    #[test]
    fn a_figure_stays_on_one_line_of_the_table() {
        assert_eq!(one_line("a\n  b"), "a b");
        assert_eq!(one_line(&"ä".repeat(500)).chars().count(), 161);
    }

    #[test]
    fn only_a_gate_that_may_be_skipped_is_skipped_for_nothing() {
        let row = |name, result| Row {
            name,
            result,
            figure: String::new(),
            seconds: 0.0,
        };
        let rows = [row("fmt", PASSED), row("kani", SKIPPED)];
        let good = |may_skip: Option<&str>| {
            let may_skip = may_skip.map(|name| vec![name.to_owned()]);
            let choice = Choice {
                may_skip,
                ..Choice::default()
            };
            choice.check().unwrap();
            close(&rows, &choice)
        };
        assert!(good(None));
        assert!(good(Some("kani")));
        assert!(!good(Some("fuzz")));
        assert!(!close(&[row("fmt", FAILED)], &Choice::default()));
        for unknown in [
            Choice {
                only: vec!["kanu".into()],
                ..Choice::default()
            },
            Choice {
                may_skip: Some(vec!["kanu".into()]),
                ..Choice::default()
            },
        ] {
            let Err(Error::Usage(why)) = unknown.check() else {
                panic!("a gate that does not exist")
            };
            assert!(why.contains("kanu: the gates are setup, fmt"), "{why}");
        }
    }

    #[test]
    fn no_two_gates_share_a_name() {
        let mut names: Vec<_> = GATES.iter().map(|gate| gate.name).collect();
        names.sort_unstable();
        names.dedup();
        assert_eq!(names.len(), GATES.len());
    }
}

//! Trying mutants: cargo-mutants puts each into a copy of the workspace and runs the tests there.

use std::collections::{BTreeMap, HashSet};
use std::ops::Range;
use std::path::{Path, PathBuf};
use std::process::Command;
use std::time::{Duration, Instant};

use super::listed::{self, Mutant};
use crate::cargo_tool::{CargoTool as Tool, Found};
use crate::compat::Place;
use crate::compat::{failed, Of};
use crate::error::Result;
use crate::mirror::mirror;
use crate::shell;

const CARGO_MUTANTS: Tool = Tool {
    subcommand: "mutants",
    version: "27.1.0",
};

/// The package whose mutants these are.
const PACKAGE: &str = "fw-core";

/// How one mutant ended.
#[derive(Clone, Copy, Debug, PartialEq, Eq, PartialOrd, Ord)]
pub enum Outcome {
    /// A test failed.
    Caught,
    /// The tests did not end.
    Endless,
    /// It does not compile.
    Unviable,
    /// Every test passed.
    Survived,
}

/// What came of each mutant, by its name.
pub type Outcomes = BTreeMap<String, Outcome>;

/// Tests that are asked; what one stage does not notice goes to the next.
struct Stage {
    name: &'static str,
    packages: &'static [&'static str],
    /// Which of their tests are built.
    targets: &'static [&'static str],
    /// Only the tests of the mutants' own modules.
    near: bool,
    /// Without those that take as long as all others together.
    quick: bool,
}

/// The tests next to a mutant notice nearly all, within seconds; what calls the core from elsewhere takes
/// a minute.
const STAGES: [Stage; 4] = [
    Stage {
        name: "the quick tests of the same module",
        packages: &["fw-core"],
        targets: &["--lib"],
        near: true,
        quick: true,
    },
    Stage {
        name: "the quick tests beside the code",
        packages: &["fw-core"],
        targets: &["--lib"],
        near: false,
        quick: true,
    },
    Stage {
        name: "all tests of the core",
        packages: &["fw-core"],
        targets: &["--lib", "--tests"],
        near: false,
        quick: false,
    },
    Stage {
        name: "the properties",
        packages: &["proofs"],
        targets: &["--lib", "--tests"],
        near: false,
        quick: false,
    },
];

/// The stage after those of the quick tests.
pub const CORE: usize = 2;

/// How many there are.
pub const ALL: usize = STAGES.len();

/// Parts of the names of the tests that are not quick. A test that is missing here only costs time.
const SLOW: [&str; 8] = [
    "a_million_ticks_of_curves",
    "a_kilometre_straight_on",
    "a_constant_curve_stays",
    "every_one_two_or_three_bit_error",
    "every_burst_of_up_to_sixteen_bits",
    "on_every_phase",
    "no_line_is_torn",
    "sharp_turns_keep",
];

impl Stage {
    /// The words for the tests themselves.
    fn words(&self, files: &[&str]) -> Vec<String> {
        let mut words = Vec::new();
        if self.quick {
            words.extend(quick());
        }
        if self.near {
            words.extend(files.iter().flat_map(|file| near(file)));
        }
        words
    }
}

/// The words that leave out the tests that are not quick.
pub fn quick() -> Vec<String> {
    SLOW.iter().map(|name| format!("--skip={name}")).collect()
}

/// The starts of the names of the tests next to a file: `wire::crc` and `wire::tests::` of
/// `fw-core/src/wire/crc.rs`.
pub fn near(file: &str) -> Vec<String> {
    let inside = file.split_once("/src/").map_or(file, |(_, inside)| inside);
    let mut modules = inside.trim_end_matches(".rs").split('/');
    let outer = modules.next().unwrap_or_default();
    match modules.next() {
        None | Some("mod") => vec![format!("{outer}::")],
        Some(inner) => vec![format!("{outer}::{inner}"), format!("{outer}::tests::")],
    }
}

/// Where cargo-mutants is.
pub struct Runner<'p> {
    place: &'p Place,
    found: Found,
}

impl<'p> Runner<'p> {
    /// Finds cargo-mutants, or builds it below the target folder.
    ///
    /// # Errors
    /// [`Error::Missing`](crate::error::Error) where it is not there and cannot be built.
    pub fn find(place: &'p Place) -> Result<Self> {
        let found = CARGO_MUTANTS.find(place)?;
        Ok(Self { place, found })
    }

    /// `cargo mutants` for our package.
    fn cargo_mutants(&self) -> Command {
        let mut command = CARGO_MUTANTS.command(self.place, &self.found);
        command.args(["--package", PACKAGE, "--colors", "never"]);
        command
    }

    /// Every mutant, or those in what a `diff` adds; and how cargo-mutants said it.
    ///
    /// # Errors
    /// Where cargo-mutants does not answer.
    pub fn list(&self, diff: Option<&Path>) -> Result<(Vec<Mutant>, String)> {
        let mut list = self.cargo_mutants();
        list.args(["--list", "--json"]);
        if let Some(diff) = diff {
            list.arg("--in-diff").arg(diff);
        }
        match shell::ask(&mut list) {
            Some(answer) if answer.is_empty() => Ok((Vec::new(), answer)),
            Some(answer) => Ok((listed::parse(&answer, &self.place.root)?, answer)),
            None => failed(format!("`{}` failed", shell::shown(&list))),
        }
    }

    /// As many copies of the workspace as mutants are tried at a time.
    ///
    /// # Errors
    /// Where a copy cannot be made.
    pub fn benches(&self, jobs: usize) -> Result<Vec<Bench<'_>>> {
        (1..=jobs)
            .map(|number| Bench::set_up(self, number))
            .collect()
    }
}

/// A copy of the workspace to spoil, with a target folder of its own.
pub struct Bench<'r> {
    runner: &'r Runner<'r>,
    root: PathBuf,
    target: PathBuf,
    results: PathBuf,
    /// How long the tests of each stage may take, once it is known that they pass.
    limits: [Option<Duration>; ALL],
}

impl<'r> Bench<'r> {
    fn set_up(runner: &'r Runner<'r>, number: usize) -> Result<Self> {
        let place = runner.place;
        let folder = place.target.join("mutants").join(number.to_string());
        let root = folder.join("workspace");
        mirror(&place.root, &place.target, &root)?;
        Ok(Self {
            runner,
            root,
            target: folder.join("target"),
            results: folder,
            limits: [None; ALL],
        })
    }

    /// Tries the mutants, stage by stage.
    ///
    /// # Errors
    /// Where the tests fail without any mutant, or cargo-mutants does.
    pub fn try_all(&mut self, mutants: &[Mutant], stages: Range<usize>) -> Result<Outcomes> {
        let mut outcomes = Outcomes::new();
        let mut left: Vec<&Mutant> = mutants.iter().collect();
        for number in stages {
            if left.is_empty() {
                break;
            }
            let found = self.stage(number, &left)?;
            left.retain(|mutant| found.get(&mutant.name) == Some(&Outcome::Survived));
            outcomes.extend(found);
        }
        Ok(outcomes)
    }

    fn stage(&mut self, number: usize, tried: &[&Mutant]) -> Result<Outcomes> {
        let stage = &STAGES[number];
        let limit = match self.limits[number] {
            Some(limit) => limit,
            None => self.good(stage)?,
        };
        self.limits[number] = Some(limit);
        let mut files: Vec<&str> = tried.iter().map(|mutant| mutant.file.as_str()).collect();
        files.dedup();
        let mut mutants = self.runner.cargo_mutants();
        mutants
            .arg("--in-place")
            .arg("--dir")
            .arg(&self.root)
            .arg("--output")
            .arg(&self.results)
            // It has been seen that the tests pass without a mutant.
            .args(["--baseline", "skip", "--timeout"])
            .arg(limit.as_secs().to_string())
            .arg("--test-package")
            .arg(stage.packages.join(","));
        for argument in stage.targets.iter().chain(&SETTINGS) {
            mutants.arg(format!("--cargo-arg={argument}"));
        }
        // Not every kind of mutant is chosen by its name, but all are by their file.
        for file in &files {
            mutants.args(["--file", file]);
        }
        for mutant in tried {
            let name = format!("^{}$", literally(&mutant.name));
            mutants.args(["--re", &name]);
        }
        mutants.args(["--", "--"]).args(stage.words(&files));
        mutants.env("CARGO_TARGET_DIR", &self.target);
        let ended = mutants.output().of("cargo mutants")?;
        // 2: some survived; 3: some did not end.
        if !matches!(ended.status.code(), Some(0 | 2 | 3)) {
            let said = String::from_utf8_lossy(&ended.stderr);
            return failed(format!("cargo mutants ended with {}: {said}", ended.status));
        }
        let outcomes = self.results_of(tried)?;
        // Of many some compile, unless something else is broken: then nothing was tried.
        let none_compiles = outcomes.values().all(|&ended| ended == Outcome::Unviable);
        if tried.len() > 1 && none_compiles {
            self.good(stage)?;
        }
        Ok(outcomes)
    }

    /// Runs a stage's tests on the good code: how long its mutants may take.
    fn good(&self, stage: &Stage) -> Result<Duration> {
        let mut tests = self.runner.place.cargo("");
        tests.current_dir(&self.root).arg("test");
        tests.arg("--target-dir").arg(&self.target);
        for package in stage.packages {
            tests.args(["--package", package]);
        }
        tests.args(stage.targets).args(SETTINGS);
        tests.arg("--").args(stage.words(&[]));
        let failing = |tests: &Command| {
            let why = "without any mutant the tests fail:";
            failed(format!("{why} {}", shell::shown(tests)))
        };
        // Once to build them, once to see how long they take.
        if shell::ask(&mut tests).is_none() {
            return failing(&tests);
        }
        let start = Instant::now();
        if shell::ask(&mut tests).is_none() {
            return failing(&tests);
        }
        let took = start.elapsed();
        let limit = took * 5 + Duration::from_secs(20);
        println!(
            "  {}: {:.1} s at most, {} s for a mutant",
            stage.name,
            took.as_secs_f64(),
            limit.as_secs()
        );
        Ok(limit)
    }

    fn results_of(&self, tried: &[&Mutant]) -> Result<Outcomes> {
        let mut outcomes = Outcomes::new();
        for (file, outcome) in [
            ("caught.txt", Outcome::Caught),
            ("timeout.txt", Outcome::Endless),
            ("unviable.txt", Outcome::Unviable),
            ("missed.txt", Outcome::Survived),
        ] {
            let file = self.results.join("mutants.out").join(file);
            let text = std::fs::read_to_string(&file).of(file.display())?;
            let names: HashSet<&str> = text.lines().collect();
            let so = tried.iter().map(|mutant| &mutant.name);
            let so = so.filter(|name| names.contains(name.as_str()));
            outcomes.extend(so.map(|name| (name.clone(), outcome)));
        }
        let missing = |mutant: &&&Mutant| !outcomes.contains_key(&mutant.name);
        match tried.iter().find(missing) {
            None => Ok(outcomes),
            Some(mutant) => failed(format!("cargo mutants did not try {}", mutant.name)),
        }
    }
}

/// Much is built and few tests run long: the other way round than among the gates.
pub const SETTINGS: [&str; 3] = [
    "--config=profile.dev.opt-level=1",
    "--config=profile.dev.debug=false",
    "--locked",
];

/// The regular expression of this text alone.
fn literally(text: &str) -> String {
    let mut expression = String::new();
    for letter in text.chars() {
        // Not every mark: a backslash before `<` or `>` would give it a meaning.
        if r"\.+*?()|[]{}^$#&-~".contains(letter) {
            expression.push('\\');
        }
        expression.push(letter);
    }
    expression
}

#[cfg(test)]
mod tests {
    use super::{literally, near};

    #[test]
    fn the_tests_next_to_a_mutant_are_those_of_its_module() {
        let of = |file| near(file).join(" ");
        assert_eq!(
            of("fw-core/src/motion/odometry/slip.rs"),
            "motion::odometry motion::tests::"
        );
        assert_eq!(of("fw-core/src/robot/mod.rs"), "robot::");
        assert_eq!(of("fw-core/src/log.rs"), "log::");
    }

    #[test]
    fn a_name_is_matched_as_it_is_written() {
        assert_eq!(
            literally("a.rs:1:2: f<T> -> [u8]"),
            r"a\.rs:1:2: f<T> \-> \[u8\]",
            "no letter means anything else"
        );
    }
}

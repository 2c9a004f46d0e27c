//! Seeded defects: the code made wrong on purpose, one small change at a time, to see that some gate
//! notices. A defect that nobody notices is a hole in the gates and fails.

mod list;

use std::collections::BTreeMap;
use std::fmt::Write;
use std::path::PathBuf;

use crate::compat::Place;
use crate::compat::{failed, Of};
use crate::elf::{Elf, BANNED};
use crate::error::Result;
use crate::firmware;
use crate::mirror::mirror;
use crate::toolchain::Toolchain as Arm;
use crate::{shell, stack};
pub use list::Defect;
use list::{Gate, Judge};

/// Where the defects stand, and where the table of who caught which.
const FOLDER: &str = "ci/defects";
const TABLE: &str = "docs/defects.md";

/// Every defect, applied on paper: each must fit its file.
///
/// # Errors
/// Names the defect that is not whole or does not apply.
pub fn all(place: &Place) -> Result<Vec<Defect>> {
    let defects = list::read(&place.root.join(FOLDER))?;
    for defect in &defects {
        let text = place.read(&defect.file)?;
        if defect.applied(&text)? == text {
            return failed(format!("defect {} changes nothing", defect.name));
        }
    }
    Ok(defects)
}

/// How many of the defects the table lists as caught.
///
/// # Errors
/// Where the table has a row of a defect that is no longer so.
pub fn listed(place: &Place, defects: &[Defect]) -> Result<usize> {
    let text = place.read(TABLE)?;
    let current = old_rows(defects, &text).len();
    let rows = text
        .lines()
        .filter(|line| line.starts_with("| `") && line.contains("](../"));
    let stale = rows.count() - current;
    if stale == 0 {
        Ok(current)
    } else {
        failed(format!(
            "{TABLE} has {stale} row(s) of defects that are not so; `cargo xtask defects` renews it"
        ))
    }
}

/// A copy of the workspace to spoil, with a target folder of its own.
pub struct Bench<'a> {
    place: &'a Place,
    arm: Option<&'a Arm>,
    root: PathBuf,
    target: PathBuf,
}

/// Who noticed, and by what.
type Catch = (Gate, String);

impl<'a> Bench<'a> {
    /// Brings the copy up to date; what did not change keeps its time, so that cargo builds only what
    /// did.
    ///
    /// # Errors
    /// Names the file that cannot be copied.
    pub fn set_up(place: &'a Place, arm: Option<&'a Arm>) -> Result<Self> {
        let folder = place.target.join("defects");
        let root = folder.join("workspace");
        mirror(&place.root, &place.target, &root)?;
        Ok(Self {
            place,
            arm,
            root,
            target: folder.join("target"),
        })
    }

    /// Tries one defect: the first of its judges that notices.
    ///
    /// # Errors
    /// Where it does not apply or build, or nobody notices.
    pub fn try_one(&self, defect: &Defect) -> Result<Catch> {
        let file = self.root.join(&defect.file);
        let good = std::fs::read_to_string(&file).of(file.display())?;
        std::fs::write(&file, defect.applied(&good)?).of(file.display())?;
        let verdict = self.judged(defect);
        std::fs::write(&file, good).of(file.display())?;
        match verdict? {
            Some(catch) => Ok(catch),
            None => failed(format!("nobody noticed {}: {}", defect.name, defect.what)),
        }
    }

    fn judged(&self, defect: &Defect) -> Result<Option<Catch>> {
        for judge in &defect.judges {
            let found = match judge.gate {
                Gate::Unit => self.tests(&["-p", "fw-core", "--lib"], &judge.filter)?,
                Gate::Vectors => {
                    self.tests(&["-p", "fw-core", "--test", "vectors"], &judge.filter)?
                }
                Gate::Interfaces => {
                    self.tests(&["-p", "fw-core", "--test", "interfaces"], &judge.filter)?
                }
                Gate::Properties => self.tests(&["-p", "proofs", "--lib"], &judge.filter)?,
                Gate::Host => self.tests(&["-p", "host-link", "--lib"], &judge.filter)?,
                Gate::Elf | Gate::Stack | Gate::Loop => self.on_the_elf(judge)?,
            };
            if let Some(found) = found {
                return Ok(Some((judge.gate, found)));
            }
        }
        Ok(None)
    }

    /// Runs tests of the copy; those that failed.
    fn tests(&self, which: &[&str], filter: &str) -> Result<Option<String>> {
        let mut cargo = self.place.cargo("");
        cargo
            .current_dir(&self.root)
            .args(["test", "--locked", "--no-fail-fast"]);
        // Few tests run and much is built: the other way round than among the gates.
        cargo.args(["--config", "profile.dev.opt-level=0"]);
        cargo.args(["--config", "profile.dev.debug=false"]);
        cargo
            .arg("--target-dir")
            .arg(&self.target)
            .args(which)
            .arg(filter);
        failures(&mut cargo)
    }

    fn on_the_elf(&self, judge: &Judge) -> Result<Option<String>> {
        let no_way = || crate::error::Failure::NoToolchain("no way to build the firmware".into());
        let arm = self.arm.as_ref().ok_or_else(no_way)?;
        let (root, target) = (&self.root, &self.target);
        let elf = firmware::build_in(self.place, arm, root, target, "")?;
        let bytes = std::fs::read(&elf).of(elf.display())?;
        match judge.gate {
            Gate::Stack => Ok(stack::bound(self.place, &elf)
                .err()
                .map(|error| error.to_string())),
            Gate::Loop => {
                let (file, filter) = judge.filter.split_once(' ').unwrap_or((&judge.filter, ""));
                let words = [
                    "test",
                    "--release",
                    "-p",
                    "robot-tests",
                    "--test",
                    file,
                    filter,
                ];
                let mut cargo = self.place.cargo_with_board(&words.join(" "))?;
                failures(cargo.env("ROBOT_ELF", &elf))
            }
            _ => {
                let parsed = Elf::parse(&bytes)?;
                let symbols = parsed.symbols();
                let mut found = BANNED
                    .iter()
                    .filter(|kind| !kind.among(&symbols).is_empty());
                Ok(found.next().map(|kind| kind.name.to_owned()))
            }
        }
    }
}

/// The tests that failed, or `None` where all passed.
fn failures(command: &mut std::process::Command) -> Result<Option<String>> {
    let (status, text) = shell::tee_any_end(command)?;
    let ran = text
        .lines()
        .any(|line| line.starts_with("test result: ") && !line.contains(" 0 passed; 0 failed"));
    let lines = text.lines().filter_map(|line| line.strip_prefix("test "));
    let broken: Vec<&str> = lines
        .filter_map(|line| line.strip_suffix(" ... FAILED"))
        .collect();
    match (broken.first(), ran) {
        (Some(first), _) if broken.len() > 1 => {
            Ok(Some(format!("`{first}` and {} more", broken.len() - 1)))
        }
        (Some(first), _) => Ok(Some(format!("`{first}`"))),
        (None, true) if status.success() => Ok(None),
        // A test that aborts the others, by a stack overflow for one, has noticed.
        (None, true) => Ok(Some("a test that ended them all".into())),
        (None, false) => failed(format!(
            "`{}` ran no test: does the defect compile?",
            shell::shown(command)
        )),
    }
}

/// Tries the defects whose name is in `only`, all where that is empty, and renews their rows of the
/// table.
///
/// # Errors
/// Names those that nobody noticed.
pub fn run(place: &Place, arm: Option<&Arm>, only: &[String]) -> Result<()> {
    let defects = all(place)?;
    let known = |name: &String| defects.iter().any(|defect| defect.name == *name);
    if let Some(unknown) = only.iter().find(|name| !known(name)) {
        return Err(crate::error::Failure::Usage(format!("no defect is called {unknown}")).into());
    }
    let bench = Bench::set_up(place, arm)?;
    let file = place.root.join(TABLE);
    let mut rows = old_rows(
        &defects,
        &std::fs::read_to_string(&file).unwrap_or_default(),
    );
    let (mut caught, mut holes) = (0, Vec::new());
    for defect in &defects {
        if !only.is_empty() && !only.contains(&defect.name) {
            continue;
        }
        println!("\n== {}: {}", defect.name, defect.what);
        match bench.try_one(defect) {
            Ok((gate, found)) => {
                println!("{}: caught by {}: {found}", defect.name, gate.name());
                rows.insert(&defect.name, row(defect, gate, &found));
                caught += 1;
            }
            Err(error) => {
                println!("{}: {error}", defect.name);
                rows.remove(defect.name.as_str());
                holes.push(error.to_string());
            }
        }
        // After each: who ends a long run early keeps what it found.
        std::fs::write(&file, table(&defects, &rows)).of(file.display())?;
    }
    println!("\n{caught} caught, {} not; see {TABLE}", holes.len());
    if holes.is_empty() {
        Ok(())
    } else {
        failed(holes.join("; "))
    }
}

/// Rows by the defect's name.
type Rows<'a> = BTreeMap<&'a str, String>;

/// The rows of an earlier table that are about today's defects.
fn old_rows<'a>(defects: &'a [Defect], table: &str) -> Rows<'a> {
    let mut rows = Rows::new();
    for defect in defects {
        let start = row_start(defect);
        if let Some(row) = table.lines().find(|line| line.starts_with(&start)) {
            rows.insert(&defect.name, row.to_owned());
        }
    }
    rows
}

fn row_start(defect: &Defect) -> String {
    let Defect {
        name, what, file, ..
    } = defect;
    format!("| `{name}` | {what} | [`{file}`](../{file}) | ")
}

fn row(defect: &Defect, gate: Gate, found: &str) -> String {
    format!("{}`{}` | {found} |", row_start(defect), gate.name())
}

fn table(defects: &[Defect], rows: &Rows<'_>) -> String {
    let mut text = format!(
        "# Seeded defects\n\n\
         Small changes for the worse, each put into a copy of the code on purpose, and the gate that \
         noticed it. {} of the {} in\n[`ci/defects`](../ci/defects) have been tried as they stand there, \
         and each was noticed. `cargo xtask defects` tries all and\nwrites this table, `--only NAME` tries \
         some and renews their rows; one that nobody notices fails. The gate `defects`\nchecks that each \
         still fits the code, and tries the samples among them.\n\n\
         | defect | what is wrong | file | caught by | there by |\n|---|---|---|---|---|\n",
        rows.len(),
        defects.len()
    );
    for row in defects
        .iter()
        .filter_map(|defect| rows.get(defect.name.as_str()))
    {
        text += row;
        text += "\n";
    }
    text += "\n## By gate\n\n| gate | caught |\n|---|---|\n";
    for gate in Gate::ALL {
        let mark = format!(" | `{}` | ", gate.name());
        let count = rows.values().filter(|row| row.contains(&mark)).count();
        if count > 0 {
            let _ = writeln!(text, "| `{}` | {count} |", gate.name());
        }
    }
    text
}

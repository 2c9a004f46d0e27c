//! Mutants: `fw-core` changed in every way that cargo-mutants knows, to see that some test notices. What
//! survives is a hole in the tests, or is excused in `ci/mutants.txt` with the reason why nobody can
//! notice it.

mod excuses;
mod lab;
mod listed;
mod runner;
mod switched;
mod table;

use std::collections::BTreeMap;
use std::path::PathBuf;
use std::process::Command;
use std::time::{Duration, Instant};

use crate::compat::Place;
use crate::compat::{failed, Of};
use crate::error::Result;
use crate::shard::Shard;
use crate::shell;
use excuses::Excuse;
use lab::Lab;
use listed::Mutant;
use runner::{Outcome, Outcomes, Runner};
use table::Row;

/// Where the excuses stand, and where the table of what came of the mutants.
const EXCUSES: &str = "ci/mutants.txt";
const TABLE: &str = "docs/mutants.md";

/// What mutants are made of.
const SOURCES: &str = "fw-core/src";

/// Which mutants to try, and how.
#[derive(clap::Args)]
pub struct Choice {
    /// Those of files whose path contains one of these; empty for all.
    #[arg(long = "file", value_name = "FILE", value_delimiter = ',')]
    pub files: Vec<String>,
    /// Those whose name contains one of these; empty for all.
    #[arg(long, value_name = "TEXT", value_delimiter = ',')]
    pub only: Vec<String>,
    /// Every `n`th from the `i`th on.
    #[arg(long, value_name = "K/N", default_value = "0/1")]
    pub shard: Shard,
    /// How many at a time.
    #[arg(long, default_value_t = 1)]
    pub jobs: usize,
    /// By the quick tests beside the code alone. What survives these may be caught by others.
    #[arg(long)]
    pub quick: bool,
}

impl Default for Choice {
    fn default() -> Self {
        Self {
            files: Vec::new(),
            only: Vec::new(),
            shard: Shard::ALL,
            jobs: 1,
            quick: false,
        }
    }
}

impl Choice {
    fn takes(&self, mutant: &Mutant) -> bool {
        let any = |words: &[String], text: &str| {
            words.is_empty() || words.iter().any(|word| text.contains(word))
        };
        any(&self.files, &mutant.file) && any(&self.only, &mutant.name)
    }

    /// Whether all mutants of a file are tried where one is.
    fn whole(&self) -> bool {
        self.only.is_empty() && self.shard == Shard::ALL && !self.quick
    }

    fn of(&self, all: &[Mutant]) -> Vec<Mutant> {
        let shard = self.shard.of(all.iter());
        shard.filter(|mutant| self.takes(mutant)).cloned().collect()
    }
}

/// What is wrong with how some mutants ended: survivors without an excuse, excuses without a survivor.
fn findings(mutants: &[Mutant], outcomes: &Outcomes, excuses: &[Excuse]) -> Vec<String> {
    let mut wrong = Vec::new();
    for mutant in mutants {
        let excuse = excuses.iter().find(|excuse| excuse.covers(mutant));
        let survived = outcomes.get(&mutant.name) == Some(&Outcome::Survived);
        match (survived, excuse) {
            (true, None) => wrong.push(format!("survived: {}", mutant.name)),
            (false, Some(excuse)) => {
                wrong.push(format!("{EXCUSES} excuses what is noticed: {excuse}"));
            }
            _ => {}
        }
    }
    wrong
}

fn excuses(place: &Place) -> Result<Vec<Excuse>> {
    excuses::parse(&place.read(EXCUSES)?)
}

/// The excuses that are about no mutant, as findings.
fn stale(excuses: &[Excuse], all: &[Mutant]) -> Vec<String> {
    let stale = excuses::stale(excuses, all);
    let finding = |excuse: &Excuse| format!("{EXCUSES} excuses no mutant: {excuse}");
    stale.into_iter().map(finding).collect()
}

/// Tries the chosen mutants, file by file, and renews the rows of the files tried whole.
///
/// # Errors
/// Names the mutants that survived without an excuse, and the excuses that are not needed.
pub fn run(place: &Place, choice: &Choice) -> Result<()> {
    let runner = Runner::find(place)?;
    let listed = runner.list(None)?;
    let all = &listed.0;
    let excuses = excuses(place)?;
    let mut wrong = stale(&excuses, all);
    let chosen = choice.of(all);
    if chosen.is_empty() {
        return Err(crate::error::Failure::Usage("no mutant is called so".into()).into());
    }
    let mut files: Vec<&str> = chosen.iter().map(|mutant| mutant.file.as_str()).collect();
    files.dedup();
    println!("{} mutants of {} files", chosen.len(), files.len());
    let start = Instant::now();
    let may_survive = |mutant: &Mutant| excuses.iter().any(|excuse| excuse.covers(mutant));
    let mut lab = Lab::set_up(place, &runner, choice.jobs.max(1), &listed, chosen.len());
    let mut sum = Row::default();
    for file in files {
        let of_file = chosen.iter().filter(|mutant| mutant.file == file);
        let mutants: Vec<Mutant> = of_file.cloned().collect();
        let text = text_of(place, file);
        let outcomes = lab.try_all(&mutants, |mutant| choice.quick || may_survive(mutant))?;
        let found = findings(&mutants, &outcomes, &excuses);
        let row = Row::of(text.unwrap_or_default(), outcomes.values().copied());
        let [caught, endless, unviable, survived] = row.counts;
        println!(
            "{file}: {} mutants, {caught} caught, {endless} ran for ever, {unviable} do not compile, \
             {survived} survived; {:.0} s",
            mutants.len(),
            start.elapsed().as_secs_f64()
        );
        for finding in &found {
            println!("  {finding}");
        }
        for (all, one) in sum.counts.iter_mut().zip(row.counts) {
            *all += one;
        }
        if choice.whole() && !row.text.is_empty() {
            renew(place, all, file, found.is_empty().then_some(row))?;
        }
        wrong.extend(found);
    }
    let [caught, endless, unviable, survived] = sum.counts;
    println!(
        "\n{} mutants: {caught} caught, {endless} ran for ever, {unviable} do not compile, \
         {survived} survived; {} unexplained; {:.0} s",
        chosen.len(),
        wrong.len(),
        start.elapsed().as_secs_f64()
    );
    if wrong.is_empty() {
        Ok(())
    } else {
        failed(wrong.join("; "))
    }
}

/// What git calls a file's text; nothing where there is no git.
fn text_of(place: &Place, file: &str) -> Option<String> {
    let mut git = Command::new("git");
    git.current_dir(&place.root).args(["hash-object", file]);
    let mut name = shell::ask(&mut git)?;
    name.truncate(10);
    Some(name)
}

/// Writes one file's row, or takes it away. After each: who ends a long run early keeps what it found.
fn renew(place: &Place, all: &[Mutant], file: &str, row: Option<Row>) -> Result<()> {
    let mut counts = BTreeMap::new();
    for mutant in all {
        *counts.entry(mutant.file.clone()).or_insert(0) += 1;
    }
    let path = place.root.join(TABLE);
    let mut rows = table::parse(&std::fs::read_to_string(&path).unwrap_or_default());
    rows.retain(|file, _| counts.contains_key(file));
    match row {
        Some(row) => rows.insert(file.to_owned(), row),
        None => rows.remove(file),
    };
    std::fs::write(&path, table::show(&rows, &counts)).of(TABLE)
}

/// What a gate can say of the mutants.
pub enum Said {
    /// With the figure.
    Good(String),
    /// Why there was nothing to try.
    Nothing(String),
}

/// Tries the mutants of the lines that changed since the last commit of the main branch, for at most a
/// minute or so.
///
/// # Errors
/// Where one survived without an excuse, or an excuse is about no mutant.
pub fn of_the_change(place: &Place) -> Result<Said> {
    const ENOUGH: Duration = Duration::from_mins(1);
    /// Tried between two looks at the clock.
    const AT_A_TIME: usize = 4;
    let nothing = |why: String| Ok(Said::Nothing(why));
    let Some((base, diff)) = changed(place)? else {
        return nothing("no commit to compare with".into());
    };
    let Some(diff) = diff else {
        return nothing(format!(
            "nothing in {SOURCES} or {EXCUSES} changed since {base}"
        ));
    };
    let runner = match Runner::find(place) {
        Err(error) if crate::error::missing_program(&error).is_some() => {
            return nothing(error.to_string())
        }
        runner => runner?,
    };
    let listed = runner.list(None)?;
    let excuses = excuses(place)?;
    let mut wrong = stale(&excuses, &listed.0);
    let mutants = runner.list(Some(&diff))?.0;
    if mutants.is_empty() && wrong.is_empty() {
        return nothing(format!("no mutant in what changed since {base}"));
    }
    let may_survive = |mutant: &Mutant| excuses.iter().any(|excuse| excuse.covers(mutant));
    let mut lab = Lab::set_up(place, &runner, 1, &listed, mutants.len());
    let start = Instant::now();
    let mut tried = 0;
    // Spread over all of the change, if there is no time for every one.
    let rounds = mutants.len().div_ceil(AT_A_TIME);
    for round in 0..rounds {
        if start.elapsed() > ENOUGH {
            break;
        }
        let some = mutants.iter().skip(round).step_by(rounds);
        let some: Vec<Mutant> = some.cloned().collect();
        let outcomes = lab.try_all(&some, may_survive)?;
        wrong.extend(findings(&some, &outcomes, &excuses));
        tried += some.len();
    }
    if wrong.is_empty() {
        Ok(Said::Good(format!(
            "{tried} of {} mutants in what changed since {base}, all noticed or excused",
            mutants.len()
        )))
    } else {
        failed(wrong.join("; "))
    }
}

/// The commit to compare with, by name, and a file with what changed in the core since; no file where
/// nothing did.
fn changed(place: &Place) -> Result<Option<(&'static str, Option<PathBuf>)>> {
    let git = |words: &[&str]| {
        let mut git = Command::new("git");
        git.current_dir(&place.root).args(words);
        shell::ask(&mut git)
    };
    let commit = |name: &str| {
        git(&[
            "rev-parse",
            "--verify",
            "--quiet",
            &format!("{name}^{{commit}}"),
        ])
    };
    let head = commit("HEAD");
    // On the main branch itself, the change is the last commit and what is not committed.
    let main = commit("origin/main").filter(|main| Some(main) != head.as_ref());
    let base = match (main, commit("HEAD~1")) {
        (Some(_), _) => "origin/main",
        (None, Some(_)) => "HEAD~1",
        (None, None) => return Ok(None),
    };
    // What main has gained in the meantime is no part of the change.
    let Some(diff) = git(&["diff", "--merge-base", base, "--", SOURCES, EXCUSES]) else {
        return Ok(None);
    };
    if diff.is_empty() {
        return Ok(Some((base, None)));
    }
    let file = place.target.join("mutants").join("change.diff");
    std::fs::create_dir_all(place.target.join("mutants")).of("target/mutants")?;
    std::fs::write(&file, diff + "\n").of(file.display())?;
    Ok(Some((base, Some(file))))
}

#[cfg(test)]
mod tests {
    use super::*;
    use Outcome::{Caught, Endless, Survived, Unviable};

    fn mutant(name: &str) -> Mutant {
        let change = name.splitn(4, ':').last().unwrap_or_default().trim();
        Mutant {
            name: name.into(),
            file: "a.rs".into(),
            change: change.into(),
            place: String::new(),
        }
    }

    #[test]
    fn a_survivor_without_an_excuse_and_an_excuse_without_a_survivor_are_found() {
        let mutants = ["a.rs:1:1: f", "a.rs:2:1: g", "a.rs:3:1: h"].map(mutant);
        let excuses = excuses::parse("Why.\n  a.rs: g\n  a.rs: h\n").unwrap();
        let outcomes = |f, g, h| {
            let names = mutants.iter().map(|mutant| mutant.name.clone());
            names.zip([f, g, h]).collect::<Outcomes>()
        };
        let good = outcomes(Caught, Survived, Survived);
        assert!(findings(&mutants, &good, &excuses).is_empty());
        let bad = outcomes(Survived, Endless, Unviable);
        let found = findings(&mutants, &bad, &excuses);
        assert_eq!(found.len(), 3, "{found:?}");
        assert_eq!(found[0], "survived: a.rs:1:1: f");
        assert!(found[1].contains("a.rs: g"));
    }
}

//! Mutation testing with all mutants of a crate in one test program: one build for thousands of
//! mutants instead of one for each.
//!
//! cargo-mutants lists the changes; [`switch`] puts each behind a switch that the environment
//! variable `MUTANT` turns on:
//!
//! ```
//! use mutation::{Mutant, Position, Span, switch};
//!
//! let source = "fn sum(a: u8, b: u8) -> u8 { a + b }";
//! let plus = Span {
//!     start: Position { line: 1, column: 32 },
//!     end: Position { line: 1, column: 33 },
//! };
//! let mutant = Mutant {
//!     genre: "BinaryOperator".into(),
//!     span: plus,
//!     replacement: "-".into(),
//!     ..Mutant::default()
//! };
//! assert_eq!(mutant.applied(source), "fn sum(a: u8, b: u8) -> u8 { a - b }");
//! let (switched, numbers) = switch(source, &[(7, &mutant)], &mut Default::default()).unwrap();
//! assert!(switched.contains("crate::mutant_operation!(a, + [0_0_7 -], b)"));
//! assert_eq!(numbers, [7]);
//! ```
//!
//! [`run`] lists, tries and reports the mutants of a package; the program `mutation` is its
//! command line.
#![forbid(unsafe_code)]

mod citations;
mod config;
mod engine;
mod excuses;
mod mutant;
mod operators;
mod report;
mod suite;
mod switch;
mod workspace;

use std::path::Path;
use std::process::Command;
use std::time::Instant;

use anyhow::{Context, Result, ensure};
use clap::Args;

pub use config::Config;
pub use excuses::{Excused, Excuses};
pub use mutant::{Function, List, Mutant, Position, Span};
pub use report::{Counts, Report};
pub use suite::Outcome;
pub use switch::switch;

use citations::{Citations, Claim};
use engine::Engine;
use workspace::Workspace;

/// Which mutants to try, and how.
#[derive(Args, Clone, Debug, Default)]
pub struct Choice {
    /// Only those of files whose path contains one of these
    #[arg(long = "file", value_name = "TEXT", value_delimiter = ',')]
    pub files: Vec<String>,
    /// Only those whose description contains one of these
    #[arg(long, value_name = "TEXT", value_delimiter = ',')]
    pub only: Vec<String>,
    /// Only every N-th from the K-th on, K from 0
    #[arg(long, value_name = "K/N", value_parser = parse_shard)]
    pub shard: Option<(usize, usize)>,
    /// Only those in lines that changed since this commit
    #[arg(long, value_name = "COMMIT")]
    pub since: Option<String>,
    /// Start no more after this time; those tried are spread over all that were chosen
    #[arg(long)]
    pub seconds: Option<u64>,
    /// How many at a time
    #[arg(long, default_value_t = 1)]
    pub jobs: usize,
    /// Only mutants with a switch
    #[arg(long)]
    pub quick: bool,
}

fn parse_shard(text: &str) -> Result<(usize, usize), &'static str> {
    let parts = text.split_once('/');
    let numbers = parts.and_then(|(k, n)| k.parse().ok().zip(n.parse().ok()));
    let shard = numbers.filter(|(k, n)| k < n);
    shard.ok_or("not K/N with K from 0 to N - 1")
}

/// cargo-mutants cannot be started.
#[derive(Debug, thiserror::Error)]
#[error("cargo-mutants cannot be started: {0}")]
pub struct NoLister(std::io::Error);

/// Lists the mutants of a package and tries the chosen ones. `lister` is the program
/// cargo-mutants; `folder` is in the workspace.
///
/// # Errors
/// Where the mutants cannot be listed, or the tests fail without one.
pub fn run(
    folder: &Path,
    lister: &Path,
    (config, excuses): &(Config, Excuses),
    choice: &Choice,
) -> Result<Report> {
    let workspace = Workspace::find(folder, &config.package)?;
    let all = list(&workspace, lister, config, &[])?;
    let chosen = choose(&workspace, lister, config, choice, &all)?;
    let mut report = Report {
        chosen: chosen.len(),
        ..Report::default()
    };
    let stale = excuses.stale(&all).into_iter();
    let stale = stale.map(|excused| format!("excuse without a mutant: {excused}"));
    report.findings = stale.collect();
    if chosen.is_empty() {
        return Ok(report);
    }
    let how = (choice.jobs, choice.quick);
    let mut engine = Engine::new(config, &workspace, &all, chosen.len(), how)?;
    let start = Instant::now();
    for group in groups(&all, &chosen, choice.seconds.is_some()) {
        let is_over = |limit| start.elapsed().as_secs() >= limit;
        if choice.seconds.is_some_and(is_over) {
            break;
        }
        let outcomes = engine.try_all(&group, |mutant| excuses.cover(mutant))?;
        let before = report.findings.len();
        for (&index, &outcome) in &outcomes {
            let mutant = &all[index];
            let may_survive = excuses.cover(mutant);
            report.add(&mutant.file, outcome, may_survive);
            let finding = match (outcome == Outcome::Survived, may_survive) {
                (true, false) => format!("survived: {mutant}"),
                (false, true) => format!("excused but {outcome:?}: {mutant}"),
                _ => continue,
            };
            report.findings.push(finding);
        }
        let (file, seconds) = (&all[group[0]].file, start.elapsed().as_secs_f64());
        println!("{file}: {} tried, {seconds:.0} s", group.len());
        for finding in &report.findings[before..] {
            println!("  {finding}");
        }
    }
    Ok(report)
}

/// Whether each test that cites a requirement in a comment `// LABEL: NAME, …` notices a change of the code that
/// cites it: how many do, and those that do not.
///
/// # Errors
/// Where the mutants cannot be listed, or the tests fail without one.
pub fn run_citations(
    folder: &Path,
    lister: &Path,
    config: &Config,
    label: &str,
    choice: &Choice,
) -> Result<(usize, Vec<String>)> {
    let workspace = Workspace::find(folder, &config.package)?;
    let all = list(&workspace, lister, config, &[])?;
    let mut citations = Citations::default();
    for package in [&config.package].into_iter().chain(&config.also) {
        let library = Workspace::find(folder, package)?.library;
        let sources = library.parent().unwrap_or(Path::new(""));
        for path in workspace::sorted(&workspace.root.join(sources))? {
            let shown = || path.display().to_string();
            let text = std::fs::read_to_string(&path).with_context(shown)?;
            let name = path.strip_prefix(&workspace.root).unwrap_or(&path);
            let module = workspace::module(name.strip_prefix(sources).unwrap_or(name));
            let part = |part: &std::ffi::OsStr| part.to_string_lossy().into_owned();
            let (name, module) = (name.to_string_lossy(), module.iter().map(part));
            let (module, elsewhere) = (module.collect::<Vec<_>>(), *package != config.package);
            let read = citations.read((&name, &module), &text, label, elsewhere);
            read.with_context(shown)?;
        }
    }
    let mut engine = Engine::new(config, &workspace, &all, all.len(), (choice.jobs, true))?;
    let chosen = |claim: &Claim| contains_any(&claim.to_string(), &choice.only);
    let (claims, idle) = engine.try_claims(&citations, chosen)?;
    Ok((claims, idle.iter().map(ToString::to_string).collect()))
}

/// The indices of the chosen mutants.
fn choose(
    workspace: &Workspace,
    lister: &Path,
    config: &Config,
    choice: &Choice,
    all: &[Mutant],
) -> Result<Vec<usize>> {
    let changed = match &choice.since {
        None => None,
        Some(base) => {
            let mut git = Command::new("git");
            git.current_dir(&workspace.root);
            git.args(["diff", "--merge-base", base]);
            let diff = git.output().context("git")?;
            let file = workspace.target.join("mutants.diff");
            std::fs::write(&file, diff.stdout)?;
            let in_diff = ["--in-diff".as_ref(), file.as_os_str()];
            Some(list(workspace, lister, config, &in_diff)?)
        }
    };
    let (shard, shards) = choice.shard.unwrap_or((0, 1));
    let chosen = all.iter().enumerate().skip(shard).step_by(shards);
    let chosen = chosen.filter(|(_, mutant)| {
        let changed = changed.as_ref();
        contains_any(&mutant.file, &choice.files)
            && contains_any(&mutant.to_string(), &choice.only)
            && changed.is_none_or(|changed| changed.contains(mutant))
    });
    Ok(chosen.map(|(index, _)| index).collect())
}

/// Whether a text contains one of these, or there are none.
fn contains_any(text: &str, words: &[String]) -> bool {
    words.is_empty() || words.iter().any(|word| text.contains(word))
}

/// What is tried between two looks at the clock: a file's mutants, or a few spread over all.
fn groups(all: &[Mutant], chosen: &[usize], spread: bool) -> Vec<Vec<usize>> {
    const AT_A_TIME: usize = 8;
    if spread {
        let rounds = chosen.len().div_ceil(AT_A_TIME);
        let round = |nth| chosen.iter().copied().skip(nth).step_by(rounds).collect();
        return (0..rounds).map(round).collect();
    }
    let same_file = |one: &usize, other: &usize| all[*one].file == all[*other].file;
    chosen.chunk_by(same_file).map(<[usize]>::to_vec).collect()
}

/// The mutants that cargo-mutants lists, and those of the configured operators.
fn list(
    workspace: &Workspace,
    lister: &Path,
    config: &Config,
    arguments: &[&std::ffi::OsStr],
) -> Result<Vec<Mutant>> {
    let mut ask = Command::new(lister);
    ask.args(["mutants", "--list", "--json", "--colors", "never"]);
    ask.args(["--package", &config.package]).args(arguments);
    let answer = ask.current_dir(&workspace.root).output();
    let answer = answer.map_err(NoLister)?;
    let error = String::from_utf8_lossy(&answer.stderr);
    ensure!(answer.status.success(), "{error}");
    let answer = String::from_utf8_lossy(&answer.stdout);
    let (mut mutants, functions) = mutant::parse(&answer, &workspace.root)?;
    let genres: Vec<_> = (operators::NAMES.iter())
        .filter(|(name, _)| config.operators.iter().any(|chosen| chosen == name))
        .map(|(_, genre)| *genre)
        .collect();
    for (file, functions) in functions.iter().filter(|_| !genres.is_empty()) {
        let text = std::fs::read_to_string(workspace.root.join(file));
        let own = operators::list(file, &text.context(file.clone())?, functions, &genres);
        mutants.extend(own.context(file.clone())?);
    }
    mutants.retain(|mutant| !config.without.iter().any(|part| mutant.file.contains(part)));
    Ok(mutants)
}

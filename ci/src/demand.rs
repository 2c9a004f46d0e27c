//! What runs on demand and by night: Kani, the fuzzer, mutants.

use std::path::Path;
use std::process::Command;

use crate::error::{failed, Error, Of, Result};
use crate::place::Place;
use crate::shell;

/// Why Kani is not run, and how it would be.
pub const NO_KANI: &str =
    "Kani is not installed (`cargo install --locked kani-verifier && cargo kani \
    setup`); the same properties ran exhaustively or sampled among the unit tests";

/// Kani's version, where it is installed with its bundle.
pub fn kani_version(place: &Place) -> Option<String> {
    shell::ask(place.cargo().args(["kani", "--version"]))
}

/// Proves every harness; the closing figure.
///
/// # Errors
/// Where a proof fails, or a cover cannot be reached: then its harness proves nothing.
pub fn prove(place: &Place) -> Result<String> {
    let mut kani = place.cargo();
    kani.arg("kani").current_dir(place.root.join("proofs"));
    let text = shell::tee(&mut kani)?;
    judge_kani(&text)
}

fn judge_kani(text: &str) -> Result<String> {
    let dead = text.lines().filter(|line| {
        let status = line.trim();
        status == "- Status: UNSATISFIABLE" || status == "- Status: UNREACHABLE_COVER"
    });
    let dead = dead.count() + text.lines().filter(|line| unsatisfied(line)).count();
    if dead > 0 {
        return failed(format!(
            "{dead} cover(s) cannot be reached: their harnesses prove nothing"
        ));
    }
    let complete = text
        .lines()
        .rev()
        .find(|line| line.starts_with("Complete - "));
    match complete {
        Some(line) => Ok(line.trim_start_matches("Complete - ").to_owned()),
        None => failed("Kani said nothing of having completed"),
    }
}

/// ` ** 1 of 2 cover properties satisfied`
fn unsatisfied(line: &str) -> bool {
    let line = line.trim().trim_start_matches('*').trim();
    let Some(numbers) = line.strip_suffix(" cover properties satisfied") else {
        return false;
    };
    numbers
        .split_once(" of ")
        .is_none_or(|(some, all)| some != all)
}

/// Why the fuzz targets cannot be run here, or `None`.
pub fn no_fuzz(place: &Place) -> Option<String> {
    let rustup = || Command::new("rustup");
    if !shell::installed("rustup")
        || shell::ask(rustup().args(["run", "nightly", "rustc", "--version"])).is_none()
    {
        return Some("no nightly Rust (`rustup toolchain install nightly`)".into());
    }
    if shell::ask(place.cargo().args(["fuzz", "--version"])).is_none() {
        return Some("cargo-fuzz is not installed (`cargo install --locked cargo-fuzz`)".into());
    }
    None
}

/// The names of the fuzz targets.
///
/// # Errors
/// Where their folder cannot be read.
pub fn fuzz_targets(place: &Place) -> Result<Vec<String>> {
    let folder = place.root.join("fuzz/fuzz_targets");
    let files = std::fs::read_dir(&folder).of(folder.display())?.flatten();
    let stem = |path: &Path| Some(path.file_stem()?.to_string_lossy().into_owned());
    let mut names: Vec<_> = files.filter_map(|file| stem(&file.path())).collect();
    names.sort();
    Ok(names)
}

/// How long to fuzz one target.
#[derive(Clone, Copy, Debug)]
pub enum Effort {
    /// The same inputs every time, from the committed corpus alone: for a gate, which must not fail
    /// by chance on a change that did nothing.
    Inputs(u32),
    /// Ever new inputs for so many seconds, building on what earlier runs learned.
    Seconds(u32),
}

/// Fuzzes one target from its committed corpus; what it learns stays in `target/fuzz/corpus`, what
/// breaks the target in `fuzz/artifacts`.
///
/// # Errors
/// Where the fuzzer found an input that breaks the target.
pub fn fuzz_one(place: &Place, target: &str, effort: Effort) -> Result<()> {
    let (folder, limits) = match effort {
        Effort::Inputs(count) => ("smoke", vec!["-seed=1".into(), format!("-runs={count}")]),
        Effort::Seconds(seconds) => ("corpus", vec![format!("-max_total_time={seconds}")]),
    };
    // New inputs go to the first folder; the committed seeds are only read.
    let learned = place.target.join("fuzz").join(folder).join(target);
    if matches!(effort, Effort::Inputs(_)) && learned.exists() {
        std::fs::remove_dir_all(&learned).of(learned.display())?;
    }
    std::fs::create_dir_all(&learned).of(learned.display())?;
    let mut fuzz = Command::new("rustup");
    fuzz.args(["run", "nightly", "cargo", "fuzz", "run", "--target-dir"]);
    fuzz.arg(place.target.join("fuzz"))
        .arg(target)
        .arg(&learned);
    fuzz.arg(place.root.join("fuzz/corpus").join(target))
        .arg("--")
        .args(limits);
    fuzz.current_dir(&place.root);
    fuzz.env_remove("CARGO")
        .env_remove("RUSTC")
        .env_remove("RUSTUP_TOOLCHAIN");
    shell::run(&mut fuzz)
}

/// Changes fw-core in every way cargo-mutants knows and lists the changes that no test notices.
///
/// # Errors
/// Where a mutant survived, or cargo-mutants is not installed.
pub fn mutants(place: &Place, more: &[String]) -> Result<()> {
    if shell::ask(place.cargo().args(["mutants", "--version"])).is_none() {
        return Err(Error::Missing(
            "cargo-mutants is not installed; `cargo install --locked cargo-mutants` gets it".into(),
        ));
    }
    let mut mutants = place.cargo();
    mutants.args([
        "mutants",
        "--package",
        "fw-core",
        "--test-package",
        "fw-core,proofs",
    ]);
    mutants.arg("--output").arg(&place.target).args(more);
    shell::run(&mut mutants)
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_dead_cover_fails_the_proofs() {
        let good = " ** 2 of 2 cover properties satisfied\nVERIFICATION:- SUCCESSFUL\n\
                    Complete - 7 successfully verified harnesses, 0 failures, 7 total.\n";
        assert!(judge_kani(good).unwrap().starts_with("7 successfully"));
        assert!(judge_kani(&good.replace("2 of 2", "1 of 2")).is_err());
        assert!(judge_kani("VERIFICATION:- SUCCESSFUL\n").is_err());
    }
}

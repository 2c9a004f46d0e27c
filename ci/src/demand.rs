//! What runs on demand and by night: Kani, mutants.

use crate::error::{failed, Error, Result};
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

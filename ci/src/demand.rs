//! What runs on demand and by night: mutants.

use crate::error::{Error, Result};
use crate::place::Place;
use crate::shell;

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

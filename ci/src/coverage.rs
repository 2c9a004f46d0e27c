//! How much of `fw-core` its tests run, in regions: pieces of code that run as a whole or not at all.

use xshell::cmd;

use crate::budget::Budget;
use crate::cargo_tool::CargoTool;
use crate::error::{Failure, Result, bail};
use crate::toolchain::in_rustlib;
use crate::workspace::Workspace;

const CARGO_LLVM_COV: CargoTool = CargoTool("llvm-cov", "0.9.1");

/// Sources that do not count: other packages, and files of tests.
const IGNORED: &str = "(/(tests|simulation)(/.*)?\\.rs$|/(plant|proofs|tests)/)";

/// Runs the tests, prints what they run of each file and the lines that they do not; fails below the
/// floor of `ci/budget.toml`, which is returned.
pub fn run(workspace: &Workspace) -> Result<String> {
    let has_tools = || !in_rustlib(&workspace.sysroot, "bin/llvm-profdata").is_empty();
    let add = cmd!(workspace.sh, "rustup component add llvm-tools");
    if !has_tools() && (add.run().is_err() || !has_tools()) {
        let missing =
            "the compiler's LLVM tools are not installed (`rustup component add llvm-tools`)";
        bail!(Failure::MissingProgram(missing.into()));
    }
    let floor = Budget::read(workspace)?
        .value("coverage.at_least.regions_percent")?
        .to_string();
    // Programs of an earlier state of the code would count as never run.
    CARGO_LLVM_COV
        .command(workspace)?
        .args(["clean", "--workspace"])
        .run()?;
    let words = "--locked --package fw-core --lib --tests --show-missing-lines";
    let measure = CARGO_LLVM_COV.command(workspace)?.args(words.split(' '));
    let measure = measure.args(["--ignore-filename-regex", IGNORED]);
    measure.args(["--fail-under-regions", &floor]).run()?;
    Ok(format!("at least {floor} % of the regions"))
}

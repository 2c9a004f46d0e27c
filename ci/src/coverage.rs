//! How much of `fw-core` its tests run, in regions: pieces of code that run as a whole or not at all.

use xshell::cmd;

use crate::budget::Budget;
use crate::cargo_tool::CargoTool;
use crate::error::{bail, Failure, Result};
use crate::process;
use crate::toolchain::has_llvm_tools;
use crate::workspace::Workspace;

const CARGO_LLVM_COV: CargoTool = CargoTool {
    subcommand: "llvm-cov",
    version: "0.9.1",
};

/// Sources whose own regions do not count: other packages, modules of tests and what only tests use.
const IGNORED: &str = "(/(tests|simulation)(/.*)?\\.rs$|/(plant|proofs|tests)/)";

/// Runs the tests, prints what they run of each file and the lines that they do not; fails below the
/// floor of `ci/budget.toml`. Returns the floor.
pub fn run(workspace: &Workspace) -> Result<String> {
    let sh = workspace.shell()?;
    if !has_llvm_tools(&workspace.sysroot) {
        let added = process::run(cmd!(sh, "rustup component add llvm-tools"));
        if added.is_err() || !has_llvm_tools(&workspace.sysroot) {
            bail!(Failure::MissingProgram(
                "the compiler's LLVM tools are not installed (`rustup component add llvm-tools`)"
                    .into()
            ));
        }
    }
    let floor = Budget::read(workspace)?.figure("coverage.at_least.regions_percent")?;
    let found = CARGO_LLVM_COV.find(workspace)?;
    // Programs of an earlier state of the code would count as never run.
    let mut clean = CARGO_LLVM_COV.command(workspace, &found);
    clean.args(["clean", "--workspace"]);
    process::run(clean)?;
    let mut measure = CARGO_LLVM_COV.command(workspace, &found);
    measure.args("--locked --package fw-core --lib --tests --show-missing-lines".split(' '));
    measure.args(["--ignore-filename-regex", IGNORED]);
    measure.args(["--fail-under-regions", &floor.to_string()]);
    process::run(measure)?;
    Ok(format!("at least {floor} % of the regions"))
}

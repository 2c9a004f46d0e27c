//! How much of `fw-core` its tests run, in regions: pieces of code that run as a whole or not at all.

use crate::budget::Budget;
use crate::error::Result;
use crate::process;
use crate::toolchain::in_rustlib;
use crate::workspace::Workspace;

/// Sources that do not count: other packages, and files of tests.
const IGNORED: &str = "(/(tests|simulation)(/.*)?\\.rs$|/(plant|proofs|tests)/)";

/// Runs the tests, prints what they run of each file and the lines that they do not; fails below the
/// floor of `ci/budget.toml`, which is returned.
pub fn run(workspace: &Workspace) -> Result<String> {
    let has_tools = || !in_rustlib(&workspace.sysroot, "bin/llvm-profdata").is_empty();
    let add = workspace.rustup("component add llvm-tools");
    process::require(has_tools, &add, "LLVM's part of the compiler")?;
    workspace.require_tool("llvm-cov@0.9.1")?;
    let budget = Budget::read(workspace)?;
    let floor = budget.value("coverage.at_least.regions_percent")?;
    // Programs of an earlier state of the code would count as never run.
    workspace.cargo("llvm-cov clean --workspace").run()?;
    let words = format!(
        "llvm-cov --locked --package fw-core --lib --tests --show-missing-lines \
         --fail-under-regions {floor} --ignore-filename-regex {IGNORED}"
    );
    workspace.cargo(&words).run()?;
    Ok(format!("at least {floor} % of the regions"))
}

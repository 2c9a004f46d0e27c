//! The mutants of fw-core, by `ci/mutation`.

use xshell::cmd;

use crate::cargo_tool::CargoTool;
use crate::error::{Failure, Result, bail};
use crate::process;
use crate::workspace::Workspace;

/// Lists the mutants.
const CARGO_MUTANTS: CargoTool = CargoTool("mutants", "27.1.0");

/// Tries mutants with these arguments of `ci/mutation`; its last line, `9 of 9 mutants, 0 findings`.
pub fn run(workspace: &Workspace, arguments: &[String]) -> Result<String> {
    let built = CARGO_MUTANTS.find(workspace)?;
    let lister = if built.as_os_str().is_empty() {
        "cargo".into()
    } else {
        built
    };
    let mutation = "run --quiet --package mutation -- --config ci/mutation.toml --lister";
    let mutation = workspace.cargo(mutation).arg(lister).args(arguments);
    let (success, text) = process::tee(mutation, |_| true)?;
    let last = text.trim().lines().last().unwrap_or_default();
    if !success {
        bail!(last.to_owned());
    }
    Ok(last.to_owned())
}

/// The mutants of the lines that changed in the core since the main branch, or on it since the commit
/// before, for a minute or so.
pub fn of_the_change(workspace: &Workspace) -> Result<String> {
    let sh = &workspace.sh;
    let commit = |name| process::output(cmd!(sh, "git rev-parse --verify --quiet {name}"));
    let main = commit("origin/main").filter(|main| Some(main) != commit("HEAD").as_ref());
    let Some(base) = main.or_else(|| commit("HEAD~1")) else {
        bail!(Failure::Skipped("no commit to compare with".into()));
    };
    let paths = [
        "fw-core/src",
        "ci/mutation.toml",
        "ci/mutation-excuses.toml",
    ];
    let changed = process::output(cmd!(
        sh,
        "git diff --merge-base {base} --name-only -- {paths...}"
    ));
    if changed.is_none_or(|files| files.is_empty()) {
        bail!(Failure::Skipped(format!(
            "nothing in the core changed since {base}"
        )));
    }
    let arguments = ["--since", &base, "--seconds", "60"];
    run(workspace, &arguments.map(str::to_owned))
}

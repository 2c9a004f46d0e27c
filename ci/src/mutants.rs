//! The mutants of fw-core, by `ci/mutation`.

use std::ffi::OsString;
use std::process::Command;

use crate::cargo_tool::{CargoTool, Found};
use crate::error::{bail, Failure, Result};
use crate::process;
use crate::workspace::Workspace;

/// Lists the mutants.
const CARGO_MUTANTS: CargoTool = CargoTool {
    subcommand: "mutants",
    version: "27.1.0",
};

/// Tries mutants with these arguments of `ci/mutation`; its last line, `9 of 9 mutants, 0 findings`.
pub fn run(workspace: &Workspace, arguments: &[String]) -> Result<String> {
    let lister = match CARGO_MUTANTS.find(workspace)? {
        Found::Machine => workspace.cargo("").get_program().to_owned(),
        Found::Built(program) => OsString::from(program),
    };
    let mut mutation = workspace.cargo("run --quiet --package mutation --");
    mutation.args(["--config", "ci/mutation.toml", "--lister"]);
    mutation.arg(lister).args(arguments);
    let (status, text) = process::tee(mutation, |_| true)?;
    let last = text.trim().lines().last().unwrap_or_default().to_owned();
    match status.code() {
        Some(0) => Ok(last),
        Some(2) => bail!(Failure::Usage(last)),
        Some(4) => bail!(Failure::MissingProgram(last)),
        _ => bail!(last),
    }
}

/// The mutants of the lines that changed in the core, for a minute or so; `None` where none did.
pub fn of_the_change(workspace: &Workspace) -> Result<Option<String>> {
    let git = |words: &str| {
        let mut git = Command::new("git");
        git.current_dir(&workspace.root).args(words.split(' '));
        process::output(git)
    };
    let head = git("rev-parse HEAD");
    // On the main branch itself the change is the last commit, and what is not committed.
    let main = git("rev-parse --verify origin/main").filter(|main| Some(main) != head.as_ref());
    let base = main.or_else(|| git("rev-parse --verify HEAD~1"));
    let Some(base) = base else {
        return Ok(None);
    };
    let paths = "fw-core/src ci/mutation.toml ci/mutation-excuses.toml";
    let changed = git(&format!("diff --merge-base {base} --name-only -- {paths}"));
    if changed.is_none_or(|files| files.is_empty()) {
        return Ok(None);
    }
    let arguments = ["--since", &base, "--seconds", "60"];
    run(workspace, &arguments.map(str::to_owned)).map(Some)
}

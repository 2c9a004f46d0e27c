//! The mutants of fw-core, by `ci/mutation`, which `cargo mutants` lists.

use xshell::cmd;

use crate::error::{Kind, Result, bail, fail};
use crate::process;
use crate::workspace::Workspace;

/// Tries mutants with these arguments of `ci/mutation`; its last line, `9 of 9 mutants, 0 findings`.
pub fn run(workspace: &Workspace, arguments: &[String]) -> Result<String> {
    workspace.require_tool("mutants@27.1.0")?;
    let words = "run --quiet --package mutation -- --config ci/mutation.toml --lister cargo";
    let (success, text) = process::tee(workspace.cargo(words).args(arguments))?;
    let last = text.trim().lines().last().unwrap_or_default().to_owned();
    if success { Ok(last) } else { bail!(last) }
}

/// The mutants of the lines that changed in the core since the main branch, or on it since the commit
/// before, for a minute or so.
pub fn of_the_change(workspace: &Workspace) -> Result<String> {
    let sh = &workspace.sh;
    let commit = |name| process::output(cmd!(sh, "git rev-parse --verify --quiet {name}"));
    let main = commit("origin/main").filter(|main| Some(main) != commit("HEAD").as_ref());
    let Some(base) = main.or_else(|| commit("HEAD~1")) else {
        return fail(Kind::Skipped, "no commit to compare with");
    };
    let diff = cmd!(sh, "git diff --merge-base {base} --name-only --");
    let changed = diff.args("fw-core/src ci/mutation.toml ci/mutation-excuses.toml".split(' '));
    if process::output(changed).is_none_or(|files| files.is_empty()) {
        return fail(
            Kind::Skipped,
            format!("nothing in the core changed since {base}"),
        );
    }
    let arguments = ["--since", &base, "--seconds", "60"];
    run(workspace, &arguments.map(str::to_owned))
}

//! The mutants of fw-core and host-link, by `ci/mutation`, which `cargo mutants` lists.

use xshell::cmd;

use crate::error::{Kind, Result, bail, fail};
use crate::process;
use crate::workspace::Workspace;

/// Each package's sources, configuration and excuses.
const PACKAGES: [[&str; 3]; 2] = [
    [
        "fw-core/src",
        "ci/mutation.toml",
        "ci/mutation-excuses.toml",
    ],
    [
        "host-link/src",
        "ci/mutation-host-link.toml",
        "ci/mutation-excuses-host-link.toml",
    ],
];

/// Tries mutants with these arguments of `ci/mutation`; its last line, `9 of 9 mutants, 0 findings`.
pub fn run(workspace: &Workspace, arguments: &[String]) -> Result<String> {
    run_packages(workspace, &PACKAGES, arguments)
}

fn run_packages(
    workspace: &Workspace,
    packages: &[[&str; 3]],
    arguments: &[String],
) -> Result<String> {
    workspace.require_tool("mutants@27.1.0")?;
    let mutation = workspace.cargo("run --quiet --package mutation -- --lister cargo");
    let configs = packages
        .iter()
        .flat_map(|[_, config, _]| ["--config", config]);
    let mutation = mutation.args(configs).args(arguments);
    let (success, text) = process::tee(mutation)?;
    let last = text.trim().lines().last().unwrap_or_default().to_owned();
    if success { Ok(last) } else { bail!(last) }
}

/// The mutants of the lines that changed in the packages since the main branch, or on it since the commit
/// before, for a minute or so.
pub fn of_the_change(workspace: &Workspace) -> Result<String> {
    let sh = &workspace.sh;
    let commit = |name| process::output(cmd!(sh, "git rev-parse --verify --quiet {name}"));
    let main = commit("origin/main").filter(|main| Some(main) != commit("HEAD").as_ref());
    let Some(base) = main.or_else(|| commit("HEAD~1")) else {
        return fail(Kind::Skipped, "no commit to compare with");
    };
    let mut changed = PACKAGES.to_vec();
    changed.retain(|package| {
        let diff = cmd!(
            sh,
            "git diff --merge-base {base} --name-only -- {package...}"
        );
        process::output(diff).is_some_and(|files| !files.is_empty())
    });
    if changed.is_empty() {
        let unchanged = format!("nothing in the packages changed since {base}");
        return fail(Kind::Skipped, unchanged);
    }
    let seconds = (60 / changed.len()).to_string();
    let arguments = ["--since", &base, "--seconds", &seconds];
    run_packages(workspace, &changed, &arguments.map(str::to_owned))
}

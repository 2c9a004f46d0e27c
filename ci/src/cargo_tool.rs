//! Cargo's subcommands that the machine may lack: found, or built below the target folder, which leaves
//! the machine's own cargo alone.

use std::path::PathBuf;

use xshell::{Cmd, cmd};

use crate::error::{Failure, Result, bail};
use crate::process;
use crate::workspace::Workspace;

/// A subcommand, and the version that is built where there is none.
pub struct CargoTool(pub &'static str, pub &'static str);

impl CargoTool {
    /// Where the program was built; an empty path where cargo knows the subcommand.
    fn installed(&self, workspace: &Workspace) -> Option<PathBuf> {
        let Self(subcommand, _) = self;
        if process::output(workspace.cargo(&format!("{subcommand} --version"))).is_some() {
            return Some(PathBuf::new());
        }
        let program = workspace
            .target
            .join(format!("tools/bin/cargo-{subcommand}"));
        process::output(cmd!(workspace.sh, "{program} {subcommand} --version"))?;
        Some(program)
    }

    /// Looks for it, and builds it where it is missing; where that fails, a
    /// [`Failure::MissingProgram`] says how to get it. Returns the program if it was
    /// built here, else an empty path.
    pub fn find(&self, workspace: &Workspace) -> Result<PathBuf> {
        if let Some(found) = self.installed(workspace) {
            return Ok(found);
        }
        let Self(subcommand, version) = self;
        let root = workspace.target.join("tools");
        // It starts other programs and waits: unoptimised it builds in half the time.
        let words = "install --debug --locked --quiet --root";
        let install = workspace
            .cargo(words)
            .arg(&root)
            .env("CARGO_PROFILE_DEV_DEBUG", "0");
        // Its own target folder: ours may be of another compiler's settings.
        let install = install.env("CARGO_TARGET_DIR", root.join("build"));
        let built = install.arg(format!("cargo-{subcommand}@{version}")).run();
        let Some(found) = built.ok().and_then(|()| self.installed(workspace)) else {
            bail!(Failure::MissingProgram(format!(
                "cargo-{subcommand} is not installed and could not be (`cargo install --locked \
                 cargo-{subcommand}`)"
            )));
        };
        Ok(found)
    }

    /// The command that runs it, found or built.
    pub fn command<'s>(&self, workspace: &'s Workspace) -> Result<Cmd<'s>> {
        let program = self.find(workspace)?;
        Ok(if program.as_os_str().is_empty() {
            workspace.cargo(self.0)
        } else {
            workspace.sh.cmd(program).arg(self.0)
        })
    }
}

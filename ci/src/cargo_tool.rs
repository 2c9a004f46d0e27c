//! Cargo's subcommands that the machine may lack: found, or built below the target folder, which leaves
//! the machine's own cargo alone.

use std::path::PathBuf;
use std::process::Command;

use crate::error::{bail, Failure, Result};
use crate::process;
use crate::workspace::Workspace;

pub struct CargoTool {
    /// What comes after `cargo`.
    pub subcommand: &'static str,
    /// The version that is built where there is none.
    pub version: &'static str,
}

/// Where a tool was found.
pub enum Found {
    /// Cargo knows it.
    Machine,
    /// Built here: the program.
    Built(PathBuf),
}

impl CargoTool {
    fn installed(&self, workspace: &Workspace) -> Option<Found> {
        let Self { subcommand, .. } = self;
        if process::output(workspace.cargo(&format!("{subcommand} --version"))).is_some() {
            return Some(Found::Machine);
        }
        let program = workspace
            .target
            .join(format!("tools/bin/cargo-{subcommand}"));
        let mut version = Command::new(&program);
        version.args([subcommand, "--version"]);
        process::output(version).map(|_| Found::Built(program))
    }

    /// Looks for it, and builds it where it is missing; where that fails, a
    /// [`Failure::MissingProgram`] says how to get it.
    pub fn find(&self, workspace: &Workspace) -> Result<Found> {
        if let Some(found) = self.installed(workspace) {
            return Ok(found);
        }
        let (name, version) = (format!("cargo-{}", self.subcommand), self.version);
        let root = workspace.target.join("tools");
        let folder = workspace.relative(&root);
        println!("set-up: {name} is not installed; building {version} in {folder}");
        // It starts other programs and waits: unoptimised it builds in half the time.
        let words = format!("install --debug --locked --quiet {name} --version {version} --root");
        let mut install = workspace.cargo(&words);
        install.arg(&root).env("CARGO_PROFILE_DEV_DEBUG", "0");
        // Its own target folder: ours may be of another compiler's settings.
        install.env("CARGO_TARGET_DIR", root.join("build"));
        let built = process::run(install);
        match built.ok().and_then(|()| self.installed(workspace)) {
            Some(found) => Ok(found),
            None => bail!(Failure::MissingProgram(format!(
                "{name} is not installed and could not be (`cargo install --locked {name}`)"
            ))),
        }
    }

    /// The command that runs it, in the workspace's root.
    pub fn command(&self, workspace: &Workspace, found: &Found) -> Command {
        let mut command = match found {
            Found::Machine => workspace.cargo(""),
            Found::Built(program) => Command::new(program),
        };
        command.current_dir(&workspace.root).arg(self.subcommand);
        command
    }
}

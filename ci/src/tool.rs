//! Cargo's subcommands that the machine may lack: found, or built below the target folder, which leaves
//! the machine's own cargo alone.

use std::path::PathBuf;
use std::process::Command;

use crate::error::{Error, Result};
use crate::place::Place;
use crate::shell;

/// A subcommand of cargo.
pub struct Tool {
    /// What comes after `cargo`.
    pub subcommand: &'static str,
    /// The version that is built where there is none.
    pub version: &'static str,
}

/// Where a tool was found.
pub enum Found {
    /// Cargo knows it.
    Machine,
    /// It is our own: the program.
    Ours(PathBuf),
}

impl Tool {
    /// Looks for it, without building anything.
    fn installed(&self, place: &Place) -> Option<Found> {
        let ask = [self.subcommand, "--version"];
        if shell::ask(place.cargo().args(ask)).is_some() {
            return Some(Found::Machine);
        }
        let program = place
            .target
            .join("tools/bin")
            .join(format!("cargo-{}", self.subcommand));
        shell::ask(Command::new(&program).args(ask))?;
        Some(Found::Ours(program))
    }

    /// Looks for it, and builds it where it is missing.
    ///
    /// # Errors
    /// [`Error::Missing`] where it cannot be built; says how to get it.
    pub fn find(&self, place: &Place) -> Result<Found> {
        if let Some(found) = self.installed(place) {
            return Ok(found);
        }
        let name = format!("cargo-{}", self.subcommand);
        let root = place.target.join("tools");
        println!(
            "set-up: {name} is not installed; building {} in {}",
            self.version,
            place.short(&root)
        );
        let mut install = place.cargo();
        // They start other programs and wait: half the time to build for some tenths of a second to run.
        install.args(["install", "--debug", "--locked", "--quiet", &name]);
        install.env("CARGO_PROFILE_DEV_DEBUG", "0");
        install
            .args(["--version", self.version])
            .arg("--root")
            .arg(&root);
        // Its own target folder: ours may be of another compiler's settings.
        install.env("CARGO_TARGET_DIR", root.join("build"));
        let built = shell::run(&mut install);
        let found = built.ok().and_then(|()| self.installed(place));
        found.ok_or_else(|| {
            Error::Missing(format!(
                "{name} is not installed and could not be (`cargo install --locked {name}`)"
            ))
        })
    }

    /// The command that runs it, in the workspace's root.
    pub fn command(&self, place: &Place, found: &Found) -> Command {
        let mut command = match found {
            Found::Machine => place.cargo(),
            Found::Ours(program) => Command::new(program),
        };
        command.current_dir(&place.root).arg(self.subcommand);
        command
    }
}

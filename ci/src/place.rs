//! Where we are: the workspace, its target folder, the machine's compiler.

use std::path::{Path, PathBuf};
use std::process::Command;

use tinyjson::JsonValue;

use crate::error::{failed, Error, Of, Result};
use crate::json::{self, list, text};
use crate::shell;

/// The workspace on this machine.
pub struct Place {
    /// The workspace's root.
    pub root: PathBuf,
    /// Cargo's target folder.
    pub target: PathBuf,
    /// The compiler's sysroot.
    pub sysroot: PathBuf,
    /// The compiler's release, as (major, minor).
    pub rustc: (u32, u32),
    /// The root files of our own crates, with the folder of their package.
    pub crates: Vec<CrateRoot>,
}

/// A crate of the workspace.
pub struct CrateRoot {
    /// The package's name.
    pub package: String,
    /// `lib`, `bin`, `test`, …
    pub kind: String,
    /// Its root file.
    pub file: PathBuf,
}

impl Place {
    /// Finds the workspace this program was built from, and asks cargo and rustc about it.
    ///
    /// # Errors
    /// Where cargo or rustc do not answer.
    pub fn find() -> Result<Self> {
        let root = Path::new(env!("CARGO_MANIFEST_DIR"))
            .parent()
            .map(Path::to_path_buf);
        let root = root.ok_or_else(|| Error::Failed("the ci folder has no parent".into()))?;
        let metadata = metadata(&root, &["--no-deps"])?;
        let target = text(&metadata, "target_directory")
            .map(PathBuf::from)
            .unwrap_or_default();
        let sysroot = PathBuf::from(ask_rustc(&["--print", "sysroot"])?);
        let rustc = release(&ask_rustc(&["--version"])?);
        leave_cargo(&target, &sysroot);
        Ok(Self {
            crates: crates(&metadata),
            root,
            target,
            sysroot,
            rustc,
        })
    }

    /// The machine's cargo, started in the workspace's root.
    pub fn cargo(&self) -> Command {
        let mut command = cargo();
        command.current_dir(&self.root);
        command
    }

    /// `--ignore-rust-version` where a dependency asks for a newer compiler than this one.
    pub fn ignore_rust_version(&self) -> Result<Option<&'static str>> {
        let all = metadata(&self.root, &[])?;
        let newest = packages(&all)
            .iter()
            .filter_map(|package| text(package, "rust_version"))
            .map(version)
            .max()
            .unwrap_or((0, 0));
        Ok((newest > self.rustc).then_some("--ignore-rust-version"))
    }

    /// A file of the workspace, as text.
    ///
    /// # Errors
    /// Names the file.
    pub fn read(&self, file: &str) -> Result<String> {
        std::fs::read_to_string(self.root.join(file)).of(file)
    }

    /// A path without the workspace's root in front.
    pub fn short<'a>(&self, path: &'a Path) -> std::path::Display<'a> {
        path.strip_prefix(&self.root).unwrap_or(path).display()
    }
}

fn cargo() -> Command {
    Command::new(std::env::var_os("CARGO").unwrap_or_else(|| "cargo".into()))
}

fn ask_rustc(words: &[&str]) -> Result<String> {
    let rustc = std::env::var_os("RUSTC").unwrap_or_else(|| "rustc".into());
    shell::ask(Command::new(rustc).args(words))
        .ok_or_else(|| Error::Missing("rustc does not answer; install Rust with rustup".into()))
}

fn metadata(root: &Path, words: &[&str]) -> Result<JsonValue> {
    let mut command = cargo();
    command
        .current_dir(root)
        .args(["metadata", "--format-version", "1"])
        .args(words);
    let Some(answer) = shell::ask(&mut command) else {
        return failed(format!(
            "`{}` failed; run it to see why",
            shell::shown(&command)
        ));
    };
    json::parse(&answer, "cargo metadata")
}

fn packages(metadata: &JsonValue) -> &[JsonValue] {
    list(metadata, "packages")
}

fn crates(metadata: &JsonValue) -> Vec<CrateRoot> {
    let mut roots = Vec::new();
    for package in packages(metadata) {
        for target in list(package, "targets") {
            let kind = list(target, "kind")
                .first()
                .and_then(|kind| kind.get::<String>());
            if let (Some(name), Some(kind), Some(file)) =
                (text(package, "name"), kind, text(target, "src_path"))
            {
                roots.push(CrateRoot {
                    package: name.to_owned(),
                    kind: kind.clone(),
                    file: file.into(),
                });
            }
        }
    }
    roots
}

/// The first two numbers of `1.95.0`.
pub fn version(text: &str) -> (u32, u32) {
    let mut numbers = text
        .split(['.', '-'])
        .map(|number| number.parse().unwrap_or(0));
    (numbers.next().unwrap_or(0), numbers.next().unwrap_or(0))
}

/// The release in `rustc 1.95.0 (…)`.
pub fn release(answer: &str) -> (u32, u32) {
    version(answer.split(' ').nth(1).unwrap_or(""))
}

/// Takes what `cargo run` told this program about itself out of the environment: the cargos started
/// from here would take it for their own.
fn leave_cargo(target: &Path, sysroot: &Path) {
    let keys: Vec<String> = std::env::vars_os()
        .filter_map(|(key, _)| key.into_string().ok())
        .collect();
    for key in keys {
        let ours = ["CARGO_PKG_", "CARGO_MANIFEST_"]
            .iter()
            .any(|start| key.starts_with(start));
        if ours {
            std::env::remove_var(key);
        }
    }
    if let Some(paths) = std::env::var_os("LD_LIBRARY_PATH") {
        let own = |path: &PathBuf| !path.starts_with(target) && !path.starts_with(sysroot);
        match std::env::join_paths(std::env::split_paths(&paths).filter(own)) {
            Ok(left) if !left.is_empty() => std::env::set_var("LD_LIBRARY_PATH", left),
            _ => std::env::remove_var("LD_LIBRARY_PATH"),
        }
    }
}

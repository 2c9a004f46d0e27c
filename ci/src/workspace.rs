//! The workspace on this machine: its folders, its packages, the compiler.

use std::path::{Path, PathBuf};
use std::process::Command;
use std::sync::OnceLock;

use serde_json::Value;
use xshell::Shell;

use crate::error::{Context, Failure, Result};
use crate::process;

pub struct Workspace {
    pub root: PathBuf,
    /// Cargo's target folder.
    pub target: PathBuf,
    /// The compiler's sysroot.
    pub sysroot: PathBuf,
    /// The compiler's release: major, minor.
    rustc: (u32, u32),
    /// What cargo says of all packages, dependencies included.
    metadata: OnceLock<Value>,
}

impl Workspace {
    /// The workspace that this program was built from.
    pub fn find() -> Result<Self> {
        let root = Path::new(env!("CARGO_MANIFEST_DIR")).parent();
        let root = root.context("the ci folder has no parent")?.to_path_buf();
        let no_deps = metadata(&root, "Cargo.toml", &["--no-deps"])?;
        let target = PathBuf::from(text(&no_deps["target_directory"]));
        let sysroot = PathBuf::from(rustc(&["--print", "sysroot"])?);
        let version = release(&rustc(&["--version"])?);
        clean_environment(&target, &sysroot);
        Ok(Self {
            root,
            target,
            sysroot,
            rustc: version,
            metadata: OnceLock::new(),
        })
    }

    /// A shell that stands in the workspace's root.
    pub fn shell(&self) -> Result<Shell> {
        let shell = Shell::new()?;
        shell.change_dir(&self.root);
        Ok(shell)
    }

    /// The machine's cargo, started in the workspace's root; `words` are parted by blanks.
    pub fn cargo(&self, words: &str) -> Command {
        let mut command = cargo();
        command
            .current_dir(&self.root)
            .args(words.split_whitespace());
        command
    }

    /// [`Self::cargo`] on packages that need the virtual board's crate: its declared compiler may be
    /// newer than this one.
    pub fn cargo_with_board(&self, words: &str) -> Result<Command> {
        let mut command = self.cargo(words);
        let versions = list(&self.metadata()?["packages"]).iter();
        let newest = versions
            .map(|package| version(text(&package["rust_version"])))
            .max();
        if newest > Some(self.rustc) {
            command.arg("--ignore-rust-version");
        }
        Ok(command)
    }

    /// What `cargo metadata` says, dependencies included.
    pub fn metadata(&self) -> Result<&Value> {
        if let Some(known) = self.metadata.get() {
            return Ok(known);
        }
        let all = metadata(&self.root, "Cargo.toml", &[])?;
        Ok(self.metadata.get_or_init(|| all))
    }

    /// The packages of the workspace with this manifest, without dependencies.
    pub fn packages(&self, manifest: &str) -> Result<Vec<Value>> {
        let metadata = metadata(&self.root, manifest, &["--no-deps"])?;
        Ok(list(&metadata["packages"]).to_vec())
    }

    /// A file of the workspace, as text.
    pub fn read(&self, file: impl AsRef<Path>) -> Result<String> {
        let file = file.as_ref();
        std::fs::read_to_string(self.root.join(file)).with_context(|| file.display().to_string())
    }

    /// A path relative to the workspace's root.
    pub fn relative<'a>(&self, path: &'a Path) -> std::path::Display<'a> {
        path.strip_prefix(&self.root).unwrap_or(path).display()
    }

    /// Every file below `folder` that was neither built nor belongs to git, in order.
    pub fn files(&self, folder: impl AsRef<Path>) -> Result<Vec<PathBuf>> {
        let mut files = Vec::new();
        let mut folders = vec![self.root.join(folder)];
        while let Some(folder) = folders.pop() {
            let entries = std::fs::read_dir(&folder);
            for entry in entries
                .with_context(|| folder.display().to_string())?
                .flatten()
            {
                let (path, name) = (entry.path(), entry.file_name());
                if !path.is_dir() {
                    files.push(path);
                } else if path != self.target && name != "target" && name != ".git" {
                    folders.push(path);
                }
            }
        }
        files.sort();
        Ok(files)
    }

    /// Every Rust file.
    pub fn rust_files(&self) -> Result<Vec<PathBuf>> {
        let mut files = self.files("")?;
        files.retain(|file| file.extension().is_some_and(|ending| ending == "rs"));
        Ok(files)
    }
}

fn cargo() -> Command {
    Command::new(std::env::var_os("CARGO").unwrap_or_else(|| "cargo".into()))
}

fn rustc(words: &[&str]) -> Result<String> {
    let mut rustc = Command::new(std::env::var_os("RUSTC").unwrap_or_else(|| "rustc".into()));
    rustc.args(words);
    let missing = "rustc does not answer; install Rust with rustup";
    process::output(rustc).context(Failure::MissingProgram(missing.into()))
}

fn metadata(root: &Path, manifest: &str, words: &[&str]) -> Result<Value> {
    let mut command = cargo();
    command
        .current_dir(root)
        .args(["metadata", "--format-version", "1"]);
    command.args(["--manifest-path", manifest]).args(words);
    let shown = process::display(&command);
    let answer =
        process::output(command).with_context(|| format!("`{shown}` failed; run it to see why"))?;
    serde_json::from_str(&answer).context("cargo metadata")
}

/// The entries of a JSON list; none where it is no list.
pub fn list(value: &Value) -> &[Value] {
    value.as_array().map_or(&[], Vec::as_slice)
}

/// A JSON string; empty where it is none.
pub fn text(value: &Value) -> &str {
    value.as_str().unwrap_or_default()
}

/// The first two numbers of `1.95.0`.
fn version(text: &str) -> (u32, u32) {
    let mut numbers = text
        .split(['.', '-'])
        .map(|number| number.parse().unwrap_or(0));
    (numbers.next().unwrap_or(0), numbers.next().unwrap_or(0))
}

/// The release in `rustc 1.95.0 (…)`.
pub fn release(answer: &str) -> (u32, u32) {
    version(answer.split(' ').nth(1).unwrap_or(""))
}

/// Removes what `cargo run` set for this program alone: the cargos started from here would read it.
fn clean_environment(target: &Path, sysroot: &Path) {
    let ours = |key: &str| key.starts_with("CARGO_PKG_") || key.starts_with("CARGO_MANIFEST_");
    let keys = std::env::vars_os().filter_map(|(key, _)| key.into_string().ok());
    for key in keys.filter(|key| ours(key)).collect::<Vec<_>>() {
        std::env::remove_var(key);
    }
    if let Some(paths) = std::env::var_os("LD_LIBRARY_PATH") {
        let foreign = |path: &PathBuf| !path.starts_with(target) && !path.starts_with(sysroot);
        match std::env::join_paths(std::env::split_paths(&paths).filter(foreign)) {
            Ok(left) if !left.is_empty() => std::env::set_var("LD_LIBRARY_PATH", left),
            _ => std::env::remove_var("LD_LIBRARY_PATH"),
        }
    }
}

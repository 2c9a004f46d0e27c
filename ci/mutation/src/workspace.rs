//! The workspace under test, and a copy of it to change.

use std::io;
use std::path::{Path, PathBuf};
use std::process::Command;

use anyhow::{Context, Result};
use serde_json::Value;

/// Where things are.
pub struct Workspace {
    /// The workspace's root.
    pub root: PathBuf,
    /// Its target folder.
    pub target: PathBuf,
    /// The root file of the package's library, from the workspace's root.
    pub library: PathBuf,
}

impl Workspace {
    /// Asks cargo in `folder` for the workspace and the package's library, or program.
    ///
    /// # Errors
    /// Where there is no such package.
    pub fn find(folder: &Path, package: &str) -> Result<Self> {
        let mut ask = cargo();
        ask.args(["metadata", "--no-deps", "--format-version", "1"]);
        let answer = ask.current_dir(folder).output().context("cargo metadata")?;
        let metadata: Value = serde_json::from_slice(&answer.stdout)
            .with_context(|| String::from_utf8_lossy(&answer.stderr).into_owned())?;
        let path = |value: &Value| PathBuf::from(value.as_str().unwrap_or_default());
        let root = path(&metadata["workspace_root"]);
        let packages = metadata["packages"].as_array().into_iter().flatten();
        let mut targets = packages
            .filter(|found| found["name"] == package)
            .flat_map(|package| package["targets"].as_array().into_iter().flatten());
        let library = targets.find(|target| {
            ["lib", "bin"].contains(&target["kind"][0].as_str().unwrap_or_default())
        });
        let library = library.map(|library| path(&library["src_path"]));
        let library = library.with_context(|| format!("no package {package}"))?;
        Ok(Self {
            library: library.strip_prefix(&root).unwrap_or(&library).to_owned(),
            root,
            target: path(&metadata["target_directory"]),
        })
    }

    /// Brings `to` up to date with the workspace.
    ///
    /// # Errors
    /// Where a file cannot be copied.
    pub fn copy(&self, to: &Path) -> Result<()> {
        mirror(&self.root, &self.target, to).with_context(|| to.display().to_string())
    }
}

/// The machine's cargo.
pub fn cargo() -> Command {
    Command::new(std::env::var_os("CARGO").unwrap_or_else(|| "cargo".into()))
}

/// The sources in a folder, a module before those inside it.
///
/// # Errors
/// Where a folder cannot be read.
pub fn sorted(folder: &Path) -> Result<Vec<PathBuf>> {
    let (mut folders, mut files) = (vec![folder.to_owned()], Vec::new());
    while let Some(folder) = folders.pop() {
        let shown = || folder.display().to_string();
        for entry in std::fs::read_dir(&folder).with_context(shown)? {
            let path = entry.with_context(shown)?.path();
            if path.is_dir() {
                folders.push(path);
            } else if path.extension().is_some_and(|kind| kind == "rs") {
                files.push(path);
            }
        }
    }
    files.sort_by_key(|path| module(path));
    Ok(files)
}

/// The folder of the modules inside a file's.
pub fn module(file: &Path) -> PathBuf {
    match file.file_stem().and_then(|stem| stem.to_str()) {
        Some("mod" | "lib" | "main") => file.with_file_name("").components().collect(),
        _ => file.with_extension(""),
    }
}

/// The start of the names of the tests next to a file: `wire::crc` and `wire::tests::` of
/// `fw-core/src/wire/crc.rs`.
pub fn near(file: &str) -> Vec<String> {
    let inside = file.split_once("src/").map_or(file, |(_, inside)| inside);
    let mut modules = inside.trim_end_matches(".rs").split('/');
    let outer = modules.next().unwrap_or_default();
    match modules.next() {
        None if outer == "lib" => Vec::new(),
        None | Some("mod") => vec![format!("{outer}::")],
        Some(inner) => vec![format!("{outer}::{inner}"), format!("{outer}::tests::")],
    }
}

/// Makes `to` a copy of `from` without `target` and git's files. Equal files keep their time, so
/// that cargo builds only what changed.
fn mirror(from: &Path, target: &Path, to: &Path) -> io::Result<()> {
    std::fs::create_dir_all(to)?;
    let mut kept = Vec::new();
    for entry in std::fs::read_dir(from)? {
        let entry = entry?;
        let (path, name) = (entry.path(), entry.file_name());
        if path == target || name == "target" || name == ".git" {
            continue;
        }
        let copy = to.join(&name);
        kept.push(name);
        if path.is_dir() {
            mirror(&path, target, &copy)?;
        } else if std::fs::read(&path)? != std::fs::read(&copy).unwrap_or_default() {
            std::fs::copy(&path, &copy)?;
        }
    }
    for entry in std::fs::read_dir(to)? {
        let entry = entry?;
        if kept.contains(&entry.file_name()) {
            continue;
        }
        if entry.path().is_dir() {
            std::fs::remove_dir_all(entry.path())?;
        } else {
            std::fs::remove_file(entry.path())?;
        }
    }
    Ok(())
}

/// Rewrites a file.
///
/// # Errors
/// Where it cannot be read, understood or written.
pub fn edit(file: &Path, new: impl FnOnce(&str) -> syn::Result<String>) -> Result<()> {
    let shown = || file.display().to_string();
    let text = std::fs::read_to_string(file).with_context(shown)?;
    let text = new(&text).with_context(shown)?;
    std::fs::write(file, text).with_context(shown)
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn tests_near_a_file_are_those_of_its_module() {
        let of = |file| near(file).join(" ");
        let slip = "fw-core/src/motion/odometry/slip.rs";
        assert_eq!(of(slip), "motion::odometry motion::tests::");
        assert_eq!(of("fw-core/src/robot/mod.rs"), "robot::");
        assert_eq!(of("src/log.rs"), "log::");
        assert_eq!(of("src/lib.rs"), "");
    }
}

//! The gate on what no lint of the compiler's covers across the workspace.

use std::path::{Path, PathBuf};
use std::process::Command;

use super::{passed, Context, Verdict};
use crate::code;
use crate::error::{failed, Of, Result};
use crate::place::Place;
use crate::shell;

/// The one package that may be unsafe: it touches registers.
const UNSAFE_PACKAGE: &str = "fw-pac";

pub fn hygiene(context: &mut Context) -> Result<Verdict> {
    let place = &context.place;
    let mut wrong = Vec::new();
    roots_forbid_unsafe(place, &mut wrong)?;
    let files = no_unsafe_elsewhere(place, &mut wrong)?;
    for name in ["rust-toolchain", "rust-toolchain.toml"] {
        if place.root.join(name).exists() {
            wrong.push(format!(
                "{name}: breaks every cargo call where what it lists cannot be fetched"
            ));
        }
    }
    for name in [
        "LICENSE-MIT",
        "LICENSE-APACHE",
        "README.md",
        "Cargo.lock",
        "fuzz/Cargo.lock",
        "tests/bench/Cargo.lock",
    ] {
        if !place.root.join(name).is_file() {
            wrong.push(format!("{name} is missing"));
        }
    }
    lock_is_current(place, &mut wrong);
    for line in &wrong {
        println!("  {line}");
    }
    match wrong.first() {
        None => passed(format!("{files} files")),
        Some(first) => failed(format!("{} finding(s), the first: {first}", wrong.len())),
    }
}

fn roots_forbid_unsafe(place: &Place, wrong: &mut Vec<String>) -> Result<()> {
    for root in &place.crates {
        let shipped = ["lib", "bin"].contains(&root.kind.as_str());
        if !shipped || root.package == UNSAFE_PACKAGE {
            continue;
        }
        let source = std::fs::read_to_string(&root.file).of(root.file.display())?;
        if !code::bare(&source).contains("#![forbid(unsafe_code)]") {
            wrong.push(format!(
                "{}: no #![forbid(unsafe_code)]",
                place.short(&root.file)
            ));
        }
    }
    Ok(())
}

/// The number of files that were read.
fn no_unsafe_elsewhere(place: &Place, wrong: &mut Vec<String>) -> Result<usize> {
    let mut files = Vec::new();
    sources(&place.root, &place.target, &mut files)?;
    for file in &files {
        if file.starts_with(place.root.join(UNSAFE_PACKAGE)) {
            continue;
        }
        let source = std::fs::read_to_string(file).of(file.display())?;
        for line in code::lines_with(&code::bare(&source), "unsafe") {
            wrong.push(format!(
                "{}:{line}: unsafe outside {UNSAFE_PACKAGE}",
                place.short(file)
            ));
        }
    }
    Ok(files.len())
}

/// Every Rust file below `folder`, without what was built or belongs to git.
pub fn sources(folder: &Path, target: &Path, files: &mut Vec<PathBuf>) -> Result<()> {
    let mut entries: Vec<_> = std::fs::read_dir(folder)
        .of(folder.display())?
        .flatten()
        .collect();
    entries.sort_by_key(std::fs::DirEntry::file_name);
    for entry in entries {
        let path = entry.path();
        let name = entry.file_name();
        if path.is_dir() {
            let hidden = name.to_string_lossy().starts_with('.');
            if path != target && name != "target" && !hidden {
                sources(&path, target, files)?;
            }
        } else if path.extension().is_some_and(|ending| ending == "rs") {
            files.push(path);
        }
    }
    Ok(())
}

/// A `Cargo.lock` that git does not keep, or that cargo had to change, builds something else
/// elsewhere.
fn lock_is_current(place: &Place, wrong: &mut Vec<String>) {
    let mut kept = Command::new("git");
    kept.current_dir(&place.root)
        .args(["ls-files", "--error-unmatch", "Cargo.lock"]);
    if place.root.join(".git").exists() && shell::ask(&mut kept).is_none() {
        wrong.push("Cargo.lock is not committed".into());
    }
    let mut locked = place.cargo();
    locked.args(["metadata", "--locked", "--format-version", "1"]);
    if shell::ask(&mut locked).is_none() {
        wrong.push("Cargo.lock is not up to date (`cargo metadata --locked` says why)".into());
    }
}

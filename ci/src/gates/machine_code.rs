//! Gates on the release ELF: what the source cannot show.

use std::path::Path;

use super::{passed, Context, Verdict};
use crate::elf::{Elf, Sizes, BANNED};
use crate::error::{failed, Error, Of, Result};
use crate::firmware::Edition;
use crate::numbers::Budget;
use crate::{firmware, shell};

pub fn budget(context: &mut Context) -> Result<Verdict> {
    let mut told = Vec::new();
    let mut over = Vec::new();
    for edition in Edition::ALL {
        let sizes = context.edition(edition)?.sizes;
        hold(edition, sizes, &context.budget()?, &mut over)?;
        told.push(format!("{} + {}", sizes.flash, sizes.ram));
    }
    if over.is_empty() {
        passed(format!("flash + static RAM {} bytes", told[0]))
    } else {
        failed(over.join("; "))
    }
}

/// The figures of an edition against its bars.
fn hold(edition: Edition, sizes: Sizes, budget: &Budget, over: &mut Vec<String>) -> Result<()> {
    for (key, bar) in budget.section(edition.budget()) {
        let size = match key {
            "flash_bytes" => sizes.flash,
            "static_ram_bytes" => sizes.ram,
            _ => return failed(format!("ci/budget.toml: a firmware has no figure {key}")),
        };
        #[expect(
            clippy::cast_precision_loss,
            reason = "a chip has less than 2^52 bytes"
        )]
        let size = size as f64;
        if size > bar {
            over.push(format!(
                "{key} of {} is {size}, the budget is {bar}",
                edition.name()
            ));
        }
    }
    Ok(())
}

pub fn contents(context: &mut Context) -> Result<Verdict> {
    let mut wrong = Vec::new();
    let mut judged = Vec::new();
    for edition in Edition::ALL {
        let path = context.edition(edition)?.path.clone();
        let bytes = std::fs::read(&path).of(path.display())?;
        let elf = Elf::parse(&bytes)?;
        let symbols = elf.symbols();
        if symbols.is_empty() {
            return failed(format!("{} has no symbols to judge", edition.name()));
        }
        let mut found = elf.bad_vectors()?;
        for kind in &BANNED {
            for symbol in kind.among(&symbols) {
                found.push(format!("{}: {symbol}", kind.what));
            }
        }
        for path in host_paths(context) {
            if elf.contains(&path) {
                found.push(format!("a path of this machine: {path}"));
            }
        }
        let named = |finding| format!("{}: {finding}", edition.name());
        wrong.extend(found.into_iter().map(named));
        judged.push(symbols.len().to_string());
    }
    for line in &wrong {
        println!("  {line}");
    }
    match wrong.first() {
        None => passed(format!("{} symbols judged", judged.join(" + "))),
        Some(first) => failed(format!("{} finding(s), the first: {first}", wrong.len())),
    }
}

/// What would betray where the ELF was built.
fn host_paths(context: &Context) -> Vec<String> {
    let home = std::env::var("HOME").unwrap_or_default();
    let mut paths = vec![
        format!("{}/", context.place.root.display()),
        format!("{}/", firmware::cargo_home().display()),
        format!("{}/", context.place.sysroot.display()),
        format!("{home}/"),
    ];
    // Where HOME is / or nothing it tells nothing.
    paths.retain(|path| path.len() > 2);
    if let Some(arm) = &context.arm {
        paths.extend(
            arm.remap
                .iter()
                .map(|(from, _)| format!("{}/", from.display())),
        );
    }
    paths
}

pub fn reproducible(context: &mut Context) -> Result<Verdict> {
    let first = context.image()?.path.clone();
    // Elsewhere and deeper, so that no path has the same length by chance.
    let elsewhere = context
        .place
        .target
        .join("reproducible/a folder of another length");
    if elsewhere.exists() {
        std::fs::remove_dir_all(&elsewhere).of(elsewhere.display())?;
    }
    copy_sources(&context.place.root, &context.place.target, &elsewhere)?;
    let Context { place, arm, .. } = context;
    let arm = arm
        .as_ref()
        .ok_or_else(|| Error::SetUp("no way to build".into()))?;
    let second = firmware::build_in(
        place,
        arm,
        &elsewhere,
        &elsewhere.join("target"),
        Edition::Full,
        "",
    )?;
    let bytes = |path: &Path| std::fs::read(path).of(path.display());
    let (one, other) = (bytes(&first)?, bytes(&second)?);
    if one == other {
        std::fs::remove_dir_all(&elsewhere).of(elsewhere.display())?;
        return passed(format!(
            "{} bytes alike, debugging information included",
            one.len()
        ));
    }
    let at = one
        .iter()
        .zip(&other)
        .position(|(a, b)| a != b)
        .unwrap_or(one.len().min(other.len()));
    failed(format!(
        "{} and {} differ from byte {at:#x} on",
        first.display(),
        second.display()
    ))
}

/// The workspace without what was built from it.
fn copy_sources(root: &Path, target: &Path, to: &Path) -> Result<()> {
    for entry in std::fs::read_dir(root).of(root.display())?.flatten() {
        let path = entry.path();
        let name = entry.file_name();
        if path == target || name == "target" || name == ".git" {
            continue;
        }
        if path.is_dir() {
            copy_sources(&path, target, &to.join(name))?;
        } else {
            shell::copy(&path, &to.join(name))?;
        }
    }
    Ok(())
}

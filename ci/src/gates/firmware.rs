//! Gates on the release ELF: what the source cannot show.

use serde_json::json;

use super::Outcome::{self, Passed};
use super::{check_bars, passed_without};
use crate::budget::Report;
use crate::elf::{Elf, Sizes, BANNED};
use crate::error::{bail, ensure, Context, Result};
use crate::firmware;
use crate::session::Session;
use crate::stack::{self, Bound};

pub fn budget(session: &Session) -> Result<Outcome> {
    let Sizes { flash, ram } = session.image()?.sizes;
    check_bars(
        session,
        "firmware",
        json!({"flash_bytes": flash, "static_ram_bytes": ram}),
    )?;
    Ok(Passed(format!(
        "flash {flash} bytes, static RAM {ram} bytes"
    )))
}

/// No panic path, text formatting, software floating point, heap, path of this machine, open vector.
pub fn contents(session: &Session) -> Result<Outcome> {
    let bytes = session.image()?.bytes()?;
    let elf = Elf::parse(&bytes)?;
    let symbols = elf.symbols();
    ensure!(!symbols.is_empty(), "the ELF has no symbols to judge");
    let mut findings = elf.bad_vectors()?;
    for kind in &BANNED {
        let banned = kind.among(&symbols);
        findings.extend(
            banned
                .iter()
                .map(|symbol| format!("{}: {symbol}", kind.name)),
        );
    }
    let paths = host_paths(session)?.into_iter();
    let found = paths.filter(|path| elf.contains(path));
    findings.extend(found.map(|path| format!("a path of this machine: {path}")));
    passed_without(&findings, format!("{} symbols judged", symbols.len()))
}

/// What would betray where the ELF was built.
fn host_paths(session: &Session) -> Result<Vec<String>> {
    let workspace = &session.workspace;
    let home = std::env::var("HOME").unwrap_or_default().into();
    let mut folders = vec![workspace.root.clone(), workspace.sysroot.clone(), home];
    folders.push(firmware::cargo_home());
    folders.extend(
        session
            .toolchain()?
            .remap
            .iter()
            .map(|(from, _)| from.clone()),
    );
    let mut paths: Vec<_> = folders
        .iter()
        .map(|folder| format!("{}/", folder.display()))
        .collect();
    // A HOME of / or nothing is in every text.
    paths.retain(|path| path.len() > 2);
    Ok(paths)
}

/// The worst case of the stack against what is reserved and against its budget.
pub fn stack(session: &Session) -> Result<Outcome> {
    let Bound { worst, reserved } = stack::bound(&session.workspace, &session.image()?.path)?;
    ensure!(
        worst <= reserved,
        "the stack can reach {worst} bytes, reserved are {reserved}"
    );
    check_bars(session, "stack", json!({"worst_bytes": worst}))?;
    Ok(Passed(format!("at most {worst} of {reserved} bytes")))
}

/// The stack that a run used must be within the computed bound. Returns both, in bytes.
pub fn check_stack_use(session: &Session, run: &Report) -> Result<(f64, u32)> {
    let Bound { worst, .. } = stack::bound(&session.workspace, &session.image()?.path)?;
    let used = run
        .figure("stack_used_bytes")
        .context("stack_used_bytes is not in the report")?;
    ensure!(
        used > 0.0 && used <= f64::from(worst),
        "the run used {used} bytes of stack, computed are at most {worst}"
    );
    Ok((used, worst))
}

/// The same ELF from another folder, debugging information included.
pub fn reproducible(session: &Session) -> Result<Outcome> {
    let workspace = &session.workspace;
    let one = session.image()?.bytes()?;
    // Elsewhere and deeper, so that no path has the same length by chance.
    let elsewhere = workspace
        .target
        .join("reproducible/a folder of another length");
    if elsewhere.exists() {
        std::fs::remove_dir_all(&elsewhere)?;
    }
    for file in workspace.files("")? {
        firmware::copy(&file, &elsewhere.join(file.strip_prefix(&workspace.root)?))?;
    }
    let target = elsewhere.join("target");
    let toolchain = session.toolchain()?;
    let second = firmware::build_in(workspace, toolchain, &elsewhere, &target, "")?;
    let other = std::fs::read(&second)?;
    if one != other {
        let at = one
            .iter()
            .zip(&other)
            .take_while(|(one, other)| one == other)
            .count();
        bail!("{} differs from byte {at:#x} on", second.display());
    }
    std::fs::remove_dir_all(&elsewhere)?;
    Ok(Passed(format!("{} equal bytes", one.len())))
}

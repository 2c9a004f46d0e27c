//! Gates on the release ELF: what the source cannot show.

use serde_json::{Value, json};

use super::passed_without;
use crate::budget::{Budget, figure};
use crate::elf::{Elf, Sizes, banned};
use crate::error::{Context, Result, ensure};
use crate::firmware;
use crate::session::Session;
use crate::stack::{self, Bound};

pub fn budget(session: &Session) -> Result<String> {
    let Sizes { flash, ram } = session.image()?.sizes;
    let figures = json!({"flash_bytes": flash, "static_ram_bytes": ram});
    Budget::read(session)?.check("firmware", &figures)?;
    Ok(format!("flash {flash} bytes, static RAM {ram} bytes"))
}

/// No panic path, text formatting, software floating point, heap, path of this machine, open vector.
pub fn contents(session: &Session) -> Result<String> {
    let bytes = &session.image()?.bytes;
    let elf = Elf::parse(bytes)?;
    let symbols = elf.symbols();
    ensure!(!symbols.is_empty(), "the ELF has no symbols to judge");
    let mut findings = elf.bad_vectors()?;
    findings.extend(banned(&symbols));
    let home = std::env::var("HOME").unwrap_or_default().into();
    let cargo_home = firmware::cargo_home();
    let own = [&session.root, &session.sysroot, &home, &cargo_home].into_iter();
    let remap = session.toolchain()?.remap.iter();
    for folder in own.chain(remap.map(|(from, _)| from)) {
        let folder = format!("{}/", folder.display());
        let mut windows = bytes.windows(folder.len());
        // A HOME of / or nothing is in every text.
        if folder.len() > 2 && windows.any(|window| window == folder.as_bytes()) {
            findings.push(format!("a path of this machine: {folder}"));
        }
    }
    passed_without(&findings, format!("{} symbols judged", symbols.len()))
}

/// The worst case of the stack against what is reserved and against its budget.
pub fn stack(session: &Session) -> Result<String> {
    let Bound { worst, reserved } = stack::bound(session, &session.image()?.path)?;
    let figure = format!("at most {worst} of {reserved} bytes");
    ensure!(worst <= reserved, "the stack can overflow: {figure}");
    Budget::read(session)?.check("stack", &json!({"worst_bytes": worst}))?;
    Ok(figure)
}

/// The stack that a run used must be within the computed bound. Returns both, in bytes.
pub fn check_stack_use(session: &Session, report: &Value) -> Result<(f64, u32)> {
    let Bound { worst, .. } = stack::bound(session, &session.image()?.path)?;
    let used = figure(report, "stack_used_bytes");
    let used = used.context("stack_used_bytes is not in the report")?;
    let why = format!("the run used {used} bytes of stack, computed are at most {worst}");
    ensure!(used > 0.0 && used <= f64::from(worst), why);
    Ok((used, worst))
}

/// The same ELF from another folder, debugging information included.
pub fn reproducible(session: &Session) -> Result<String> {
    let (sh, first) = (&session.sh, &session.image()?.bytes);
    // Elsewhere and deeper, so that no path has the same length by chance.
    let elsewhere = "reproducible/a folder of another length";
    let elsewhere = session.target.join(elsewhere);
    sh.remove_path(&elsewhere)?;
    session.copy_to(&elsewhere)?;
    let second = session.build_copy(&elsewhere, "fw-pac")?;
    let other = sh.read_binary_file(&second)?;
    ensure!(*first == other, "{} differs", second.display());
    sh.remove_path(&elsewhere)?;
    Ok(format!("{} equal bytes", other.len()))
}

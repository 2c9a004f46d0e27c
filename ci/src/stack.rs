//! The stack bound of this robot's firmware, by `ci/stack-bound`.

use std::path::Path;

use crate::error::{Context, Result, ensure};
use crate::process::{self, pattern};
use crate::workspace::Workspace;

/// The worst case of an ELF, bytes.
pub struct Bound {
    pub worst: u32,
    pub reserved: u32,
}

/// Computes the bound of an ELF for the STM32F411, prints it with the calls that lead there. An error
/// is what has no bound, or why an overflow would not fault.
pub fn bound(workspace: &Workspace, elf: &Path) -> Result<Bound> {
    let options = "--priority-bits 4 --ram-start 0x20000000 --masked boot";
    let program = workspace.build_program("stack-bound")?;
    let run = workspace.sh.cmd(program).args(options.split(' '));
    let (success, text) = process::tee(run.arg(elf))?;
    let bound = parse(&text);
    ensure!(bound.is_some() || !success, "stack-bound printed no bound");
    bound.with_context(|| text.lines().last().unwrap_or_default().to_owned())
}

fn parse(text: &str) -> Option<Bound> {
    let line = pattern(r"at most (\d+) of (\d+) bytes").captures(text)?;
    let (worst, reserved) = (line[1].parse().ok()?, line[2].parse().ok()?);
    Some(Bound { worst, reserved })
}

#[test]
fn bound_is_read_from_the_last_line() {
    let text = "  thread  40 bytes\n  at most 4664 of 8192 bytes (5000 if …), 9 routines\n";
    let Bound { worst, reserved } = parse(text).unwrap();
    assert_eq!((worst, reserved), (4664, 8192));
    assert!(parse("stack-bound: recursion: a -> a\n").is_none());
}

//! Running the programs that drive the virtual board with the firmware's ELF.

use std::path::{Path, PathBuf};
use std::process::Command;

use crate::error::{Of, Result};
use crate::place::Place;
use crate::shell;

/// The demo's folder below the target folder.
pub const DEMO: &str = "demo";
/// The demo's figures in its folder.
pub const REPORT: &str = "report.json";
/// The feature of the build that the figures compare with.
pub const HAND: &str = "test-hand";
/// The figures' file below the target folder.
pub const FIGURES: &str = "figures.json";

/// A cargo command on packages that need the virtual board's crate.
///
/// # Errors
/// Where cargo does not answer.
pub fn cargo_with_board(place: &Place, words: &[&str]) -> Result<Command> {
    let mut command = place.cargo();
    command.args(words).args(place.ignore_rust_version()?);
    Ok(command)
}

/// Drives the default room: `more` goes to the demo program.
///
/// # Errors
/// Where it cannot be built or misses its own bars.
pub fn demo(place: &Place, elf: &Path, more: &[String]) -> Result<PathBuf> {
    let out = place.target.join(DEMO);
    std::fs::create_dir_all(&out).of(out.display())?;
    forget(&out.join(REPORT))?;
    run_bin(place, "demo", elf, &out, more)?;
    Ok(out)
}

/// Measures the release ELF, and `hand`, the same with the frame by hand in it: `more` goes to the
/// figures program.
///
/// # Errors
/// Where it cannot be built or fails to measure.
pub fn figures(place: &Place, elf: &Path, hand: &Path, more: &[String]) -> Result<PathBuf> {
    let out = place.target.join(FIGURES);
    forget(&out)?;
    let mut words = vec!["--hand".to_owned(), hand.to_string_lossy().into_owned()];
    words.extend_from_slice(more);
    run_bin(place, "figures", elf, &out, &words)?;
    Ok(out)
}

/// The figures of an earlier run must not pass for this one's.
fn forget(file: &Path) -> Result<()> {
    if file.is_file() {
        std::fs::remove_file(file).of(file.display())?;
    }
    Ok(())
}

fn run_bin(place: &Place, bin: &str, elf: &Path, out: &Path, more: &[String]) -> Result<()> {
    let words = ["run", "--release", "--package", "robot-tests", "--bin", bin];
    let mut command = cargo_with_board(place, &words)?;
    command
        .arg("--")
        .arg("--elf")
        .arg(elf)
        .arg("--out")
        .arg(out)
        .args(more);
    shell::run(&mut command)
}

/// Runs the Pi's program on the virtual board: `words` are its own, files in them are seen from
/// where the user stands.
///
/// # Errors
/// Where it cannot be built or started; the program's own exit code comes back as `Ok`.
pub fn pilot(place: &Place, elf: &Path, words: &[String]) -> Result<i32> {
    let build = [
        "build",
        "--release",
        "--package",
        "pilot",
        "--features",
        "virtual",
    ];
    shell::run(cargo_with_board(place, &build)?.arg("--quiet"))?;
    let mut program = Command::new(place.target.join("release/robot"));
    program.args(words).arg("--virtual").arg("--elf").arg(elf);
    if !words.iter().any(|word| word.starts_with("--eeprom-image")) {
        program
            .arg("--eeprom-image")
            .arg(place.target.join("virtual/eeprom.bin"));
    }
    let status = program.status().of(shell::shown(&program))?;
    Ok(status.code().unwrap_or(1))
}

//! Running the programs that drive the virtual board with the firmware's ELF.

use std::path::{Path, PathBuf};
use std::process::Command;

use crate::error::{Context, Result};
use crate::toolchain::{Toolchain, TARGET};
use crate::workspace::Workspace;
use crate::{firmware, process};

/// Drives the default room, with `more` arguments of the demo program; returns the folder it leaves.
pub fn demo(workspace: &Workspace, elf: &Path, more: &[String]) -> Result<PathBuf> {
    let out = workspace.target.join("demo");
    std::fs::create_dir_all(&out)?;
    remove(&out.join("report.json"))?;
    let mut demo = robot_tests(workspace, "demo")?;
    demo.arg("--elf").arg(elf).arg("--out").arg(&out).args(more);
    process::run(demo)?;
    Ok(out)
}

/// Measures the release ELF, and the reference codec of `tests/bench` beside it, with `more` arguments of
/// the figures program; returns the report it leaves.
pub fn figures(
    workspace: &Workspace,
    toolchain: &Toolchain,
    elf: &Path,
    more: &[String],
) -> Result<PathBuf> {
    let reference = bench_on_core(workspace, toolchain, "reference-codec")?;
    let out = workspace.target.join("figures.json");
    remove(&out)?;
    let mut figures = robot_tests(workspace, "figures")?;
    figures.arg("--elf").arg(elf).arg("--out").arg(&out);
    figures.arg("--reference").arg(reference).args(more);
    process::run(figures)?;
    Ok(out)
}

fn robot_tests(workspace: &Workspace, program: &str) -> Result<Command> {
    let words = format!("run --release --package robot-tests --bin {program}");
    let mut command = workspace.cargo_with_board(&words)?;
    command.arg("--");
    Ok(command)
}

/// The figures of an earlier run must not pass for this one's.
fn remove(file: &Path) -> Result<()> {
    if file.is_file() {
        std::fs::remove_file(file).with_context(|| file.display().to_string())?;
    }
    Ok(())
}

/// Runs the Pi's program on the virtual board; `arguments` are its own, files in them are relative to
/// the current folder. Returns its exit code.
pub fn pilot(workspace: &Workspace, elf: &Path, arguments: &[String]) -> Result<u8> {
    let build = "build --quiet --release --package pilot --features virtual";
    process::run(workspace.cargo_with_board(build)?)?;
    let mut program = Command::new(workspace.target.join("release/robot"));
    program
        .args(arguments)
        .arg("--virtual")
        .arg("--elf")
        .arg(elf);
    if !arguments
        .iter()
        .any(|word| word.starts_with("--eeprom-image"))
    {
        let image = workspace.target.join("virtual/eeprom.bin");
        program.arg("--eeprom-image").arg(image);
    }
    let status = program
        .status()
        .with_context(|| process::display(&program))?;
    Ok(status
        .code()
        .and_then(|code| u8::try_from(code).ok())
        .unwrap_or(1))
}

/// Builds a program of `tests/bench` for the robot's core, as the firmware is built; returns its ELF.
fn bench_on_core(workspace: &Workspace, toolchain: &Toolchain, program: &str) -> Result<PathBuf> {
    let root = workspace.root.join("tests/bench");
    let target = toolchain.target_dir.join("bench");
    let words = format!("build --locked --release --bin {program}");
    let flags = firmware::target_flags(workspace)?;
    let mut cargo = toolchain.cargo(workspace, &root, &words, &flags);
    cargo.arg("--target-dir").arg(&target);
    process::run(cargo)?;
    Ok(target.join(TARGET).join("release").join(program))
}

/// Compares the odometry with others (`tests/bench`): builds what is compared for the core and for the
/// host, runs both and prints the table.
pub fn bench(workspace: &Workspace, toolchain: &Toolchain) -> Result<()> {
    let root = workspace.root.join("tests/bench");
    let elf = bench_on_core(workspace, toolchain, "on-core")?;
    let target = workspace.target.join("bench");
    let mut on_host = workspace.cargo("build --locked --release --bin on-host");
    on_host.current_dir(&root).arg("--target-dir").arg(&target);
    process::run(on_host)?;
    let lines = process::output(Command::new(target.join("release/on-host")));
    let host = target.join("on-host.txt");
    std::fs::write(&host, lines.context("tests/bench: on-host failed")?)?;

    let mut bench = robot_tests(workspace, "bench")?;
    bench.arg("--elf").arg(&elf).arg("--host").arg(&host);
    process::run(bench)
}

//! The robot's odometry beside others (`tests/bench`), on the emulated core.

use crate::arm::Arm;
use crate::error::{failed, Of, Result};
use crate::place::Place;
use crate::robot::cargo_with_board;
use crate::shell;

/// Builds what is compared for the core and for the host, runs both and prints the table.
///
/// # Errors
/// Where something cannot be built, or the core comes to another result than the host.
pub fn run(place: &Place, arm: &Arm) -> Result<()> {
    let root = place.root.join("tests/bench");
    let target = arm.target_dir.join("bench");
    let target_word = target.to_string_lossy();
    let build = [
        "build",
        "--locked",
        "--release",
        "--target-dir",
        &target_word,
    ];
    let on_core = [&build[..], &["--bin", "on-core"]].concat();
    let flags = ["-C".to_owned(), "target-cpu=cortex-m4".to_owned()];
    shell::run(&mut arm.cargo(place, &root, &on_core, &flags))?;
    let elf = target.join(crate::arm::TARGET).join("release/on-core");

    let target = place.target.join("bench");
    let mut on_host = place.cargo();
    on_host.current_dir(&root).args(&build[..3]);
    on_host
        .arg("--target-dir")
        .arg(&target)
        .args(["--bin", "on-host"]);
    shell::run(&mut on_host)?;
    let program = target.join("release/on-host");
    let Some(lines) = shell::ask(&mut std::process::Command::new(&program)) else {
        return failed(format!("{} failed", program.display()));
    };
    let host = target.join("on-host.txt");
    std::fs::write(&host, lines).of(host.display())?;

    let words = [
        "run",
        "--release",
        "--package",
        "robot-tests",
        "--bin",
        "bench",
    ];
    let mut bench = cargo_with_board(place, &words)?;
    bench
        .arg("--")
        .arg("--elf")
        .arg(&elf)
        .arg("--host")
        .arg(&host);
    shell::run(&mut bench)
}

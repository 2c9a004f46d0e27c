//! Running the workspace's other programs.

use std::ffi::OsStr;
use std::path::PathBuf;
use std::process::Command;

use xshell::{Cmd, cmd};

use crate::error::{Kind, Result, fail};
use crate::process;
use crate::session::Session;
use crate::toolchain::apt_install;

/// The package of `tests/bench`, built as the firmware is.
const BENCH: &str = "odometry-bench";

/// A program that takes the release ELF.
fn on_elf<'s>(session: &'s Session, program: &str) -> Result<Cmd<'s>> {
    let program = session.build_program(program)?;
    let elf = &session.image()?.path;
    Ok(cmd!(session.sh, "{program} --elf {elf}"))
}

/// Explores the default room, with `more` arguments of the demo program; returns the folder it leaves.
pub fn demo(session: &Session, more: &[String]) -> Result<PathBuf> {
    let is_tour = more.iter().any(|word| word == "--tour");
    let out = session.target.join(if is_tour { "tour" } else { "demo" });
    // The report of an earlier run must not pass for this one's.
    session.sh.remove_path(out.join("report.json"))?;
    session.sh.create_dir(&out)?;
    let demo = on_elf(session, "demo")?.arg("--out").arg(&out);
    demo.args(more).run()?;
    Ok(out)
}

/// Explores generated rooms, with `more` arguments of the bench; returns the table that it leaves.
pub fn explore_bench(session: &Session, more: &[impl AsRef<OsStr>]) -> Result<PathBuf> {
    let out = session.target.join("explore-bench");
    let table = out.join("table.json");
    session.sh.remove_path(&table)?;
    let bench = on_elf(session, "explore-bench")?.arg("--out").arg(out);
    bench.args(more).run()?;
    Ok(table)
}

/// Injects faults into the driving robot, with `more` arguments of the campaign.
pub fn campaign(session: &Session, more: &[String]) -> Result<()> {
    Ok(on_elf(session, "campaign")?.args(more).run()?)
}

/// Measures the release ELF, and the reference codec of `tests/bench` beside it, with `more` arguments of
/// the figures program; returns the report it leaves.
pub fn figures(session: &Session, more: &[String]) -> Result<PathBuf> {
    let reference = session.build(BENCH, "reference-codec", "")?.path;
    let out = session.target.join("figures.json");
    session.sh.remove_path(&out)?;
    let figures = on_elf(session, "figures")?.arg("--out").arg(&out);
    let figures = figures.arg("--reference").arg(reference);
    figures.args(more).run()?;
    Ok(out)
}

/// Builds the Pi's program with the virtual board, silently: what is shown is its own; returns its path.
pub fn build_pilot(session: &Session) -> Result<PathBuf> {
    let build = session.cargo_on_host("build --quiet --release --bin robot")?;
    build.quiet().run()?;
    Ok(session.target.join("release/robot"))
}

/// A Pi's processor.
struct Pi {
    target: &'static str,
    linker: &'static str,
    /// Debian packages that bring the linker.
    packages: &'static str,
    /// The program of QEMU that runs its programs.
    qemu: &'static str,
}

/// Static, so that the Pi's libraries do not matter. The first needs no C compiler; rustup's mirrors often lack
/// the second's like.
const PI: [Pi; 2] = [
    Pi {
        target: "aarch64-unknown-linux-musl",
        linker: "rust-lld",
        packages: "",
        qemu: "qemu-aarch64-static",
    },
    Pi {
        target: "armv7-unknown-linux-gnueabihf",
        linker: "arm-linux-gnueabihf-gcc",
        packages: "gcc-arm-linux-gnueabihf libc6-dev-armhf-cross",
        qemu: "qemu-arm-static",
    },
];

/// Makes the Debian packages of the Pi's program, of 64 and of 32 bits; returns each with the program of
/// QEMU that runs its content.
pub fn packages(session: &Session) -> Result<Vec<(PathBuf, &'static str)>> {
    const FEATURES: &str = "--package pilot --features linux,terminal,web,ros2";
    session.require_tool("deb@3.8.0")?;
    // The only build without the virtual board.
    let clippy = format!("clippy --release --locked {FEATURES} -- -D warnings");
    session.cargo(&clippy).run()?;
    let package = |pi: Pi| {
        let (target, linker, packages) = (pi.target, pi.linker, pi.packages);
        let std = session.sysroot.join("lib/rustlib").join(target).join("lib");
        let add = session.rustup(&format!("target add {target}"));
        process::require(|| std.is_dir(), &add, target)?;
        if !packages.is_empty() && !session.has(linker) {
            apt_install(session, packages, 120)
                .or_else(|why| fail(Kind::MissingProgram, format!("no {linker}: {why}")))?;
        }
        let manual = session.target.join(target).join("release/manual");
        let robot = session.cargo(&format!("run --quiet --locked {FEATURES} -- manual"));
        robot.arg(manual).run()?;
        let of_target = format!("CARGO_TARGET_{}", target.to_uppercase().replace('-', "_"));
        let optimised = "--config profile.release.package.rustdds.opt-level=2";
        let words = format!("build --locked --release {FEATURES} --target {target} {optimised}");
        let build = session.cargo(&words);
        let build = build.env("CARGO_PROFILE_RELEASE_STRIP", "true");
        let build = build.env(format!("{of_target}_LINKER"), linker);
        let flags = format!("{of_target}_RUSTFLAGS");
        build.env(flags, "-Ctarget-feature=+crt-static").run()?;
        let deb = "deb --locked --package pilot --no-build --no-strip --quiet --output";
        let deb = session.cargo(deb).arg(session.target.join("packages"));
        Ok((deb.args(["--target", target]).read()?.into(), pi.qemu))
    };
    PI.into_iter().map(package).collect()
}

/// Runs the Pi's program on the virtual board; `arguments` are its own, files in them are relative to
/// the current folder. Returns its exit code.
pub fn pilot(session: &Session, arguments: &[String]) -> Result<u8> {
    let mut program = Command::new(build_pilot(session)?);
    program.args(arguments).arg("--virtual");
    program.env("ROBOT_ELF", &session.image()?.path);
    let names_image = |word: &String| word.starts_with("--eeprom-image");
    if !arguments.iter().any(names_image) {
        let image = session.target.join("virtual/eeprom.bin");
        program.arg("--eeprom-image").arg(image);
    }
    let code = program.status()?.code().unwrap_or(1);
    Ok(u8::try_from(code).unwrap_or(1))
}

/// What a program of `tests/bench` prints on the host.
fn bench_on_host(session: &Session, program: &str) -> Result<String> {
    let program = session.build_program(program)?;
    Ok(cmd!(session.sh, "{program}").read()?)
}

/// Compares the odometry with others (`tests/bench`): builds what is compared for the core and for the
/// host, runs both and prints the table.
pub fn bench(session: &Session) -> Result<()> {
    let elf = session.build(BENCH, "on-core", "")?.path;
    let lines = session.target.join("on-host.txt");
    let on_host = bench_on_host(session, "on-host")?;
    session.sh.write_file(&lines, on_host)?;
    let bench = session.build_program("bench")?;
    Ok(cmd!(session.sh, "{bench} --elf {elf} --host {lines}").run()?)
}

/// What the core's arithmetic comes to on the host and on QEMU's Cortex-M4. Its STM32F405 has the firmware's
/// memory map.
pub fn second_opinion(session: &Session) -> Result<[String; 2]> {
    let (sh, program) = (&session.sh, "second-opinion");
    let elf = session.build(BENCH, program, "")?.path;
    let qemu =
        "timeout 60 qemu-system-arm -M netduinoplus2 -display none -monitor none -serial none";
    let qemu = cmd!(sh, "env").args(qemu.split(' '));
    let qemu = qemu.args(["-semihosting-config", "enable=on,target=native", "-kernel"]);
    Ok([bench_on_host(session, program)?, qemu.arg(elf).read()?])
}

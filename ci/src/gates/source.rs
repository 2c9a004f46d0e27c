//! Gates on the source: format, lints, documentation, the oldest compiler.

use std::path::PathBuf;
use std::process::Command;
use std::time::Duration;

use super::{passed, skipped, Context, Verdict};
use crate::arm::{Way, TARGET};
use crate::error::Result;
use crate::robot::cargo_with_board;
use crate::{shell, trace};

/// The packages that need the virtual board's crate, and the feature that brings it to the Pi's.
const BOARD: [&str; 8] = [
    "--package",
    "twin",
    "--package",
    "robot-tests",
    "--package",
    "pilot",
    "--features",
    "pilot/virtual",
];
/// The oldest compiler that `fw-core` and `proofs` promise to build with (Kani pins old ones).
const OLDEST: &str = "1.85";

/// A rustup component that a machine may lack; tries to get it once.
fn component(context: &Context, subcommand: &str, component: &str) -> bool {
    let there = || shell::ask(context.place.cargo().args([subcommand, "--version"])).is_some();
    there() || {
        let mut add = Command::new("rustup");
        add.args(["component", "add", component]);
        shell::run_within(&mut add, Duration::from_mins(2)).is_ok() && there()
    }
}

pub fn fmt(context: &mut Context) -> Result<Verdict> {
    if !component(context, "fmt", "rustfmt") {
        return skipped("rustfmt is not installed (`rustup component add rustfmt`)");
    }
    shell::run(context.place.cargo().args(["fmt", "--all", "--check"]))?;
    for own in ["fuzz/Cargo.toml", "tests/bench/Cargo.toml"] {
        let check = ["fmt", "--manifest-path", own, "--check"];
        shell::run(context.place.cargo().args(check))?;
    }
    passed("")
}

/// What the core is checked against must not be edited by hand.
pub fn vectors(context: &mut Context) -> Result<Verdict> {
    if shell::ask(Command::new("python3").arg("--version")).is_none() {
        return skipped("python3 is not installed");
    }
    let mut check = Command::new("python3");
    check.current_dir(&context.place.root);
    shell::run(check.args(["tests/vectors/generate.py", "--check"]))?;
    passed("")
}

pub fn clippy(context: &mut Context) -> Result<Verdict> {
    if !component(context, "clippy", "clippy") {
        return skipped("clippy is not installed (`rustup component add clippy`)");
    }
    let place = &context.place;
    let deny = ["--", "-D", "warnings"];
    shell::run(place.cargo().args(["clippy", "--all-targets"]).args(deny))?;
    let no_float = [
        "clippy",
        "--package",
        "fw-core",
        "--lib",
        "--",
        "-D",
        "clippy::float_arithmetic",
    ];
    shell::run(place.cargo().args(no_float))?;
    shell::run(
        place
            .cargo()
            .args(["clippy", "--package", "pilot", "--features", "linux"])
            .args(deny),
    )?;
    let mut board = cargo_with_board(place, &["clippy", "--all-targets"])?;
    shell::run(board.args(BOARD).args(deny))?;
    if context.arm()?.way == Way::Debian {
        // Clippy belongs to the machine's compiler, which has no core for the target.
        return passed("without fw-pac: the target is Debian's");
    }
    let pac = ["clippy", "--package", "fw-pac", "--target", TARGET];
    let reasons = ["-D", "clippy::undocumented_unsafe_blocks"];
    for features in [&[][..], &["--no-default-features"]] {
        let mut pac_clippy = context.place.cargo();
        pac_clippy.args(pac).args(features).args(deny);
        shell::run(pac_clippy.args(reasons))?;
    }
    passed("all packages")
}

pub fn docs(context: &mut Context) -> Result<Verdict> {
    let place = &context.place;
    let deny = ("RUSTDOCFLAGS", "-D warnings");
    shell::run(place.cargo().args(["doc", "--no-deps"]).env(deny.0, deny.1))?;
    let mut board = cargo_with_board(place, &["doc", "--no-deps"])?;
    shell::run(board.args(BOARD).env(deny.0, deny.1))?;
    if context.arm()?.way == Way::Debian {
        return passed("without fw-pac: the target is Debian's");
    }
    let pac = [
        "doc",
        "--no-deps",
        "--package",
        "fw-pac",
        "--target",
        TARGET,
    ];
    shell::run(context.place.cargo().args(pac).env(deny.0, deny.1))?;
    passed("all packages")
}

pub fn msrv(context: &mut Context) -> Result<Verdict> {
    let Some(cargo) = oldest_cargo() else {
        return skipped(format!(
            "no Rust {OLDEST} here (`rustup toolchain install {OLDEST}`)"
        ));
    };
    let mut build = Command::new(cargo.program);
    build.args(&cargo.words).current_dir(&context.place.root);
    build.args([
        "check",
        "--locked",
        "--package",
        "fw-core",
        "--package",
        "proofs",
    ]);
    // The toolchain's own choice of compiler must win over the one this program runs under.
    build
        .env_remove("RUSTC")
        .env_remove("CARGO")
        .env_remove("RUSTUP_TOOLCHAIN");
    build
        .arg("--target-dir")
        .arg(context.place.target.join("oldest"));
    shell::run(&mut build)?;
    passed(format!("Rust {OLDEST}"))
}

struct OldestCargo {
    program: PathBuf,
    words: Vec<&'static str>,
}

fn oldest_cargo() -> Option<OldestCargo> {
    let run = ["run", OLDEST, "cargo"];
    let there = || {
        let mut cargo = Command::new("rustup");
        shell::ask(
            cargo
                .args(run)
                .arg("--version")
                .env_remove("RUSTUP_TOOLCHAIN"),
        )
        .is_some()
    };
    if !shell::installed("rustup") {
        return None;
    }
    if !there() {
        let mut install = Command::new("rustup");
        install.args(["toolchain", "install", OLDEST, "--profile", "minimal"]);
        let fetched = shell::run_within(&mut install, Duration::from_mins(5));
        if fetched.is_err() || !there() {
            return None;
        }
    }
    Some(OldestCargo {
        program: "rustup".into(),
        words: run.to_vec(),
    })
}

/// Every requirement is met and checked, and every citation is of one.
pub fn requirements(context: &mut Context) -> Result<Verdict> {
    let all = trace::trace(&context.place)?;
    let (code, checks) = all.values().fold((0, 0), |(code, checks), one| {
        (code + one.code.len(), checks + one.checks.len())
    });
    passed(format!(
        "{} requirements, cited {code} times above code and {checks} times above what checks it",
        all.len()
    ))
}

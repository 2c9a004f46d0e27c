//! Gates on the source: format, lints, documentation, the oldest compiler, licences.

use std::process::Command;
use std::time::Duration;

use xshell::cmd;

use super::Outcome::{self, Passed, Skipped};
use crate::cargo_tool::CargoTool;
use crate::error::{bail, Failure, Result};
use crate::process;
use crate::session::Session;
use crate::toolchain::{apt_install, Provider, TARGET};

/// The packages that need the virtual board's crate, and the feature that brings it to the Pi's.
const BOARD: &str = "--package twin --package robot-tests --package pilot --features pilot/virtual";
/// The manifests of the workspaces with a lock file of their own.
pub const WORKSPACES: [&str; 3] = ["Cargo.toml", "fuzz/Cargo.toml", "tests/bench/Cargo.toml"];
/// The oldest compiler that `fw-core` and `proofs` promise to build with (Kani pins old ones).
const OLDEST: &str = "1.85";

const CARGO_DENY: CargoTool = CargoTool {
    subcommand: "deny",
    version: "0.20.2",
};

/// Requires a rustup component that a machine may lack; tries to get it once.
fn require(session: &Session, subcommand: &str, component: &str) -> Result<()> {
    let version = format!("{subcommand} --version");
    let installed = || process::output(session.workspace.cargo(&version)).is_some();
    let sh = session.workspace.shell()?;
    let add = || {
        process::run_within(
            Duration::from_mins(2),
            cmd!(sh, "rustup component add {component}"),
        )
    };
    if !installed() && (add().is_err() || !installed()) {
        bail!(Failure::MissingProgram(format!(
            "{component} is not installed (`rustup component add {component}`)"
        )));
    }
    Ok(())
}

pub fn fmt(session: &Session) -> Result<Outcome> {
    require(session, "fmt", "rustfmt")?;
    process::run(session.workspace.cargo("fmt --all --check"))?;
    for manifest in &WORKSPACES[1..] {
        let check = format!("fmt --manifest-path {manifest} --check");
        process::run(session.workspace.cargo(&check))?;
    }
    Ok(Passed(String::new()))
}

/// What the core is checked against must not be edited by hand.
pub fn vectors(session: &Session) -> Result<Outcome> {
    if !process::installed("python3") && apt_install(&session.workspace, &["python3"]).is_err() {
        return Ok(Skipped("python3 is not installed".into()));
    }
    let sh = session.workspace.shell()?;
    process::run(cmd!(sh, "python3 tests/vectors/generate.py --check"))?;
    Ok(Passed(String::new()))
}

pub fn clippy(session: &Session) -> Result<Outcome> {
    require(session, "clippy", "clippy")?;
    let workspace = &session.workspace;
    let deny = "-- -D warnings";
    process::run(workspace.cargo(&format!("clippy --all-targets {deny}")))?;
    let no_float = "clippy --package fw-core --lib -- -D clippy::float_arithmetic";
    process::run(workspace.cargo(no_float))?;
    process::run(workspace.cargo(&format!("clippy --package pilot --features linux {deny}")))?;
    let mut board = workspace.cargo_with_board(&format!("clippy --all-targets {BOARD}"))?;
    board.args(deny.split(' '));
    process::run(board)?;
    for manifest in &WORKSPACES[1..] {
        let words = format!("clippy --manifest-path {manifest} --target-dir");
        let mut own = workspace.cargo(&words);
        own.arg(workspace.target.join("clippy"))
            .args(deny.split(' '));
        process::run(own)?;
    }
    if session.toolchain()?.provider == Provider::Debian {
        // Clippy belongs to the machine's compiler, which has no core for the target.
        return Ok(Passed("without fw-pac: the target is Debian's".into()));
    }
    let pac = format!("clippy --package fw-pac --target {TARGET} {deny}");
    process::run(workspace.cargo(&format!("{pac} -D clippy::undocumented_unsafe_blocks")))?;
    Ok(Passed("all packages".into()))
}

pub fn docs(session: &Session) -> Result<Outcome> {
    let workspace = &session.workspace;
    let run = |mut doc: Command| {
        doc.env("RUSTDOCFLAGS", "-D warnings");
        process::run(doc)
    };
    run(workspace.cargo("doc --no-deps"))?;
    run(workspace.cargo_with_board(&format!("doc --no-deps {BOARD}"))?)?;
    if session.toolchain()?.provider == Provider::Debian {
        return Ok(Passed("without fw-pac: the target is Debian's".into()));
    }
    run(workspace.cargo(&format!("doc --no-deps --package fw-pac --target {TARGET}")))?;
    Ok(Passed("all packages".into()))
}

pub fn msrv(session: &Session) -> Result<Outcome> {
    let sh = session.workspace.shell()?;
    // The toolchain's own choice of compiler must win over the one this program runs under.
    let cargo = || {
        let cargo = cmd!(sh, "rustup run {OLDEST} cargo").env_remove("RUSTC");
        cargo.env_remove("CARGO").env_remove("RUSTUP_TOOLCHAIN")
    };
    let installed = || process::output(cargo().arg("--version")).is_some();
    if !installed() {
        let install = cmd!(sh, "rustup toolchain install {OLDEST} --profile minimal");
        let fetched = process::run_within(Duration::from_mins(5), install);
        if fetched.is_err() || !installed() {
            let install = format!("rustup toolchain install {OLDEST}");
            return Ok(Skipped(format!("no Rust {OLDEST} here (`{install}`)")));
        }
    }
    let check = [
        "check",
        "--locked",
        "--package",
        "fw-core",
        "--package",
        "proofs",
    ];
    let target = session.workspace.target.join("oldest");
    process::run(cargo().args(check).arg("--target-dir").arg(target))?;
    Ok(Passed(format!("Rust {OLDEST}")))
}

/// Licences, bans and sources of the dependencies.
pub fn supply(session: &Session) -> Result<Outcome> {
    let workspace = &session.workspace;
    let found = CARGO_DENY.find(workspace)?;
    for manifest in WORKSPACES {
        let mut deny = CARGO_DENY.command(workspace, &found);
        // Locked: what is committed is what is checked.
        deny.args(["--locked", "--manifest-path", manifest]);
        deny.args(["--config", "deny.toml", "check", "--hide-inclusion-graph"]);
        // One list for all of them: not each has what is excepted.
        deny.args(["--allow", "license-exception-not-encountered"]);
        // Advisories need the network; the nightly workflow checks them.
        deny.args(["bans", "licenses", "sources"]);
        process::run(deny)?;
    }
    Ok(Passed(format!(
        "bans, licenses, sources of {} workspaces",
        WORKSPACES.len()
    )))
}

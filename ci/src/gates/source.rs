//! Gates on the source: format, lints, documentation, the oldest compiler, licences.

use xshell::{Cmd, cmd};

use crate::cargo_tool::CargoTool;
use crate::error::{Failure, Result, bail};
use crate::process;
use crate::session::Session;
use crate::toolchain::{Provider, TARGET, apt_install};

/// The packages that need the virtual board's crate, and the feature that brings it to the Pi's.
const BOARD: &str = "--package twin --package robot-tests --package pilot --features pilot/virtual";
/// The manifests of the workspaces with a lock file of their own.
pub const WORKSPACES: [&str; 3] = ["Cargo.toml", "fuzz/Cargo.toml", "tests/bench/Cargo.toml"];
/// The oldest compiler that `fw-core` and `proofs` promise to build with (Kani pins old ones).
const OLDEST: &str = "1.85";

const CARGO_DENY: CargoTool = CargoTool("deny", "0.20.2");

/// Requires a rustup component that a machine may lack; tries to get it once.
fn require(session: &Session, subcommand: &str, component: &str) -> Result<()> {
    let version = format!("{subcommand} --version");
    let installed = || process::output(session.cargo(&version)).is_some();
    let add = || cmd!(session.sh, "timeout 120 rustup component add {component}").run();
    if !installed() && (add().is_err() || !installed()) {
        let missing = format!("{component} is not installed (`rustup component add {component}`)");
        bail!(Failure::MissingProgram(missing));
    }
    Ok(())
}

pub fn fmt(session: &Session) -> Result<String> {
    require(session, "fmt", "rustfmt")?;
    session.cargo("fmt --all --check").run()?;
    for manifest in &WORKSPACES[1..] {
        session
            .cargo(&format!("fmt --manifest-path {manifest} --check"))
            .run()?;
    }
    Ok(String::new())
}

/// What the core is checked against must not be edited by hand.
pub fn vectors(session: &Session) -> Result<String> {
    if !process::installed("python3") && apt_install(session, "python3").is_err() {
        bail!(Failure::Skipped("python3 is not installed".into()));
    }
    cmd!(session.sh, "python3 tests/vectors/generate.py --check").run()?;
    Ok(String::new())
}

pub fn clippy(session: &Session) -> Result<String> {
    require(session, "clippy", "clippy")?;
    let deny = "-- -D warnings";
    session
        .cargo(&format!("clippy --all-targets {deny}"))
        .run()?;
    session
        .cargo("clippy --package fw-core --lib -- -D clippy::float_arithmetic")
        .run()?;
    session
        .cargo(&format!("clippy --package pilot --features linux {deny}"))
        .run()?;
    let board = session.cargo_with_board(&format!("clippy --all-targets {BOARD}"))?;
    board.args(deny.split(' ')).run()?;
    for manifest in &WORKSPACES[1..] {
        let clippy = session.cargo(&format!("clippy --manifest-path {manifest} --target-dir"));
        clippy
            .arg(session.target.join("clippy"))
            .args(deny.split(' '))
            .run()?;
    }
    if session.toolchain()?.provider == Provider::Debian {
        // Clippy belongs to the machine's compiler, which has no core for the target.
        return Ok("without fw-pac: the target is Debian's".into());
    }
    let pac = format!("clippy --package fw-pac --target {TARGET} {deny}");
    session.cargo(&pac).run()?;
    Ok("all packages".into())
}

pub fn docs(session: &Session) -> Result<String> {
    let run = |doc: Cmd<'_>| doc.env("RUSTDOCFLAGS", "-D warnings").run();
    run(session.cargo("doc --no-deps"))?;
    run(session.cargo_with_board(&format!("doc --no-deps {BOARD}"))?)?;
    if session.toolchain()?.provider == Provider::Debian {
        return Ok("without fw-pac: the target is Debian's".into());
    }
    run(session.cargo(&format!("doc --no-deps --package fw-pac --target {TARGET}")))?;
    Ok("all packages".into())
}

pub fn msrv(session: &Session) -> Result<String> {
    let sh = &session.sh;
    // The toolchain's own choice of compiler must win over the one this program runs under.
    let foreign = ["RUSTC", "CARGO", "RUSTUP_TOOLCHAIN"].into_iter();
    let cargo = || {
        foreign
            .clone()
            .fold(cmd!(sh, "rustup run {OLDEST} cargo"), Cmd::env_remove)
    };
    let installed = || process::output(cargo().arg("--version")).is_some();
    let install = cmd!(
        sh,
        "timeout 300 rustup toolchain install {OLDEST} --profile minimal"
    );
    if !installed() && (install.run().is_err() || !installed()) {
        let install = format!("`rustup toolchain install {OLDEST}`");
        bail!(Failure::Skipped(format!(
            "no Rust {OLDEST} here ({install})"
        )));
    }
    let check = cargo().args([
        "check",
        "--locked",
        "--package",
        "fw-core",
        "--package",
        "proofs",
    ]);
    check
        .arg("--target-dir")
        .arg(session.target.join("oldest"))
        .run()?;
    Ok(format!("Rust {OLDEST}"))
}

/// Licences, bans and sources of the dependencies.
pub fn supply(session: &Session) -> Result<String> {
    for manifest in WORKSPACES {
        // Locked: what is committed is what is checked. One list of exceptions for all of them: not each
        // has what is excepted. Advisories need the network; the nightly workflow checks them.
        let words = format!(
            "--locked --manifest-path {manifest} --config deny.toml check --hide-inclusion-graph \
             --allow license-exception-not-encountered bans licenses sources"
        );
        CARGO_DENY.command(session)?.args(words.split(' ')).run()?;
    }
    Ok(format!(
        "bans, licenses, sources of {} workspaces",
        WORKSPACES.len()
    ))
}

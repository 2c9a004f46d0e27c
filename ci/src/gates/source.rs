//! Gates on the source: format, lints, documentation, the oldest compiler, licences.

use xshell::{Cmd, cmd};

use crate::error::{Kind, Result, fail};
use crate::process;
use crate::session::Session;
use crate::toolchain::{Provider, TARGET, apt_install};
use crate::workspace::HOST;

/// The oldest compiler that `fw-core` and `proofs` promise to build with (Kani pins old ones).
const OLDEST: &str = "1.85";

/// Requires a rustup component that a machine may lack.
fn require(session: &Session, subcommand: &str, component: &str) -> Result<()> {
    let version = format!("{subcommand} --version");
    let installed = || process::output(session.cargo(&version)).is_some();
    let add = session.rustup(&format!("component add {component}"));
    process::require(installed, &add, component)
}

pub fn fmt(session: &Session) -> Result<String> {
    require(session, "fmt", "rustfmt")?;
    session.cargo("fmt --all --check").run()?;
    Ok(String::new())
}

/// What the core is checked against must not be edited by hand.
pub fn vectors(session: &Session) -> Result<String> {
    if !session.has("python3") && apt_install(session, "python3", 600).is_err() {
        return fail(Kind::Skipped, "python3 is not installed");
    }
    cmd!(session.sh, "python3 tests/vectors/generate.py --check").run()?;
    Ok(String::new())
}

/// Clippy's or rustdoc's words for the firmware, where the machine's compiler has the target: it is
/// not in Debian's.
fn on_target(session: &Session, words: &str) -> Result<String> {
    if session.toolchain()?.provider == Provider::Debian {
        return Ok("without fw-pac: the target is Debian's".into());
    }
    let target = format!("--package fw-pac --target {TARGET}");
    let words = words.replace("TARGET", &target);
    session.cargo(&words).run()?;
    Ok("all packages".into())
}

/// cargo on all that runs on a computer. Nothing is linked: libFuzzer's own sources need no compiler.
fn on_host<'s>(session: &'s Session, words: &str) -> Result<Cmd<'s>> {
    let cargo = session.cargo_with_board(&format!("{words} {HOST}"))?;
    Ok(cargo.env("CUSTOM_LIBFUZZER_PATH", "/none/libfuzzer.a"))
}

pub fn clippy(session: &Session) -> Result<String> {
    require(session, "clippy", "clippy")?;
    // `--all-targets` leaves out a test that runs by its name only.
    for targets in ["--all-targets", "--test in_the_loop"] {
        let host = on_host(session, &format!("clippy --release {targets}"))?;
        host.args(["--", "-D", "warnings"]).run()?;
    }
    on_target(session, "clippy TARGET -- -D warnings")
}

pub fn docs(session: &Session) -> Result<String> {
    let _deny = session.sh.push_env("RUSTDOCFLAGS", "-D warnings");
    on_host(session, "doc --release --no-deps")?.run()?;
    on_target(session, "doc --no-deps TARGET")
}

pub fn msrv(session: &Session) -> Result<String> {
    let words = "check --locked --package fw-core --package proofs --target-dir";
    let check = session.cargo_of(OLDEST)?.args(words.split(' '));
    check.arg(session.target.join("oldest")).run()?;
    Ok(format!("Rust {OLDEST}"))
}

/// Licences, bans and sources of the dependencies.
pub fn supply(session: &Session) -> Result<String> {
    session.require_tool("deny@0.20.2")?;
    // Locked: what is committed is what is checked. Advisories need the network; the nightly workflow
    // checks them.
    let words = "deny --locked check --hide-inclusion-graph bans licenses sources";
    session.cargo(words).run()?;
    Ok("bans, licenses, sources".into())
}

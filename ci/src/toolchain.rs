//! The toolchain for the robot's processor: which of three providers has it, tried in turn.
//!
//! A machine with rustup and a network has the target or gets it; one that reaches only Debian's
//! packages builds `core` from Debian's copy of its sources with Debian's compiler. Neither disturbs
//! the machine's own Rust.

use std::path::{Path, PathBuf};

use clap::ValueEnum;
use xshell::{Cmd, cmd};

use crate::error::{Context, Failure, Result, bail, ensure};
use crate::process;
use crate::workspace::{Workspace, release};

/// The Cortex-M4F.
pub const TARGET: &str = "thumbv7em-none-eabihf";

/// Where the compiler for [`TARGET`] comes from.
#[derive(Clone, Copy, Debug, PartialEq, Eq, ValueEnum)]
pub enum Provider {
    /// The machine's compiler has the target's `core`
    Installed,
    /// `rustup target add` fetches it
    Rustup,
    /// Debian's compiler and its sources of `core`
    Debian,
}

/// A toolchain that works here.
pub struct Toolchain {
    pub provider: Provider,
    /// Where its builds go: the compilers do not share a folder.
    pub target_dir: PathBuf,
    /// Prefixes of paths that its compiler would write into the ELF, with what replaces them there.
    pub remap: Vec<(PathBuf, &'static str)>,
    linker: Option<PathBuf>,
}

impl Toolchain {
    /// Takes the first provider that works, or only `forced`; prints which, and why the others do not.
    pub fn find(workspace: &Workspace, forced: Option<Provider>) -> Result<Self> {
        let mut reasons = Vec::new();
        for provider in Provider::value_variants() {
            if forced.is_some_and(|forced| forced != *provider) {
                continue;
            }
            let found = match provider {
                Provider::Installed => installed(workspace),
                Provider::Rustup => rustup(workspace),
                Provider::Debian => debian(workspace),
            };
            match found {
                Ok(toolchain) => return Ok(toolchain),
                Err(error) => {
                    println!("set-up: {TARGET}: not by {provider:?}: {error}");
                    reasons.push(format!("{provider:?}: {error}"));
                }
            }
        }
        bail!(Failure::NoToolchain(format!(
            "no toolchain for {TARGET} on this machine ({}); install the target with `rustup target \
             add {TARGET}`, or on Debian the packages {PACKAGES} {LINKER_PACKAGE}",
            reasons.join("; "),
        )))
    }

    /// This toolchain's cargo; `words` are parted by blanks, `flags` are the compiler's.
    pub fn cargo<'s>(&self, workspace: &'s Workspace, words: &str, flags: &[String]) -> Cmd<'s> {
        let mut flags = flags.to_vec();
        if let Some(linker) = &self.linker {
            flags.push("-Clinker-flavor=ld.lld".into());
            flags.push(format!("-Clinker={}", linker.display()));
        }
        let cargo = match self.provider {
            Provider::Debian => {
                let cargo = cmd!(workspace.sh, "/usr/bin/cargo").args(words.split(' '));
                let cargo = cargo.arg("-Zbuild-std=core").env("RUSTC_BOOTSTRAP", "1");
                let foreign = ["RUSTC_WRAPPER", "CARGO", "RUSTDOC"].into_iter();
                foreign.fold(cargo.env("RUSTC", DEBIAN_RUSTC), Cmd::env_remove)
            }
            _ => workspace.cargo(words),
        };
        // The strongest of cargo's settings, and the only one that keeps blanks in a path whole.
        let flags = flags.join("\x1f");
        cargo
            .args(["--target", TARGET])
            .env("CARGO_ENCODED_RUSTFLAGS", flags)
    }
}

/// The paths of a file or folder below every host and target of a sysroot.
pub fn in_rustlib(sysroot: &Path, name: &str) -> Vec<PathBuf> {
    let folders = std::fs::read_dir(sysroot.join("lib/rustlib"));
    let folders = folders.into_iter().flatten().flatten();
    let paths = folders.map(|folder| folder.path().join(name));
    paths.filter(|path| path.exists()).collect()
}

fn has_core(sysroot: &Path) -> bool {
    let libraries = std::fs::read_dir(sysroot.join("lib/rustlib").join(TARGET).join("lib"));
    let mut names = libraries
        .into_iter()
        .flatten()
        .flatten()
        .map(|entry| entry.file_name());
    names.any(|name| name.to_string_lossy().starts_with("libcore-"))
}

fn installed(workspace: &Workspace) -> Result<Toolchain> {
    let sysroot = &workspace.sysroot;
    ensure!(
        has_core(sysroot),
        "{} has no core for it",
        sysroot.display()
    );
    println!("set-up: {TARGET}: in {}", sysroot.display());
    Ok(Toolchain {
        provider: Provider::Installed,
        target_dir: workspace.target.clone(),
        remap: vec![
            (sysroot.join("lib/rustlib/src/rust"), "/rust"),
            (sysroot.clone(), "/sysroot"),
        ],
        linker: None,
    })
}

fn rustup(workspace: &Workspace) -> Result<Toolchain> {
    cmd!(workspace.sh, "timeout 180 rustup target add {TARGET}").run()?;
    let toolchain = installed(workspace).context("rustup gave it to another toolchain")?;
    let provider = Provider::Rustup;
    Ok(Toolchain {
        provider,
        ..toolchain
    })
}

const DEBIAN_RUSTC: &str = "/usr/bin/rustc";
const DEBIAN_SOURCES: &str = "/usr/lib/rustlib/src/rust";
const PACKAGES: &str = "rustc-web cargo-web rust-web-src";
/// What newer Debians call them.
const NEWER_PACKAGES: &str = "rustc cargo rust-src";
/// Needed only where rustup left no `rust-lld`.
const LINKER_PACKAGE: &str = "lld-19";
/// The oldest compiler that the firmware's crates accept.
const OLDEST: (u32, u32) = (1, 85);

fn debian(workspace: &Workspace) -> Result<Toolchain> {
    let (sh, sources) = (&workspace.sh, Path::new(DEBIAN_SOURCES));
    let version = || process::output(cmd!(sh, "{DEBIAN_RUSTC} --version")).unwrap_or_default();
    let complete = || {
        let files = [
            Path::new("/usr/bin/cargo"),
            &sources.join("library/core/src/lib.rs"),
        ];
        release(&version()) >= OLDEST && files.iter().all(|file| file.is_file())
    };
    if !complete() {
        apt_install(workspace, PACKAGES).or_else(|error| {
            println!("set-up: {error}");
            apt_install(workspace, NEWER_PACKAGES)
        })?;
    }
    let linker = || {
        let mut linkers = in_rustlib(&workspace.sysroot, "bin/rust-lld");
        linkers.extend(["/usr/bin/ld.lld-19", "/usr/bin/ld.lld"].map(PathBuf::from));
        linkers.into_iter().find(|linker| linker.is_file())
    };
    if linker().is_none() {
        apt_install(workspace, LINKER_PACKAGE)?;
    }
    let (major, minor) = OLDEST;
    ensure!(
        complete(),
        "{DEBIAN_RUSTC} {major}.{minor} or newer with {DEBIAN_SOURCES} is missing after the installation"
    );
    let linker = linker().context("neither ld.lld nor rust-lld is there after the installation")?;
    let (version, lld) = (version(), linker.display());
    println!("set-up: {TARGET}: Debian's {version} with its sources of core, linked by {lld}");
    Ok(Toolchain {
        provider: Provider::Debian,
        target_dir: workspace.target.join("debian"),
        remap: vec![
            (sources.to_path_buf(), "/rust"),
            (sources.canonicalize()?, "/rust"),
        ],
        linker: Some(linker),
    })
}

/// Installs Debian packages, parted by blanks, as root or with a sudo that asks for no password.
pub fn apt_install(workspace: &Workspace, packages: &str) -> Result<()> {
    let sh = &workspace.sh;
    ensure!(process::installed("apt-get"), "this machine has no apt-get");
    let root = process::output(cmd!(sh, "id -u")).is_some_and(|id| id == "0");
    ensure!(
        root || process::output(cmd!(sh, "sudo -n true")).is_some(),
        "neither root nor sudo without a password: `sudo apt-get install {packages}` would do it"
    );
    let sudo = if root { "" } else { "sudo -n" };
    let apt = |words: &str| {
        let apt = "timeout 600 env DEBIAN_FRONTEND=noninteractive apt-get -q -y";
        let words = format!("{sudo} {apt} {words}");
        let mut words = words.split_whitespace();
        let program = words.next().unwrap_or_default();
        sh.cmd(program).args(words).ignore_stdout().run()
    };
    let install = format!("install --no-install-recommends {packages}");
    // The package list may be old: it is renewed only where the installation fails.
    Ok(apt(&install).or_else(|_| apt("update").and_then(|()| apt(&install)))?)
}

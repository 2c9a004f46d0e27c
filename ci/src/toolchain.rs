//! The toolchain for the robot's processor: which of three providers has it, tried in turn.
//!
//! A machine with rustup and a network has the target or gets it; one that reaches only Debian's
//! packages builds `core` from Debian's copy of its sources with Debian's compiler. Neither disturbs
//! the machine's own Rust.

use std::path::{Path, PathBuf};
use std::process::Command;
use std::time::Duration;

use clap::ValueEnum;
use xshell::cmd;

use crate::error::{bail, ensure, Failure, Result};
use crate::process;
use crate::workspace::{release, Workspace};

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
                Ok((toolchain, about)) => {
                    println!("set-up: {TARGET}: {about}");
                    return Ok(toolchain);
                }
                Err(error) => {
                    println!("set-up: {TARGET}: not by {provider:?}: {error}");
                    reasons.push(format!("{provider:?}: {error}"));
                }
            }
        }
        bail!(Failure::NoToolchain(format!(
            "no toolchain for {TARGET} on this machine ({}); install the target with `rustup target \
             add {TARGET}`, or on Debian the packages {}, {LINKER_PACKAGE}",
            reasons.join("; "),
            PACKAGES.join(", "),
        )))
    }

    /// This toolchain's cargo in `root`; `words` are parted by blanks, `flags` are the compiler's.
    pub fn cargo(
        &self,
        workspace: &Workspace,
        root: &Path,
        words: &str,
        flags: &[String],
    ) -> Command {
        let mut flags = flags.to_vec();
        let mut command = workspace.cargo("");
        if self.provider == Provider::Debian {
            command = Command::new(DEBIAN_CARGO);
            command
                .env("RUSTC", DEBIAN_RUSTC)
                .env("RUSTC_BOOTSTRAP", "1");
            for foreign in ["RUSTC_WRAPPER", "CARGO", "RUSTDOC"] {
                command.env_remove(foreign);
            }
        }
        command
            .current_dir(root)
            .args(words.split_whitespace())
            .args(["--target", TARGET]);
        if self.provider == Provider::Debian {
            command.arg("-Zbuild-std=core");
        }
        if let Some(linker) = &self.linker {
            flags.push("-Clinker-flavor=ld.lld".into());
            flags.push(format!("-Clinker={}", linker.display()));
        }
        // The strongest of cargo's settings, and the only one that keeps blanks in a path whole.
        command.env("CARGO_ENCODED_RUSTFLAGS", flags.join("\x1f"));
        command
    }
}

/// Files of every host or target below a sysroot.
fn in_rustlib(sysroot: &Path, file: &str) -> Vec<PathBuf> {
    let folders = std::fs::read_dir(sysroot.join("lib/rustlib"))
        .into_iter()
        .flatten()
        .flatten();
    let files = folders.map(|folder| folder.path().join(file));
    files.filter(|file| file.exists()).collect()
}

/// Whether the compiler of this sysroot has LLVM's tools.
pub fn has_llvm_tools(sysroot: &Path) -> bool {
    !in_rustlib(sysroot, "bin/llvm-profdata").is_empty()
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

fn of_the_machine(workspace: &Workspace, provider: Provider) -> Toolchain {
    let sysroot = workspace.sysroot.clone();
    Toolchain {
        provider,
        target_dir: workspace.target.clone(),
        remap: vec![
            (sysroot.join("lib/rustlib/src/rust"), "/rust"),
            (sysroot, "/sysroot"),
        ],
        linker: None,
    }
}

fn installed(workspace: &Workspace) -> Result<(Toolchain, String)> {
    let sysroot = workspace.sysroot.display();
    ensure!(has_core(&workspace.sysroot), "{sysroot} has no core for it");
    Ok((
        of_the_machine(workspace, Provider::Installed),
        format!("installed in {sysroot}"),
    ))
}

fn rustup(workspace: &Workspace) -> Result<(Toolchain, String)> {
    let (sh, sysroot) = (workspace.shell()?, workspace.sysroot.display());
    ensure!(process::installed("rustup"), "rustup is not installed");
    process::run_within(
        Duration::from_mins(3),
        cmd!(sh, "rustup target add {TARGET}"),
    )?;
    ensure!(
        has_core(&workspace.sysroot),
        "`rustup target add` gave the target to another toolchain than {sysroot}"
    );
    Ok((
        of_the_machine(workspace, Provider::Rustup),
        format!("fetched by rustup into {sysroot}"),
    ))
}

const DEBIAN_RUSTC: &str = "/usr/bin/rustc";
const DEBIAN_CARGO: &str = "/usr/bin/cargo";
const DEBIAN_SOURCES: &str = "/usr/lib/rustlib/src/rust";
const PACKAGES: [&str; 3] = ["rustc-web", "cargo-web", "rust-web-src"];
/// What newer Debians call them.
const NEWER_PACKAGES: [&str; 3] = ["rustc", "cargo", "rust-src"];
/// Needed only where rustup left no `rust-lld`.
const LINKER_PACKAGE: &str = "lld-19";
/// The oldest compiler that the firmware's crates accept.
const OLDEST: (u32, u32) = (1, 85);

fn debian(workspace: &Workspace) -> Result<(Toolchain, String)> {
    let sources = Path::new(DEBIAN_SOURCES);
    let sh = workspace.shell()?;
    let version = || process::output(cmd!(sh, "{DEBIAN_RUSTC} --version")).unwrap_or_default();
    let compiler_there = || {
        let core = sources.join("library/core/src/lib.rs");
        release(&version()) >= OLDEST && Path::new(DEBIAN_CARGO).is_file() && core.is_file()
    };
    if !compiler_there() {
        apt_install(workspace, &PACKAGES).or_else(|first| {
            println!("set-up: {first}");
            apt_install(workspace, &NEWER_PACKAGES)
        })?;
    }
    if linker(workspace).is_none() {
        apt_install(workspace, &[LINKER_PACKAGE])?;
    }
    let (major, minor) = OLDEST;
    ensure!(
        compiler_there(),
        "{DEBIAN_RUSTC} {major}.{minor} or newer with {DEBIAN_SOURCES} is missing after the installation"
    );
    let Some(linker) = linker(workspace) else {
        bail!("neither ld.lld nor rust-lld is there after the installation");
    };
    let lld = linker.display();
    let about = format!(
        "Debian's {} with its sources of core, linked by {lld}",
        version()
    );
    let real = sources.canonicalize()?;
    let toolchain = Toolchain {
        provider: Provider::Debian,
        target_dir: workspace.target.join("debian"),
        remap: vec![(sources.to_path_buf(), "/rust"), (real, "/rust")],
        linker: Some(linker),
    };
    Ok((toolchain, about))
}

fn linker(workspace: &Workspace) -> Option<PathBuf> {
    let mut linkers = in_rustlib(&workspace.sysroot, "bin/rust-lld");
    linkers.extend(["/usr/bin/ld.lld-19", "/usr/bin/ld.lld"].map(PathBuf::from));
    linkers.into_iter().find(|linker| linker.is_file())
}

/// Installs Debian packages, as root or with a sudo that asks for no password.
pub fn apt_install(workspace: &Workspace, packages: &[&str]) -> Result<()> {
    let sh = workspace.shell()?;
    ensure!(process::installed("apt-get"), "this machine has no apt-get");
    let root = process::output(cmd!(sh, "id -u")).is_some_and(|id| id == "0");
    ensure!(
        root || process::output(cmd!(sh, "sudo -n true")).is_some(),
        "neither root nor sudo without a password: `sudo apt-get install {}` would do it",
        packages.join(" ")
    );
    let sudo: &[&str] = if root { &[] } else { &["sudo", "-n"] };
    let apt = |words: &[&str]| {
        let apt = [
            "env",
            "DEBIAN_FRONTEND=noninteractive",
            "apt-get",
            "-q",
            "-y",
        ];
        let all = [sudo, &apt, words].concat();
        process::run_within(Duration::from_mins(10), sh.cmd(all[0]).args(&all[1..]))
    };
    let install = [&["install", "--no-install-recommends"], packages].concat();
    // The package list may be old: it is renewed only where the installation fails.
    apt(&install).or_else(|_| apt(&["update"]).and_then(|()| apt(&install)))
}

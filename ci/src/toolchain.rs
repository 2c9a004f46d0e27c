//! The toolchain for the robot's processor: which of three providers has it, tried in turn.
//!
//! A machine with rustup and a network has the target or gets it; one that reaches only Debian's
//! packages builds `core` from Debian's copy of its sources with Debian's compiler. Neither disturbs
//! the machine's own Rust.

use std::path::{Path, PathBuf};

use clap::ValueEnum;
use xshell::{Cmd, cmd};

use crate::error::{Context, Kind, Result, ensure, fail};
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
        let mut reasons = String::new();
        let providers = Provider::value_variants().iter();
        for provider in providers.filter(|found| forced.is_none_or(|forced| forced == **found)) {
            let found = match provider {
                Provider::Installed => installed(workspace),
                Provider::Rustup => rustup(workspace),
                Provider::Debian => debian(workspace),
            };
            let Err(error) = found else {
                return found;
            };
            let reason = format!("{provider:?}: {error}; ");
            println!("set-up: {TARGET}: not by {reason}");
            reasons.push_str(&reason);
        }
        let missing = format!(
            "no toolchain for {TARGET} on this machine ({reasons}else install it: `rustup target add \
             {TARGET}`, or on Debian the packages {PACKAGES} {LINKER_PACKAGE})"
        );
        fail(Kind::NoToolchain, missing)
    }

    /// This toolchain's cargo; `words` are parted by blanks, `flags` are the compiler's.
    pub fn cargo<'s>(
        &self,
        workspace: &'s Workspace,
        words: &str,
        mut flags: Vec<String>,
    ) -> Cmd<'s> {
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
        let cargo = cargo.env("CARGO_ENCODED_RUSTFLAGS", flags.join("\x1f"));
        cargo.args(["--target", TARGET])
    }
}

/// The paths of a file or folder below every host and target of a sysroot.
pub fn in_rustlib(sysroot: &Path, name: &str) -> Vec<PathBuf> {
    let folders = entries(sysroot.join("lib/rustlib"));
    let paths = folders.map(|folder| folder.join(name));
    paths.filter(|path| path.exists()).collect()
}

/// The paths in a folder; none where there is no such folder.
pub fn entries(folder: impl AsRef<Path>) -> impl Iterator<Item = PathBuf> {
    let entries = std::fs::read_dir(folder).into_iter().flatten().flatten();
    entries.map(|entry| entry.path())
}

fn has_core(sysroot: &Path) -> bool {
    let mut libraries = entries(sysroot.join("lib/rustlib").join(TARGET).join("lib"));
    libraries.any(|library| library.to_string_lossy().contains("/libcore-"))
}

fn installed(workspace: &Workspace) -> Result<Toolchain> {
    let sysroot = &workspace.sysroot;
    let folder = sysroot.display();
    ensure!(has_core(sysroot), "{folder} has no core for it");
    println!("set-up: {TARGET}: in {folder}");
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
    workspace.rustup(&format!("target add {TARGET}")).run()?;
    let mut toolchain = installed(workspace).context("rustup gave it to another toolchain")?;
    toolchain.provider = Provider::Rustup;
    Ok(toolchain)
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
        let core = sources.join("library/core/src/lib.rs");
        release(&version()) >= OLDEST && core.is_file() && Path::new("/usr/bin/cargo").is_file()
    };
    if !complete() {
        apt_install(workspace, PACKAGES, 600).or_else(|error| {
            println!("set-up: {error}");
            apt_install(workspace, NEWER_PACKAGES, 600)
        })?;
    }
    let linker = || {
        let mut linkers = in_rustlib(&workspace.sysroot, "bin/rust-lld");
        linkers.extend(["/usr/bin/ld.lld-19", "/usr/bin/ld.lld"].map(PathBuf::from));
        linkers.into_iter().find(|linker| linker.is_file())
    };
    if linker().is_none() {
        apt_install(workspace, LINKER_PACKAGE, 600)?;
    }
    let missing = "is too old, or its sources of core are missing, after the installation";
    ensure!(complete(), "{DEBIAN_RUSTC} {missing}");
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

/// Installs Debian packages, parted by blanks, as root or with a sudo that asks for no password; each
/// access to the network may take `seconds`.
pub fn apt_install(workspace: &Workspace, packages: &str, seconds: u32) -> Result<()> {
    let sh = &workspace.sh;
    ensure!(workspace.has("apt-get"), "this machine has no apt-get");
    let root = process::output(cmd!(sh, "id -u")).is_some_and(|id| id == "0");
    let may = root || process::output(cmd!(sh, "sudo -n true")).is_some();
    ensure!(
        may,
        "neither root nor password-free sudo for `apt-get install {packages}`"
    );
    let sudo = if root { "" } else { "sudo -n" };
    let apt = |seconds: u32, words: &str| {
        let apt = format!("env DEBIAN_FRONTEND=noninteractive timeout {seconds} apt-get -q -y");
        let words = format!("{sudo} {apt} {words}");
        let command = cmd!(sh, "env").args(words.split_whitespace());
        command.ignore_stdout().run()
    };
    // What is installed stays.
    let install = format!("install --no-install-recommends --no-remove {packages}");
    let fetch = || apt(seconds, &format!("{install} --download-only"));
    // The package list may be old: it is renewed only where the download fails.
    fetch().or_else(|_| apt(seconds, "update").and_then(|()| fetch()))?;
    Ok(apt(600, &install)?)
}

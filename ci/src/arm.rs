//! How this machine builds for the robot's processor: which of three ways works, tried in turn.
//!
//! A machine with rustup and a network has the target or gets it; one that reaches only Debian's
//! packages builds `core` from Debian's copy of its sources with Debian's compiler. Neither disturbs
//! the machine's own Rust.

use std::path::{Path, PathBuf};
use std::process::Command;
use std::time::Duration;

use crate::error::{failed, Error, Result};
use crate::place::{release, Place};
use crate::shell;

/// The Cortex-M4F.
pub const TARGET: &str = "thumbv7em-none-eabihf";

/// A way to build for [`TARGET`].
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Way {
    /// The machine's compiler has the target's `core`.
    Installed,
    /// `rustup target add` fetches it.
    Rustup,
    /// Debian's compiler and its sources of `core`.
    Debian,
}

const WAYS: [Way; 3] = [Way::Installed, Way::Rustup, Way::Debian];

impl Way {
    /// The name that `--way` takes.
    pub fn name(self) -> &'static str {
        match self {
            Self::Installed => "installed",
            Self::Rustup => "rustup",
            Self::Debian => "debian",
        }
    }

    /// # Errors
    /// [`Error::Usage`] lists the names.
    pub fn from_name(name: &str) -> Result<Self> {
        WAYS.into_iter()
            .find(|way| way.name() == name)
            .ok_or_else(|| {
                Error::Usage(format!(
                    "--way {name}: the ways are installed, rustup and debian"
                ))
            })
    }
}

/// A way that works here.
pub struct Arm {
    /// Which one.
    pub way: Way,
    /// One line for the reader.
    pub about: String,
    /// Where its builds go: the compilers do not share a folder.
    pub target_dir: PathBuf,
    /// Prefixes of paths that this way's compiler would write into the ELF, with what stands for
    /// them there.
    pub remap: Vec<(PathBuf, &'static str)>,
    linker: Option<PathBuf>,
}

impl Arm {
    /// Takes the first way that works, or only `forced`; prints which, and why the others did not.
    ///
    /// # Errors
    /// [`Error::SetUp`] where none works.
    pub fn find(place: &Place, forced: Option<Way>) -> Result<Self> {
        let ways = forced.map_or_else(|| WAYS.to_vec(), |way| vec![way]);
        let mut reasons = Vec::new();
        for way in ways {
            let found = match way {
                Way::Installed => installed(place),
                Way::Rustup => rustup(place),
                Way::Debian => debian(place),
            };
            match found {
                Ok(arm) => {
                    println!("set-up: {TARGET}: {}", arm.about);
                    return Ok(arm);
                }
                Err(error) => {
                    println!("set-up: {TARGET}: not by way '{}': {error}", way.name());
                    reasons.push(format!("{}: {error}", way.name()));
                }
            }
        }
        Err(Error::SetUp(format!(
            "no way to build for {TARGET} on this machine ({}); install the target with \
             `rustup target add {TARGET}`, or on Debian the packages {}",
            reasons.join("; "),
            PACKAGES.join(", "),
        )))
    }

    /// This way's cargo with `words` as its subcommand, in `root`; `flags` are the compiler's.
    pub fn cargo(&self, place: &Place, root: &Path, words: &[&str], flags: &[String]) -> Command {
        let mut flags = flags.to_vec();
        let mut command = match self.way {
            Way::Installed | Way::Rustup => place.cargo(),
            Way::Debian => {
                let mut command = Command::new(DEBIAN_CARGO);
                command
                    .env("RUSTC", DEBIAN_RUSTC)
                    .env("RUSTC_BOOTSTRAP", "1");
                command
                    .env_remove("RUSTC_WRAPPER")
                    .env_remove("CARGO")
                    .env_remove("RUSTDOC");
                command
            }
        };
        command
            .current_dir(root)
            .args(words)
            .args(["--target", TARGET]);
        if self.way == Way::Debian {
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

fn has_core(sysroot: &Path) -> bool {
    let folder = sysroot.join("lib/rustlib").join(TARGET).join("lib");
    let names = std::fs::read_dir(folder).into_iter().flatten().flatten();
    names
        .map(|entry| entry.file_name())
        .any(|name| name.to_string_lossy().starts_with("libcore-"))
}

fn of_the_machine(place: &Place, way: Way, about: String) -> Arm {
    let sources = place.sysroot.join("lib/rustlib/src/rust");
    Arm {
        way,
        about,
        target_dir: place.target.clone(),
        remap: vec![(sources, "/rust"), (place.sysroot.clone(), "/sysroot")],
        linker: None,
    }
}

fn installed(place: &Place) -> Result<Arm> {
    if !has_core(&place.sysroot) {
        return failed(format!("{} has no core for it", place.sysroot.display()));
    }
    let about = format!("installed in {}", place.sysroot.display());
    Ok(of_the_machine(place, Way::Installed, about))
}

fn rustup(place: &Place) -> Result<Arm> {
    if !shell::installed("rustup") {
        return failed("rustup is not installed");
    }
    let mut add = Command::new("rustup");
    shell::run_within(add.args(["target", "add", TARGET]), Duration::from_mins(3))?;
    if !has_core(&place.sysroot) {
        return failed(format!(
            "`rustup target add` gave the target to another toolchain than {}",
            place.sysroot.display()
        ));
    }
    let about = format!("fetched by rustup into {}", place.sysroot.display());
    Ok(of_the_machine(place, Way::Rustup, about))
}

const DEBIAN_RUSTC: &str = "/usr/bin/rustc";
const DEBIAN_CARGO: &str = "/usr/bin/cargo";
const DEBIAN_CORE: &str = "/usr/lib/rustlib/src/rust/library/core/src/lib.rs";
/// What the third way needs; the linker only where rustup left no `rust-lld`.
const PACKAGES: [&str; 4] = ["rustc-web", "cargo-web", "rust-web-src", "lld-19"];
/// What newer Debians call the first three.
const NEWER_PACKAGES: [&str; 3] = ["rustc", "cargo", "rust-src"];
/// The oldest compiler that the firmware's crates accept.
const OLDEST: (u32, u32) = (1, 85);

fn debian(place: &Place) -> Result<Arm> {
    let compiler_there = || {
        let answer = shell::ask(Command::new(DEBIAN_RUSTC).arg("--version"));
        answer.is_some_and(|answer| release(&answer) >= OLDEST)
            && Path::new(DEBIAN_CARGO).is_file()
            && Path::new(DEBIAN_CORE).is_file()
    };
    if !compiler_there() {
        apt_install(&PACKAGES[..3]).or_else(|first| {
            println!("set-up: {first}");
            apt_install(&NEWER_PACKAGES)
        })?;
    }
    if linker(place).is_none() {
        apt_install(&PACKAGES[3..])?;
    }
    if !compiler_there() {
        return failed(format!(
            "{DEBIAN_RUSTC} {}.{} or newer with {DEBIAN_CORE} is not there after the installation",
            OLDEST.0, OLDEST.1
        ));
    }
    let Some(linker) = linker(place) else {
        return failed("neither ld.lld nor rust-lld is there after the installation");
    };
    let answer = shell::ask(Command::new(DEBIAN_RUSTC).arg("--version")).unwrap_or_default();
    let core = Path::new(DEBIAN_CORE)
        .ancestors()
        .nth(4)
        .unwrap_or(Path::new("/usr"));
    let real = core.canonicalize().unwrap_or_else(|_| core.to_path_buf());
    Ok(Arm {
        way: Way::Debian,
        about: format!(
            "Debian's {answer} with its sources of core, linked by {}",
            linker.display()
        ),
        target_dir: place.target.join("debian"),
        remap: vec![(core.to_path_buf(), "/rust"), (real, "/rust")],
        linker: Some(linker),
    })
}

fn linker(place: &Place) -> Option<PathBuf> {
    let in_sysroot = |sysroot: &Path| {
        let hosts = std::fs::read_dir(sysroot.join("lib/rustlib"))
            .into_iter()
            .flatten()
            .flatten();
        hosts
            .map(|host| host.path().join("bin/rust-lld"))
            .find(|lld| lld.is_file())
    };
    let debians = ["/usr/bin/ld.lld-19", "/usr/bin/ld.lld"].map(PathBuf::from);
    in_sysroot(&place.sysroot).or_else(|| debians.into_iter().find(|lld| lld.is_file()))
}

/// Installs Debian packages, as root or with a sudo that asks for no password.
///
/// # Errors
/// Where that is not possible here, and what could be typed instead.
pub fn apt_install(packages: &[&str]) -> Result<()> {
    if !shell::installed("apt-get") {
        return failed("this machine has no apt-get");
    }
    let root = shell::ask(Command::new("id").arg("-u")).is_some_and(|id| id == "0");
    if !root && shell::ask(Command::new("sudo").args(["-n", "true"])).is_none() {
        return failed(format!(
            "neither root nor sudo without a password: `sudo apt-get install {}` would do it",
            packages.join(" ")
        ));
    }
    let apt = |words: &[&str]| {
        let mut command = Command::new(if root { "env" } else { "sudo" });
        if !root {
            command.args(["-n", "env"]);
        }
        command
            .args(["DEBIAN_FRONTEND=noninteractive", "apt-get", "-q", "-y"])
            .args(words);
        shell::run_within(&mut command, Duration::from_mins(10))
    };
    let install = [&["install", "--no-install-recommends"], packages].concat();
    // A list that is an hour old is good enough; where it is too old the installation says so.
    apt(&install).or_else(|_| apt(&["update"]).and_then(|()| apt(&install)))
}

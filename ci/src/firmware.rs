//! Building the ELF that is flashed, the same bytes wherever it is built.

use std::path::{Path, PathBuf};

use crate::arm::Arm;
use crate::elf::Elf;
use crate::error::{failed, Of, Result};
use crate::place::Place;
use crate::shell;

/// Which of the two firmwares.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub enum Edition {
    /// Every optional part, fast where it counts.
    #[default]
    Full,
    /// No optional part, small throughout, for 32 KiB of flash.
    Minimal,
}

impl Edition {
    /// What is built and checked.
    pub const ALL: [Self; 1] = [Self::Full];

    /// The ELF's name without its extension.
    pub const fn name(self) -> &'static str {
        match self {
            Self::Full => "fw-pac",
            Self::Minimal => "fw-pac-minimal",
        }
    }

    /// Its section in `ci/budget.toml`.
    pub const fn budget(self) -> &'static str {
        match self {
            Self::Full => "firmware.at_most",
            Self::Minimal => "minimal_firmware.at_most",
        }
    }

    const fn profile(self) -> &'static str {
        match self {
            Self::Full => "firmware",
            Self::Minimal => "firmware-minimal",
        }
    }

    /// What the compiler is told beside the profile: the core it runs on, and for the minimal one
    /// to inline only where that makes the code smaller.
    const fn flags(self) -> &'static [&'static str] {
        match self {
            Self::Full => &["-C", "target-cpu=cortex-m4"],
            Self::Minimal => &[
                "-C",
                "target-cpu=cortex-m4",
                "-C",
                "llvm-args=-inline-threshold=0",
            ],
        }
    }
}

/// A built ELF, kept apart from builds with other features.
pub struct Image {
    /// The file.
    pub path: PathBuf,
    /// What it occupies.
    pub sizes: crate::elf::Sizes,
}

/// Builds the firmware of this workspace with `features` beside those of its edition (comma-separated,
/// `""` for what is flashed).
///
/// # Errors
/// Where cargo fails or the ELF cannot be read.
pub fn build(place: &Place, arm: &Arm, edition: Edition, features: &str) -> Result<Image> {
    let built = build_in(place, arm, &place.root, &arm.target_dir, edition, features)?;
    let mut name = String::from(edition.name());
    for feature in features.split(',').filter(|feature| !feature.is_empty()) {
        name.push('-');
        name.push_str(feature);
    }
    // Cargo keeps one file whatever the features: a copy per set of features stays valid.
    let path = arm.target_dir.join("elf").join(format!("{name}.elf"));
    shell::copy(&built, &path)?;
    let bytes = std::fs::read(&path).of(path.display())?;
    let sizes = Elf::parse(&bytes)?.sizes();
    println!(
        "firmware: {}: flash {} bytes, static RAM {} bytes",
        place.short(&path),
        sizes.flash,
        sizes.ram
    );
    Ok(Image { path, sizes })
}

/// Builds the firmware of the workspace in `root`, into `target_dir`; where cargo left the ELF.
///
/// # Errors
/// Where cargo fails.
pub fn build_in(
    place: &Place,
    arm: &Arm,
    root: &Path,
    target_dir: &Path,
    edition: Edition,
    features: &str,
) -> Result<PathBuf> {
    let mut words = vec![
        "build",
        "--locked",
        "--package",
        "fw-pac",
        "--profile",
        edition.profile(),
    ];
    let target_word = target_dir.to_string_lossy();
    words.extend(["--target-dir", &target_word]);
    if !features.is_empty() {
        words.extend(["--features", features]);
    }
    shell::run(&mut arm.cargo(place, root, &words, &flags(arm, root, edition)))?;
    let elf = target_dir
        .join(crate::arm::TARGET)
        .join(edition.profile())
        .join("fw-pac");
    if elf.is_file() {
        Ok(elf)
    } else {
        failed(format!("cargo built no {}", elf.display()))
    }
}

/// The compiler's flags: the edition's own, and every path of this machine under a name that is the
/// same on all.
fn flags(arm: &Arm, root: &Path, edition: Edition) -> Vec<String> {
    let mut names: Vec<(PathBuf, String)> = vec![(cargo_home(), "/cargo".into())];
    // Each registry's folder carries a hash of its address: give it a name without.
    let registries = std::fs::read_dir(cargo_home().join("registry/src"));
    for folder in registries.into_iter().flatten().flatten() {
        names.push((folder.path(), "/registry".into()));
    }
    names.extend(
        arm.remap
            .iter()
            .map(|(from, to)| (from.clone(), (*to).to_owned())),
    );
    names.push((root.to_path_buf(), "/robot".into()));
    // rustc takes the last prefix that fits, so the longest must come last.
    names.sort_by_key(|(from, _)| from.as_os_str().len());
    let renamed = names
        .iter()
        .map(|(from, to)| format!("--remap-path-prefix={}={to}", from.display()));
    let own = edition.flags().iter().map(|&flag| flag.to_owned());
    own.chain(renamed).collect()
}

/// Where cargo keeps its registry.
pub fn cargo_home() -> PathBuf {
    let home = || std::env::var_os("HOME").map(|home| Path::new(&home).join(".cargo"));
    std::env::var_os("CARGO_HOME")
        .map(PathBuf::from)
        .or_else(home)
        .unwrap_or_default()
}

//! Building the ELF that is flashed, the same bytes wherever it is built.

use std::path::{Path, PathBuf};

use serde_json::Value;

use crate::elf::{Elf, Sizes};
use crate::error::Result;
use crate::toolchain::{TARGET, Toolchain, entries};
use crate::workspace::{Workspace, list, text};

/// A built ELF, kept apart from builds with other features.
pub struct Image {
    pub path: PathBuf,
    pub bytes: Vec<u8>,
    pub sizes: Sizes,
}

/// A program for the robot's core; its package's features.
#[derive(Clone, Copy)]
pub struct Program {
    pub package: &'static str,
    pub name: &'static str,
    pub features: &'static str,
}

/// What is flashed.
pub const RELEASE: Program = Program {
    package: "fw-pac",
    name: "fw-pac",
    features: "",
};
/// What tries a bare board.
pub const BRINGUP: Program = Program {
    name: "bringup",
    ..RELEASE
};
/// A program of `tests/bench`, built as the firmware is.
pub const fn bench(name: &'static str) -> Program {
    Program {
        package: "odometry-bench",
        name,
        ..RELEASE
    }
}

/// Builds a program of this workspace.
pub fn build(workspace: &Workspace, toolchain: &Toolchain, program: Program) -> Result<Image> {
    let (sh, target) = (&workspace.sh, &toolchain.target_dir);
    let built = build_in(workspace, toolchain, &workspace.root, target, program)?;
    let name = format!("{}-{}", program.name, program.features);
    let name = name.trim_end_matches('-');
    // Cargo keeps one file whatever the features: a copy per set of features stays valid.
    let path = target.join(format!("elf/{name}.elf"));
    sh.create_dir(target.join("elf"))?;
    let bytes = sh.read_binary_file(built)?;
    // Written only where it changed: a test may be reading it.
    if sh.read_binary_file(&path).ok().as_ref() != Some(&bytes) {
        sh.write_file(&path, &bytes)?;
    }
    let sizes = Elf::parse(&bytes)?.sizes();
    let (Sizes { flash, ram }, file) = (sizes, workspace.relative(&path));
    println!("firmware: {file}: flash {flash} bytes, static RAM {ram} bytes");
    Ok(Image { path, bytes, sizes })
}

/// Builds a program of the workspace in `root` into `target_dir`; returns where cargo left the ELF.
pub fn build_in(
    workspace: &Workspace,
    toolchain: &Toolchain,
    root: &Path,
    target_dir: &Path,
    program: Program,
) -> Result<PathBuf> {
    let _in_root = workspace.sh.push_dir(root);
    let (package, name) = (program.package, program.name);
    let words = format!("build --locked --package {package} --bin {name} --profile firmware");
    let cargo = toolchain.cargo(workspace, &words, &flags(workspace, toolchain, root)?);
    let cargo = cargo.args(["--features", program.features, "--target-dir"]);
    cargo.arg(target_dir).run()?;
    Ok(target_dir.join(TARGET).join("firmware").join(name))
}

/// The target's flags of `.cargo/config.toml`, which a plain `cargo build` takes by itself and
/// [`Toolchain::cargo`] replaces, and a name that is the same on every machine for every path of this one.
fn flags(workspace: &Workspace, toolchain: &Toolchain, root: &Path) -> Result<Vec<String>> {
    let mut names = vec![(cargo_home(), "/cargo"), (root.to_path_buf(), "/robot")];
    names.extend(toolchain.remap.iter().cloned());
    // Each registry's folder carries a hash of its address: give it a name without.
    let registries = entries(cargo_home().join("registry/src"));
    names.extend(registries.map(|folder| (folder, "/registry")));
    // rustc takes the last prefix that fits, so the longest must come last.
    names.sort_by_key(|(from, _)| from.as_os_str().len());
    let remap = |(from, to): (PathBuf, _)| format!("--remap-path-prefix={}={to}", from.display());
    let config = workspace.root.join(".cargo/config.toml");
    let config: Value = toml::from_str(&workspace.sh.read_file(config)?)?;
    let flags = list(&config["target"][TARGET]["rustflags"]).iter();
    let mut flags: Vec<_> = flags.map(|flag| text(flag).to_owned()).collect();
    flags.extend(names.into_iter().map(remap));
    Ok(flags)
}

/// Where cargo keeps its registry.
pub fn cargo_home() -> PathBuf {
    let home = || Path::new(&std::env::var_os("HOME").unwrap_or_default()).join(".cargo");
    std::env::var_os("CARGO_HOME").map_or_else(home, PathBuf::from)
}

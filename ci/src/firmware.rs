//! Building the ELF that is flashed, the same bytes wherever it is built.

use std::path::{Path, PathBuf};

use crate::elf::{Elf, Sizes};
use crate::error::{ensure, Context, Result};
use crate::process;
use crate::toolchain::{Toolchain, TARGET};
use crate::workspace::Workspace;

/// A built ELF, kept apart from builds with other features.
pub struct Image {
    pub path: PathBuf,
    pub sizes: Sizes,
}

impl Image {
    pub fn bytes(&self) -> Result<Vec<u8>> {
        std::fs::read(&self.path).with_context(|| self.path.display().to_string())
    }
}

/// Builds the firmware of this workspace with `features` (comma-separated, `""` for what is flashed).
pub fn build(workspace: &Workspace, toolchain: &Toolchain, features: &str) -> Result<Image> {
    let built = build_in(
        workspace,
        toolchain,
        &workspace.root,
        &toolchain.target_dir,
        features,
    )?;
    let parts =
        std::iter::once("fw-pac").chain(features.split(',').filter(|name| !name.is_empty()));
    let name = parts.collect::<Vec<_>>().join("-");
    // Cargo keeps one file whatever the features: a copy per set of features stays valid.
    let path = toolchain.target_dir.join(format!("elf/{name}.elf"));
    copy(&built, &path)?;
    let mut image = Image {
        path,
        sizes: Sizes::default(),
    };
    image.sizes = Elf::parse(&image.bytes()?)?.sizes();
    let (file, Sizes { flash, ram }) = (workspace.relative(&image.path), image.sizes);
    println!("firmware: {file}: flash {flash} bytes, static RAM {ram} bytes");
    Ok(image)
}

/// Builds the firmware of the workspace in `root` into `target_dir`; returns where cargo left the ELF.
pub fn build_in(
    workspace: &Workspace,
    toolchain: &Toolchain,
    root: &Path,
    target_dir: &Path,
    features: &str,
) -> Result<PathBuf> {
    let words = "build --locked --package fw-pac --profile firmware";
    let mut cargo = toolchain.cargo(workspace, root, words, &flags(workspace, toolchain, root)?);
    cargo
        .arg("--target-dir")
        .arg(target_dir)
        .args(["--features", features]);
    process::run(cargo)?;
    let elf = target_dir.join(TARGET).join("firmware/fw-pac");
    ensure!(elf.is_file(), "cargo built no {}", elf.display());
    Ok(elf)
}

/// The compiler's flags: the core it builds for, and a name that is the same on every machine for
/// every path of this one.
fn flags(workspace: &Workspace, toolchain: &Toolchain, root: &Path) -> Result<Vec<String>> {
    let mut names = vec![(cargo_home(), "/cargo"), (root.to_path_buf(), "/robot")];
    names.extend(toolchain.remap.iter().cloned());
    // Each registry's folder carries a hash of its address: give it a name without.
    let registries = std::fs::read_dir(cargo_home().join("registry/src"));
    let registries = registries.into_iter().flatten().flatten();
    names.extend(registries.map(|folder| (folder.path(), "/registry")));
    // rustc takes the last prefix that fits, so the longest must come last.
    names.sort_by_key(|(from, _)| from.as_os_str().len());
    let mut flags = target_flags(workspace)?;
    flags.extend(
        names
            .iter()
            .map(|(from, to)| format!("--remap-path-prefix={}={to}", from.display())),
    );
    Ok(flags)
}

/// The target's flags of `.cargo/config.toml`, which a plain `cargo build` takes by itself and
/// [`Toolchain::cargo`] replaces.
pub fn target_flags(workspace: &Workspace) -> Result<Vec<String>> {
    let text = workspace.read(".cargo/config.toml")?;
    let config: toml::Table = text.parse().context(".cargo/config.toml")?;
    let flags = config["target"][TARGET]["rustflags"].clone();
    flags.try_into().context(".cargo/config.toml: rustflags")
}

/// Where cargo keeps its registry.
pub fn cargo_home() -> PathBuf {
    let home = || Path::new(&std::env::var_os("HOME").unwrap_or_default()).join(".cargo");
    std::env::var_os("CARGO_HOME").map_or_else(home, PathBuf::from)
}

/// Copies `from` to `to`, making the folder of `to`.
pub fn copy(from: &Path, to: &Path) -> Result<()> {
    let copied = to.parent().map_or(Ok(()), std::fs::create_dir_all);
    let copied = copied.and_then(|()| std::fs::copy(from, to));
    copied.with_context(|| format!("{} to {}", from.display(), to.display()))?;
    Ok(())
}

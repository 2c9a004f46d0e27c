//! Building the ELF that is flashed, the same bytes wherever it is built.

use std::path::{Path, PathBuf};

use serde_json::Value;

use crate::elf::{Elf, Sizes};
use crate::error::Result;
use crate::session::{Image, Session, once};
use crate::toolchain::{TARGET, entries};
use crate::workspace::{list, text};

impl Session {
    /// What is flashed.
    pub fn image(&self) -> Result<&Image> {
        once(&self.image, || self.build("fw-pac", "fw-pac", ""))
    }

    /// Builds a program for the robot's core, of a package with these features.
    pub fn build(&self, package: &str, name: &str, features: &str) -> Result<Image> {
        let (sh, target) = (&self.sh, &self.toolchain()?.target_dir);
        let program = format!("--package {package} --bin {name} --features={features}");
        let built = self.build_in(&self.root, target, &program)?.join(name);
        let name = format!("{name}-{features}");
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
        let (Sizes { flash, ram }, file) = (sizes, self.relative(&path));
        println!("firmware: {file}: flash {flash} bytes, static RAM {ram} bytes");
        Ok(Image { path, bytes, sizes })
    }

    /// Builds a firmware of a copy of the workspace; returns where cargo left the ELF.
    pub fn build_copy(&self, root: &Path, name: &str) -> Result<PathBuf> {
        let program = format!("--package fw-pac --bin {name}");
        Ok(self
            .build_in(root, &root.join("target"), &program)?
            .join(name))
    }

    /// Builds a program, as cargo's words name it; returns the folder where cargo left it.
    fn build_in(&self, root: &Path, target_dir: &Path, program: &str) -> Result<PathBuf> {
        let (toolchain, flags) = (self.toolchain()?, self.flags(root)?);
        let _in_root = self.sh.push_dir(root);
        let words = format!("build --locked --profile firmware {program}");
        let cargo = toolchain.cargo(self, &words, flags);
        cargo.arg("--target-dir").arg(target_dir).run()?;
        Ok(target_dir.join(TARGET).join("firmware"))
    }

    /// The target's flags of `.cargo/config.toml`, which a plain `cargo build` takes by itself and
    /// the toolchain's cargo replaces, and a name that is the same on every machine for every path
    /// of this one.
    fn flags(&self, root: &Path) -> Result<Vec<String>> {
        let mut names = vec![(cargo_home(), "/cargo"), (root.to_path_buf(), "/robot")];
        names.extend(self.toolchain()?.remap.iter().cloned());
        // Each registry's folder carries a hash of its address: give it a name without.
        let registries = entries(cargo_home().join("registry/src"));
        names.extend(registries.map(|folder| (folder, "/registry")));
        // rustc takes the last prefix that fits, so the longest must come last.
        names.sort_by_key(|(from, _)| from.as_os_str().len());
        let remap =
            |(from, to): (PathBuf, _)| format!("--remap-path-prefix={}={to}", from.display());
        let config = self.sh.read_file(self.root.join(".cargo/config.toml"))?;
        let config: Value = toml::from_str(&config)?;
        let flags = list(&config["target"][TARGET]["rustflags"]).iter();
        let mut flags: Vec<_> = flags.map(|flag| text(flag).to_owned()).collect();
        flags.extend(names.into_iter().map(remap));
        Ok(flags)
    }
}

/// Where cargo keeps its registry.
pub fn cargo_home() -> PathBuf {
    let usual = std::env::home_dir().unwrap_or_default().join(".cargo");
    std::env::var_os("CARGO_HOME").map_or(usual, PathBuf::from)
}

//! The workspace on this machine: its folders, files and packages.

use std::path::{Path, PathBuf};

use serde_json::Value;
use xshell::{Cmd, Shell, cmd};

use crate::error::{Context, Kind, Result, fail};
use crate::process;

/// All packages that run on a computer.
pub const HOST: &str = "--workspace --exclude fw-pac";

pub struct Workspace {
    /// In the workspace's root.
    pub sh: Shell,
    pub root: PathBuf,
    /// Cargo's target folder.
    pub target: PathBuf,
    /// The compiler's sysroot.
    pub sysroot: PathBuf,
}

impl Workspace {
    /// The workspace in which cargo runs this program, a copy of the one that built it included.
    pub fn find() -> Result<Self> {
        let runs = std::env::var_os("CARGO_MANIFEST_DIR");
        let folder = runs.unwrap_or_else(|| env!("CARGO_MANIFEST_DIR").into());
        let root = Path::new(&folder).parent();
        let root = root.context("the ci folder has no parent")?.to_path_buf();
        let sh = Shell::new()?;
        sh.change_dir(&root);
        let Some(sysroot) = process::output(cmd!(sh, "rustc --print sysroot")) else {
            let missing = "rustc does not answer; install Rust with rustup";
            return fail(Kind::MissingProgram, missing);
        };
        let mut workspace = Self {
            sh,
            root,
            target: PathBuf::new(),
            sysroot: sysroot.into(),
        };
        let metadata = workspace.metadata("--no-deps")?;
        workspace.target = text(&metadata["target_directory"]).into();
        // What `cargo run` added for this program alone.
        let own = [&workspace.target, &workspace.sysroot];
        let is_own = |path: &PathBuf| own.iter().any(|own| path.starts_with(own));
        let paths = std::env::var_os("LD_LIBRARY_PATH").unwrap_or_default();
        let paths = std::env::split_paths(&paths).filter(|path| !is_own(path));
        let paths = std::env::join_paths(paths)?;
        workspace.sh.set_var("LD_LIBRARY_PATH", paths);
        // Where `require_tool` installs.
        let mut paths = vec![workspace.target.join("tools/bin")];
        let path = std::env::var_os("PATH").unwrap_or_default();
        paths.extend(std::env::split_paths(&path));
        workspace.sh.set_var("PATH", std::env::join_paths(paths)?);
        Ok(workspace)
    }

    /// The machine's cargo, in the shell's folder; `words` are parted by blanks.
    pub fn cargo(&self, words: &str) -> Cmd<'_> {
        let cargo = std::env::var_os("CARGO").unwrap_or_else(|| "cargo".into());
        let cargo = self.sh.cmd(cargo).args(words.split_whitespace());
        // Cargo would take the variables that `cargo run` set for this program for its own.
        let keys = std::env::vars_os().filter_map(|(key, _)| key.into_string().ok());
        let own = ["CARGO_PKG_", "CARGO_MANIFEST_"];
        let own = keys.filter(|key| own.iter().any(|start| key.starts_with(start)));
        own.fold(cargo, Cmd::env_remove)
    }

    /// [`Self::cargo`] on packages that need the virtual board's crate, which may declare a newer
    /// compiler than this one.
    pub fn cargo_with_board(&self, words: &str) -> Result<Cmd<'_>> {
        let metadata = self.metadata("")?;
        let declared = list(&metadata["packages"]).iter();
        let declared = declared.map(|package| version(text(&package["rust_version"])));
        let newest = declared.max();
        let rustc = release(&cmd!(self.sh, "rustc --version").quiet().read()?);
        let ignore = (newest > Some(rustc)).then_some("--ignore-rust-version");
        Ok(self.cargo(words).args(ignore))
    }

    /// [`Self::cargo_with_board`] on all that runs on a computer without a sanitizer. Whatever is built or
    /// tested of it, dependencies get the same features and are built once.
    pub fn cargo_on_host(&self, words: &str) -> Result<Cmd<'_>> {
        self.cargo_with_board(&format!("{words} {HOST} --exclude robot-fuzz"))
    }

    /// Whether a program of that name is in the search path.
    pub fn has(&self, program: &str) -> bool {
        let path = self.sh.var_os("PATH").unwrap_or_default();
        std::env::split_paths(&path).any(|folder| folder.join(program).is_file())
    }

    /// Builds a program that runs on a computer; returns its path.
    pub fn build_program(&self, name: &str) -> Result<PathBuf> {
        let build = format!("build --release --bin {name}");
        self.cargo_on_host(&build)?.run()?;
        Ok(self.target.join("release").join(name))
    }

    /// rustup, which waits long where there is no network.
    pub fn rustup(&self, words: &str) -> Cmd<'_> {
        let rustup = cmd!(self.sh, "timeout 300 rustup");
        rustup.args(words.split(' '))
    }

    /// cargo of another of rustup's toolchains, installed where it is missing.
    pub fn cargo_of(&self, toolchain: &str) -> Result<Cmd<'_>> {
        let cargo = || {
            let cargo = cmd!(self.sh, "rustup run {toolchain} cargo");
            // The toolchain's own compiler must win over the one this program runs under.
            let foreign = ["CARGO", "RUSTC", "RUSTUP_TOOLCHAIN"].into_iter();
            foreign.fold(cargo, Cmd::env_remove)
        };
        let installed = || process::output(cargo().arg("--version")).is_some();
        let install = format!("toolchain install {toolchain} --profile minimal");
        let name = format!("Rust {toolchain}");
        process::require(installed, &self.rustup(&install), &name)?;
        Ok(cargo())
    }

    /// Requires cargo's subcommand `NAME@VERSION`; builds it below the target folder where it is missing,
    /// which leaves the machine's own cargo alone.
    pub fn require_tool(&self, tool: &str) -> Result<()> {
        let root = self.target.join("tools");
        let build = root.join("build");
        // It starts other programs and waits: unoptimised it builds in half the time. Its own target
        // folder: ours may be of another compiler's settings.
        let install = self.cargo("install --debug --locked --quiet --root");
        let install = install.arg(root).arg(format!("cargo-{tool}"));
        let install = install.env("CARGO_PROFILE_DEV_DEBUG", "0");
        let install = install.env("CARGO_TARGET_DIR", build);
        let name = tool.split('@').next().unwrap_or(tool);
        let version = format!("{name} --version");
        let installed = || process::output(self.cargo(&version)).is_some();
        process::require(installed, &install, &format!("cargo-{name}"))
    }

    /// What `cargo metadata` says.
    pub fn metadata(&self, words: &str) -> Result<Value> {
        let metadata = self.cargo(&format!("metadata --format-version 1 {words}"));
        serde_json::from_str(&metadata.quiet().read()?).context("cargo metadata")
    }

    /// The packages of the workspace.
    pub fn packages(&self) -> Result<Vec<Value>> {
        let metadata = self.metadata("--no-deps")?;
        Ok(list(&metadata["packages"]).to_vec())
    }

    /// A path relative to the workspace's root.
    pub fn relative<'a>(&self, path: &'a Path) -> std::path::Display<'a> {
        path.strip_prefix(&self.root).unwrap_or(path).display()
    }

    /// Every file below a folder that was neither built nor belongs to git, in order.
    pub fn files(&self, folder: impl AsRef<Path>) -> Result<Vec<PathBuf>> {
        let (mut files, mut folders) = (Vec::new(), vec![self.root.join(folder)]);
        while let Some(folder) = folders.pop() {
            for path in self.sh.read_dir(folder)? {
                if !path.is_dir() {
                    files.push(path);
                } else if path != self.target
                    && !["target", ".git"].iter().any(|name| path.ends_with(name))
                {
                    folders.push(path);
                }
            }
        }
        files.sort();
        Ok(files)
    }

    /// Brings a copy of the workspace up to date; equal files keep their time, so that cargo builds only what
    /// changed.
    pub fn copy_to(&self, root: &Path) -> Result<()> {
        self.sh.create_dir(root)?;
        // What is gone from the workspace must not be built.
        for copy in self.files(root)? {
            if !self.root.join(copy.strip_prefix(root)?).is_file() {
                std::fs::remove_file(copy)?;
            }
        }
        for file in self.files("")? {
            let copy = root.join(file.strip_prefix(&self.root)?);
            if std::fs::read(&file)? != std::fs::read(&copy).unwrap_or_default() {
                self.sh.create_dir(copy.parent().unwrap_or(root))?;
                self.sh.copy_file(&file, copy)?;
            }
        }
        Ok(())
    }

    /// Every file below a folder with this extension, by its path from the root, with its text.
    pub fn texts(&self, folder: &str, extension: &str) -> Result<Vec<(String, String)>> {
        let mut files = self.files(folder)?;
        files.retain(|file| file.extension().is_some_and(|found| found == extension));
        let read = |file: &PathBuf| Ok((self.relative(file).to_string(), self.sh.read_file(file)?));
        files.iter().map(read).collect()
    }
}

/// Source without comments and without the tests at its end.
pub fn code_of(source: &str) -> String {
    let bare = process::pattern(r"(?m)^ *//.*$").replace_all(source, "");
    let code = bare.split("\n#[cfg(test)]\nmod tests {").next();
    code.unwrap_or_default().to_owned()
}

/// The entries of a JSON list; none where it is no list.
pub fn list(value: &Value) -> &[Value] {
    value.as_array().map_or(&[], Vec::as_slice)
}

/// A JSON string; empty where it is none.
pub fn text(value: &Value) -> &str {
    value.as_str().unwrap_or_default()
}

/// The first two numbers of `1.95.0`.
fn version(text: &str) -> (u32, u32) {
    let mut numbers = text.split(['.', '-']).flat_map(str::parse);
    (numbers.next().unwrap_or(0), numbers.next().unwrap_or(0))
}

/// The release in `rustc 1.95.0 (…)`.
pub fn release(answer: &str) -> (u32, u32) {
    version(answer.split(' ').nth(1).unwrap_or(""))
}

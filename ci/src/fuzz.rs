//! The fuzz targets: finding or installing cargo-fuzz, building, running, and the figures of a run.

use std::fmt;
use std::path::{Path, PathBuf};
use std::process::Command;
use std::sync::Mutex;
use std::thread;
use std::time::Duration;

use crate::cargo_tool::{CargoTool, Found};
use crate::error::{bail, ensure, Context, Failure, Result};
use crate::process;
use crate::workspace::Workspace;

const CARGO_FUZZ: CargoTool = CargoTool {
    subcommand: "fuzz",
    version: "0.13.1",
};

/// The longest input that goes into a committed corpus, bytes: long enough for several frames or a second
/// of ticks, short enough to be tried often.
const LONGEST_SEED: usize = 512;

/// How the targets are built and run here.
pub struct Fuzzer<'w> {
    workspace: &'w Workspace,
    /// Goes in front of the search path, where cargo-fuzz was built here.
    tools: Option<PathBuf>,
}

/// libFuzzer's figures of a run.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub struct Figures {
    pub executions: u64,
    /// Executions a second.
    pub per_second: u64,
    /// Edges of the program reached.
    pub edges: u64,
    /// Edges that the program has, the libraries it is linked with included.
    pub all_edges: u64,
    /// Features: edges with how often, values compared, …
    pub features: u64,
    /// Inputs found that reach something new.
    pub found: u64,
}

/// How long to fuzz one target.
#[derive(Clone, Copy, Debug)]
pub enum Effort {
    /// The same inputs every time, from the committed corpus alone, until so many or so many seconds
    /// are over: for a gate, which must not fail by chance on a change that did nothing.
    Inputs(u32, u32),
    /// Ever new inputs for so many seconds, building on what earlier runs learned.
    Seconds(u32),
}

impl<'w> Fuzzer<'w> {
    /// Finds nightly Rust and cargo-fuzz, or installs them.
    pub fn find(workspace: &'w Workspace) -> Result<Self> {
        let rustup = |words: &str| {
            let mut rustup = Command::new("rustup");
            rustup.args(words.split(' '));
            rustup
        };
        let nightly = || process::output(rustup("run nightly rustc --version")).is_some();
        if !nightly() {
            let install = rustup("toolchain install nightly --profile minimal");
            let installed = process::run_within(Duration::from_mins(5), install);
            if installed.is_err() || !nightly() {
                bail!(Failure::MissingProgram(
                    "no nightly Rust (`rustup toolchain install nightly`)".into()
                ));
            }
        }
        let tools = match CARGO_FUZZ.find(workspace)? {
            Found::Machine => None,
            Found::Built(program) => program.parent().map(Path::to_path_buf),
        };
        Ok(Self { workspace, tools })
    }

    /// The names of the targets.
    pub fn targets(&self) -> Result<Vec<String>> {
        let files = self.workspace.files("fuzz/fuzz_targets")?;
        let stems = files.iter().filter_map(|file| file.file_stem());
        Ok(stems
            .map(|stem| stem.to_string_lossy().into_owned())
            .collect())
    }

    /// `cargo fuzz` with a subcommand, in the workspace's root.
    fn cargo_fuzz(&self, subcommand: &str) -> Command {
        let mut fuzz = Command::new("rustup");
        fuzz.args(["run", "nightly", "cargo", "fuzz", subcommand]);
        fuzz.arg("--target-dir")
            .arg(self.workspace.target.join("fuzz"));
        fuzz.current_dir(&self.workspace.root);
        for ours in ["CARGO", "RUSTC", "RUSTUP_TOOLCHAIN"] {
            fuzz.env_remove(ours);
        }
        if let Some(tools) = &self.tools {
            let path = std::env::var_os("PATH").unwrap_or_default();
            let paths = std::iter::once(tools.clone()).chain(std::env::split_paths(&path));
            if let Ok(path) = std::env::join_paths(paths) {
                fuzz.env("PATH", path);
            }
        }
        fuzz
    }

    /// Builds every target.
    pub fn build(&self) -> Result<()> {
        process::run(self.cargo_fuzz("build"))
    }

    /// Fuzzes one target from its committed corpus; what it learns stays in `target/fuzz/corpus`, what
    /// breaks the target in `fuzz/artifacts`.
    fn run(&self, target: &str, effort: Effort) -> Result<Figures> {
        let (folder, limits) = match effort {
            Effort::Inputs(count, seconds) => (
                "smoke",
                format!("-seed=1 -runs={count} -max_total_time={seconds}"),
            ),
            Effort::Seconds(seconds) => ("corpus", format!("-max_total_time={seconds}")),
        };
        // New inputs go to the first folder; the committed seeds are only read.
        let learned = self.workspace.target.join("fuzz").join(folder).join(target);
        if matches!(effort, Effort::Inputs(..)) && learned.exists() {
            std::fs::remove_dir_all(&learned)?;
        }
        std::fs::create_dir_all(&learned)?;
        let mut fuzz = self.cargo_fuzz("run");
        fuzz.arg(target).arg(&learned);
        fuzz.arg(self.workspace.root.join("fuzz/corpus").join(target));
        fuzz.arg("--")
            .args(limits.split(' '))
            .arg("-print_final_stats=1");
        let (status, text) = process::tee(fuzz, |_| true)?;
        ensure!(
            status.success(),
            "an input breaks {target}; it is in fuzz/artifacts"
        );
        Figures::parse(&text).with_context(|| format!("the fuzzer printed no figures of {target}"))
    }

    /// Renews the committed corpus of one target: its named seeds, and the fewest inputs of the rest and
    /// of what long runs learned that reach all that those reach together. Returns how many there were
    /// before and are now.
    pub fn minimise(&self, target: &str) -> Result<(usize, usize)> {
        let committed = self.workspace.root.join("fuzz/corpus").join(target);
        let learned = self.workspace.target.join("fuzz/corpus").join(target);
        let old = self.workspace.target.join("fuzz/before").join(target);
        if old.exists() {
            std::fs::remove_dir_all(&old)?;
        }
        std::fs::create_dir_all(&learned)?;
        std::fs::create_dir_all(&old)?;
        let before = self.workspace.files(&committed)?;
        for file in &before {
            let name = file.file_name().unwrap_or_default();
            if found_by_the_fuzzer(&name.to_string_lossy()) {
                std::fs::rename(file, old.join(name))?;
            }
        }
        let mut fuzz = self.cargo_fuzz("run");
        fuzz.arg(target).args([&committed, &old, &learned]);
        fuzz.args(["--", "-set_cover_merge=1"]);
        fuzz.arg(format!("-max_len={LONGEST_SEED}"));
        process::run(fuzz)?;
        Ok((before.len(), self.workspace.files(&committed)?.len()))
    }

    /// Fuzzes the targets, two at a time; prints each one's figures and returns the figure of all. An
    /// error names every target that broke.
    pub fn run_all(&self, targets: &[String], effort: Effort) -> Result<String> {
        let next = Mutex::new(targets.iter());
        let done = Mutex::new(Vec::new());
        thread::scope(|scope| {
            for _ in 0..2 {
                scope.spawn(|| loop {
                    let target = next.lock().ok().and_then(|mut next| next.next());
                    let Some(target) = target else { break };
                    let ran = self.run(target, effort);
                    if let Ok(mut done) = done.lock() {
                        done.push((target, ran));
                    }
                });
            }
        });
        let (mut broken, mut all) = (Vec::new(), Vec::new());
        for (target, ran) in done.into_inner().unwrap_or_default() {
            match ran {
                Ok(figures) => {
                    println!("  {target}: {figures}");
                    all.push(figures);
                }
                Err(error) => broken.push(error.to_string()),
            }
        }
        ensure!(broken.is_empty(), broken.join("; "));
        let executions: u64 = all.iter().map(|figures| figures.executions).sum();
        let least = all
            .iter()
            .map(|figures| figures.executions)
            .min()
            .unwrap_or(0);
        Ok(format!(
            "{} targets, {executions} executions, {least} at least",
            targets.len()
        ))
    }
}

/// Whether a file of a corpus is the fuzzer's, which names them by their SHA-1, or written by hand.
fn found_by_the_fuzzer(name: &str) -> bool {
    name.len() == 40 && name.bytes().all(|byte| byte.is_ascii_hexdigit())
}

impl Figures {
    /// From what libFuzzer prints.
    fn parse(text: &str) -> Option<Self> {
        // `stat::new_units_added:          17`
        let stat = |name: &str| {
            let mut lines = text
                .lines()
                .rev()
                .filter_map(|line| line.strip_prefix("stat::"));
            lines.find_map(|line| line.strip_prefix(name)?.trim().parse().ok())
        };
        // `INFO: Loaded 1 modules   (10245 inline 8-bit counters): 10245 [0x…, 0x…),`
        let all_edges = text.lines().find_map(|line| {
            let (_, counters) = line.split_once("modules")?.1.split_once('(')?;
            counters.split_once(' ')?.0.parse().ok()
        });
        // `#1048576	DONE   cov: 455 ft: 1803 corp: …`, also for the lines before.
        let reached = |key: &str| {
            let mut lines = text.lines().rev().filter(|line| line.starts_with('#'));
            lines.find_map(|line| {
                let mut words = line.split_whitespace();
                words.find(|&word| word == key)?;
                words.next()?.parse().ok()
            })
        };
        Some(Self {
            executions: stat("number_of_executed_units:")?,
            per_second: stat("average_exec_per_sec:")?,
            edges: reached("cov:").unwrap_or(0),
            all_edges: all_edges.unwrap_or(0),
            features: reached("ft:").unwrap_or(0),
            found: stat("new_units_added:")?,
        })
    }
}

impl fmt::Display for Figures {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        let Self {
            executions,
            per_second,
            edges,
            all_edges,
            features,
            found,
        } = self;
        write!(
            f,
            "{executions} executions, {per_second} a second, {edges} of {all_edges} edges, "
        )?;
        write!(f, "{features} features, {found} new inputs")
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn figures_are_read_from_the_fuzzers_output() {
        let text = "\
INFO: Loaded 1 modules   (10245 inline 8-bit counters): 10245 [0x5, 0x7),
#2\tINITED cov: 11 ft: 12 corp: 1/1b
#9\tDONE   cov: 455 ft: 1803 corp: 9/1Kb
stat::number_of_executed_units: 1000000
stat::average_exec_per_sec:     9
stat::new_units_added:          17
";
        let expected = Figures {
            executions: 1_000_000,
            per_second: 9,
            edges: 455,
            all_edges: 10_245,
            features: 1803,
            found: 17,
        };
        assert_eq!(Figures::parse(text), Some(expected));
        assert_eq!(Figures::parse("Done 5 runs"), None);
    }
}

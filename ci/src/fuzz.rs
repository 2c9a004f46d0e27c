//! The fuzz targets: finding or installing cargo-fuzz, building, running, and what came of it.

use std::path::{Path, PathBuf};
use std::process::Command;
use std::sync::Mutex;
use std::thread;

use crate::error::{failed, Error, Of, Result};
use crate::place::Place;
use crate::shell;
use crate::tool::{Found, Tool};

const CARGO_FUZZ: Tool = Tool {
    subcommand: "fuzz",
    version: "0.13.1",
};

/// The longest input that goes into a committed corpus, bytes: long enough for several frames or a second
/// of ticks, short enough to be tried often.
const LONGEST_SEED: usize = 512;

/// How the targets are built and run here.
pub struct Fuzzer<'p> {
    place: &'p Place,
    /// Goes in front of the search path, where cargo-fuzz is our own.
    tools: Option<PathBuf>,
}

/// What a run came to: libFuzzer's own figures.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub struct Figures {
    /// Executions.
    pub executions: u64,
    /// Executions a second, as the fuzzer measured them on this machine.
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

impl<'p> Fuzzer<'p> {
    /// Finds cargo-fuzz, or installs it below the target folder.
    ///
    /// # Errors
    /// [`Error::Missing`] where there is no nightly Rust, or cargo-fuzz is not there and cannot be
    /// installed; says how to get it.
    pub fn find(place: &'p Place) -> Result<Self> {
        let nightly = ["run", "nightly", "rustc", "--version"];
        if !shell::installed("rustup") || shell::ask(Command::new("rustup").args(nightly)).is_none()
        {
            return Err(Error::Missing(
                "no nightly Rust (`rustup toolchain install nightly`)".into(),
            ));
        }
        let tools = match CARGO_FUZZ.find(place)? {
            Found::Machine => None,
            Found::Ours(program) => program.parent().map(Path::to_path_buf),
        };
        Ok(Self { place, tools })
    }

    /// The names of the targets.
    ///
    /// # Errors
    /// Where their folder cannot be read.
    pub fn targets(&self) -> Result<Vec<String>> {
        let folder = self.place.root.join("fuzz/fuzz_targets");
        let files = std::fs::read_dir(&folder).of(folder.display())?.flatten();
        let stem = |path: &Path| Some(path.file_stem()?.to_string_lossy().into_owned());
        let mut names: Vec<_> = files.filter_map(|file| stem(&file.path())).collect();
        names.sort();
        Ok(names)
    }

    /// `cargo fuzz` with a subcommand, in the workspace's root.
    fn cargo_fuzz(&self, subcommand: &str) -> Command {
        let mut fuzz = Command::new("rustup");
        fuzz.args(["run", "nightly", "cargo", "fuzz", subcommand]);
        fuzz.arg("--target-dir").arg(self.place.target.join("fuzz"));
        fuzz.current_dir(&self.place.root);
        fuzz.env_remove("CARGO")
            .env_remove("RUSTC")
            .env_remove("RUSTUP_TOOLCHAIN");
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
    ///
    /// # Errors
    /// Where one does not compile.
    pub fn build(&self) -> Result<()> {
        shell::run(&mut self.cargo_fuzz("build"))
    }

    /// Fuzzes one target from its committed corpus; what it learns stays in `target/fuzz/corpus`, what
    /// breaks the target in `fuzz/artifacts`.
    ///
    /// # Errors
    /// Where the fuzzer found an input that breaks the target.
    pub fn run(&self, target: &str, effort: Effort) -> Result<Figures> {
        let (folder, limits) = match effort {
            Effort::Inputs(count, seconds) => (
                "smoke",
                vec![
                    "-seed=1".into(),
                    format!("-runs={count}"),
                    format!("-max_total_time={seconds}"),
                ],
            ),
            Effort::Seconds(seconds) => ("corpus", vec![format!("-max_total_time={seconds}")]),
        };
        // New inputs go to the first folder; the committed seeds are only read.
        let learned = self.place.target.join("fuzz").join(folder).join(target);
        if matches!(effort, Effort::Inputs(..)) && learned.exists() {
            std::fs::remove_dir_all(&learned).of(learned.display())?;
        }
        std::fs::create_dir_all(&learned).of(learned.display())?;
        let mut fuzz = self.cargo_fuzz("run");
        fuzz.arg(target).arg(&learned);
        fuzz.arg(self.place.root.join("fuzz/corpus").join(target));
        fuzz.arg("--").args(limits).arg("-print_final_stats=1");
        let (status, told) = shell::tee_any_end(&mut fuzz)?;
        if !status.success() {
            return failed(format!("an input breaks {target}; it is in fuzz/artifacts"));
        }
        Figures::of(&told)
    }

    /// Renews the committed corpus of one target: its named seeds, and the fewest inputs of the rest and
    /// of what long runs learned that reach all that those reach together. How many there were before
    /// and are now.
    ///
    /// # Errors
    /// Where the fuzzer fails, on an input that breaks the target for one, or a file cannot be moved.
    pub fn minimise(&self, target: &str) -> Result<(usize, usize)> {
        let committed = self.place.root.join("fuzz/corpus").join(target);
        let learned = self.place.target.join("fuzz/corpus").join(target);
        let old = self.place.target.join("fuzz/before").join(target);
        if old.exists() {
            std::fs::remove_dir_all(&old).of(old.display())?;
        }
        for folder in [&learned, &old] {
            std::fs::create_dir_all(folder).of(folder.display())?;
        }
        let mut count = 0;
        for entry in std::fs::read_dir(&committed)
            .of(committed.display())?
            .flatten()
        {
            count += 1;
            if found_by_the_fuzzer(&entry.file_name().to_string_lossy()) {
                let to = old.join(entry.file_name());
                std::fs::rename(entry.path(), &to).of(to.display())?;
            }
        }
        let mut fuzz = self.cargo_fuzz("run");
        fuzz.arg(target).args([&committed, &old, &learned]);
        fuzz.args(["--", "-set_cover_merge=1"]);
        fuzz.arg(format!("-max_len={LONGEST_SEED}"));
        shell::run(&mut fuzz)?;
        let now = std::fs::read_dir(&committed).of(committed.display())?;
        Ok((count, now.count()))
    }

    /// Runs all targets, two at a time; each one's figures, and what broke.
    pub fn run_all(&self, targets: &[String], effort: Effort) -> Vec<(String, Result<Figures>)> {
        let next = Mutex::new(targets.iter());
        let done = Mutex::new(Vec::new());
        thread::scope(|scope| {
            for _ in 0..2 {
                scope.spawn(|| loop {
                    let target = next.lock().ok().and_then(|mut next| next.next());
                    let Some(target) = target else { break };
                    let ran = self.run(target, effort);
                    if let Ok(mut done) = done.lock() {
                        done.push((target.clone(), ran));
                    }
                });
            }
        });
        let mut done = done.into_inner().unwrap_or_default();
        done.sort_by(|one, other| one.0.cmp(&other.0));
        done
    }
}

/// Whether a file of a corpus is the fuzzer's, which calls them by their SHA-1, or somebody's own.
fn found_by_the_fuzzer(name: &str) -> bool {
    name.len() == 40 && name.bytes().all(|byte| byte.is_ascii_hexdigit())
}

impl Figures {
    /// From what libFuzzer said.
    fn of(told: &str) -> Result<Self> {
        let stat = |name: &str| {
            let line = told.lines().rev().find_map(|line| {
                line.strip_prefix("stat::")?
                    .strip_prefix(name)?
                    .strip_prefix(':')
            });
            line.and_then(|number| number.trim().parse().ok())
        };
        let (Some(executions), Some(per_second), Some(found)) = (
            stat("number_of_executed_units"),
            stat("average_exec_per_sec"),
            stat("new_units_added"),
        ) else {
            return failed("the fuzzer said nothing of its executions");
        };
        // `INFO: Loaded 1 modules   (10245 inline 8-bit counters): 10245 [0x…, 0x…),`
        let all_edges = told.lines().find_map(|line| {
            let (_, counters) = line.split_once("modules")?.1.split_once('(')?;
            counters.split_once(' ')?.0.parse().ok()
        });
        // `#1048576	DONE   cov: 455 ft: 1803 corp: …`, also for the lines before.
        let reached = |key: &str| {
            told.lines()
                .rev()
                .filter(|line| line.starts_with('#'))
                .find_map(|line| {
                    let mut words = line.split_whitespace();
                    words.find(|&word| word == key)?;
                    words.next()?.parse().ok()
                })
                .unwrap_or(0)
        };
        Ok(Self {
            executions,
            per_second,
            edges: reached("cov:"),
            all_edges: all_edges.unwrap_or(0),
            features: reached("ft:"),
            found,
        })
    }
}

impl std::fmt::Display for Figures {
    fn fmt(&self, f: &mut std::fmt::Formatter<'_>) -> std::fmt::Result {
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
            "{executions} executions, {per_second} a second, {edges} of {all_edges} edges, \
             {features} features, {found} new inputs"
        )
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn the_fuzzers_last_words_are_its_figures() {
        let told =
            "INFO: Loaded 1 modules   (10245 inline 8-bit counters): 10245 [0x5, 0x7), \n\
                    #2\tINITED cov: 11 ft: 12 corp: 1/1b\n#9\tDONE   cov: 455 ft: 1803 corp: 9/1Kb\n\
                    stat::number_of_executed_units: 1000000\nstat::average_exec_per_sec:     9\n\
                    stat::new_units_added:          17\n";
        let figures = Figures::of(told).unwrap();
        let expected = Figures {
            executions: 1_000_000,
            per_second: 9,
            edges: 455,
            all_edges: 10_245,
            features: 1803,
            found: 17,
        };
        assert_eq!(figures, expected);
        assert!(Figures::of("Done 5 runs").is_err());
    }
}

//! Building tests and running them with one mutant on.

use std::os::unix::process::ExitStatusExt;
use std::path::{Path, PathBuf};
use std::process::{Command, Stdio};
use std::thread;
use std::time::{Duration, Instant};

use anyhow::{Context, Result, bail};
use serde_json::Value;

use crate::config::{Config, Stage};
use crate::workspace::cargo;

/// The most memory that tests with a mutant may take: a loop without an end may allocate in it.
const MEMORY_KIB: u32 = 2 << 20;

/// How the tests ended with a mutant.
#[derive(Clone, Copy, Debug, PartialEq, Eq, PartialOrd, Ord)]
pub enum Outcome {
    /// A test failed.
    Caught,
    /// The tests did not end in time.
    TimedOut,
    /// It does not compile.
    Unviable,
    /// Every test passed.
    Survived,
}

/// The built test programs of one stage.
#[derive(Clone)]
pub struct Suite {
    /// Each with the folder it expects to be started in.
    programs: Vec<(PathBuf, PathBuf)>,
    /// Arguments that leave out tests.
    skip: Vec<String>,
    /// How long all programs together may take.
    pub limit: Duration,
}

/// Why there is no suite: the compiler's messages, as cargo prints them in JSON.
#[derive(Debug, thiserror::Error)]
#[error("the tests do not compile")]
pub struct DoesNotCompile(pub String);

impl Suite {
    /// Builds a stage's tests in a copy of the workspace.
    ///
    /// # Errors
    /// [`DoesNotCompile`], or where cargo cannot be started.
    pub fn build(config: &Config, stage: &Stage, root: &Path, target: &Path) -> Result<Self> {
        let mut build = cargo();
        build.current_dir(root);
        build.args(["test", "--no-run", "--message-format=json"]);
        for package in &stage.packages {
            build.args(["--package", package]);
        }
        build.arg("--lib").args(stage.all.then_some("--tests"));
        build.args(&config.cargo_args);
        build.arg("--target-dir").arg(target).stderr(Stdio::null());
        // For the switch alone, see `switch.in.rs`; and a mutant may leave something unused.
        build.env("RUSTC_BOOTSTRAP", config.package.replace('-', "_"));
        build.env("RUSTFLAGS", "--cap-lints=allow");
        let answer = build.output().context("cargo test")?;
        let messages = String::from_utf8_lossy(&answer.stdout);
        if !answer.status.success() {
            bail!(DoesNotCompile(messages.into_owned()));
        }
        let skipped = stage.skip.iter().map(|name| format!("--skip={name}"));
        Ok(Self {
            programs: messages.lines().filter_map(program).collect(),
            skip: skipped.collect(),
            limit: Duration::from_mins(30),
        })
    }

    /// Runs the tests without a mutant, which gives the time limit for those with one; of the names in `only`,
    /// or all where that is empty.
    ///
    /// # Errors
    /// Where they fail.
    pub fn calibrate(&mut self, only: &[String]) -> Result<()> {
        let start = Instant::now();
        match self.run(0, only)? {
            Outcome::Survived => {}
            Outcome::TimedOut => bail!("the tests take half an hour without a mutant"),
            _ => bail!("the tests fail without a mutant"),
        }
        self.limit = start.elapsed() * 5 + Duration::from_secs(20);
        Ok(())
    }

    /// Runs the tests with a mutant on; of the names in `only`, or all where that is empty.
    ///
    /// # Errors
    /// Where a program cannot be started, or was killed by a signal.
    pub fn run(&self, mutant: usize, only: &[String]) -> Result<Outcome> {
        let end = Instant::now() + self.limit;
        for (program, folder) in &self.programs {
            let shown = || program.display().to_string();
            let mut tests = Command::new("sh");
            let limited = format!("ulimit -v {MEMORY_KIB} && exec \"$0\" \"$@\"");
            tests.arg("-c").arg(limited).arg(program);
            // The first failure is enough; libtest's option for that is unstable.
            tests.env("RUSTC_BOOTSTRAP", "1");
            tests.args(["-Zunstable-options", "--fail-fast"]);
            tests.args(&self.skip).args(only);
            tests.current_dir(folder).env("MUTANT", mutant.to_string());
            tests.stdout(Stdio::null()).stderr(Stdio::null());
            let mut child = tests.spawn().with_context(shown)?;
            let status = loop {
                if let Some(status) = child.try_wait().with_context(shown)? {
                    break status;
                }
                if Instant::now() > end {
                    let killed = child.kill().and_then(|()| child.wait());
                    killed.with_context(shown)?;
                    return Ok(Outcome::TimedOut);
                }
                thread::sleep(Duration::from_millis(20));
            };
            match (status.success(), status.signal()) {
                (true, _) => {}
                (false, Some(9)) => bail!("the tests were killed"),
                (false, _) => return Ok(Outcome::Caught),
            }
        }
        Ok(Outcome::Survived)
    }
}

/// The test program in one of cargo's messages, and its package's folder; a program that tests start is none.
fn program(message: &str) -> Option<(PathBuf, PathBuf)> {
    let message: Value = serde_json::from_str(message).ok()?;
    if message["profile"]["test"] != true {
        return None;
    }
    let executable = message["executable"].as_str()?;
    let manifest = Path::new(message["manifest_path"].as_str()?);
    Some((executable.into(), manifest.parent()?.to_owned()))
}

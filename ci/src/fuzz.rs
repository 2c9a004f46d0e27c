//! The fuzz targets: finding or installing cargo-fuzz, building, running.

use std::path::Path;

use xshell::{Cmd, cmd};

use crate::cargo_tool::CargoTool;
use crate::error::{Context, Failure, Result, bail, ensure};
use crate::process::{self, pattern};
use crate::workspace::Workspace;

const CARGO_FUZZ: CargoTool = CargoTool("fuzz", "0.13.1");

/// How long to fuzz one target.
#[derive(Clone, Copy, Debug)]
pub enum Effort {
    /// The same inputs every time, from the committed corpus alone, until so many or so many seconds
    /// are over: for a gate, which must not fail by chance on a change that did nothing.
    Inputs(u32, u32),
    /// Ever new inputs for so many seconds, building on what earlier runs learned.
    Seconds(u32),
}

/// Builds every target, after finding or installing nightly Rust and cargo-fuzz; the targets' names.
pub fn build(workspace: &Workspace) -> Result<Vec<String>> {
    let sh = &workspace.sh;
    let nightly = || process::output(cmd!(sh, "rustup run nightly rustc --version")).is_some();
    let install = cmd!(
        sh,
        "timeout 300 rustup toolchain install nightly --profile minimal"
    );
    if !nightly() && (install.run().is_err() || !nightly()) {
        let missing = "no nightly Rust (`rustup toolchain install nightly`)";
        bail!(Failure::MissingProgram(missing.into()));
    }
    cargo_fuzz(workspace, "build")?.run()?;
    let files = workspace.files("fuzz/fuzz_targets")?;
    let stems = files.iter().filter_map(|file| file.file_stem());
    Ok(stems
        .map(|stem| stem.to_string_lossy().into_owned())
        .collect())
}

/// Fuzzes one target, or all, for so many seconds each.
pub fn run_chosen(workspace: &Workspace, target: Option<String>, seconds: u32) -> Result<String> {
    let mut targets = build(workspace)?;
    if let Some(name) = target {
        if !targets.contains(&name) {
            let targets = targets.join(", ");
            let unknown = format!("no fuzz target {name}; there are {targets}");
            bail!(Failure::Usage(unknown));
        }
        targets = vec![name];
    }
    run(workspace, &targets, Effort::Seconds(seconds))
}

/// `cargo fuzz` with a subcommand, in the workspace's root.
fn cargo_fuzz<'s>(workspace: &'s Workspace, subcommand: &str) -> Result<Cmd<'s>> {
    let fuzz = cmd!(
        workspace.sh,
        "rustup run nightly cargo fuzz {subcommand} --target-dir"
    );
    let own = ["CARGO", "RUSTC", "RUSTUP_TOOLCHAIN"].into_iter();
    let fuzz = own.fold(fuzz.arg(workspace.target.join("fuzz")), Cmd::env_remove);
    let tools = CARGO_FUZZ.find(workspace)?;
    let path = std::env::var_os("PATH").unwrap_or_default();
    let paths = tools.parent().map(Path::to_path_buf).into_iter();
    let paths = std::env::join_paths(paths.chain(std::env::split_paths(&path)))?;
    Ok(fuzz.env("PATH", paths))
}

/// Fuzzes the targets from their committed corpora; what they learn stays in `target/fuzz/corpus`, what
/// breaks one in `fuzz/artifacts`. Prints each one's last figures. An error names every target that broke.
pub fn run(workspace: &Workspace, targets: &[String], effort: Effort) -> Result<String> {
    let (folder, limits) = match effort {
        Effort::Inputs(count, seconds) => {
            let limits = format!("-seed=1 -runs={count} -max_total_time={seconds}");
            ("smoke", limits)
        }
        Effort::Seconds(seconds) => ("corpus", format!("-max_total_time={seconds}")),
    };
    let (mut broken, mut least) = (Vec::new(), u64::MAX);
    for target in targets {
        // New inputs go to the first folder; the committed seeds are only read.
        let learned = workspace.target.join("fuzz").join(folder).join(target);
        if matches!(effort, Effort::Inputs(..)) {
            workspace.sh.remove_path(&learned)?;
        }
        workspace.sh.create_dir(&learned)?;
        let fuzz = cargo_fuzz(workspace, "run")?.arg(target).arg(learned);
        let fuzz = fuzz.arg(workspace.root.join("fuzz/corpus").join(target));
        let fuzz = fuzz.args(["--"]).args(limits.split(' '));
        let (success, text) = process::tee(fuzz, |_| true)?;
        let (executions, figures) = last_figures(&text).context("the fuzzer printed no figures")?;
        println!("  {target}: {executions} executions, {figures}");
        least = least.min(executions);
        if !success {
            broken.push(target.as_str());
        }
    }
    ensure!(
        broken.is_empty(),
        "inputs in fuzz/artifacts break {}",
        broken.join(", ")
    );
    Ok(format!(
        "{} targets, at least {least} executions each",
        targets.len()
    ))
}

/// Of libFuzzer's last line of figures, `#9 DONE cov: 455 ft: 1803 corp: 9/1Kb exec/s: 3`: the
/// executions, and edges, features, corpus and speed.
fn last_figures(text: &str) -> Option<(u64, &str)> {
    let line = pattern(r"(?m)^#(\d+)\s.*?(cov: .*)$");
    let last = line.captures_iter(text).last()?;
    Some((last[1].parse().ok()?, last.get(2)?.as_str()))
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn figures_are_read_from_the_last_line() {
        let text = "#2\tINITED cov: 11 ft: 12 corp: 1/1b\n\
                    #9\tDONE   cov: 455 ft: 1803 corp: 9/1Kb\nDone 9 runs in 1 second(s)\n";
        assert_eq!(
            last_figures(text),
            Some((9, "cov: 455 ft: 1803 corp: 9/1Kb"))
        );
        assert_eq!(last_figures("Done 5 runs"), None);
    }
}

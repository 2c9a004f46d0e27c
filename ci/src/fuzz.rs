//! The fuzz targets: finding or installing cargo-fuzz, building, running.

use xshell::Cmd;

use crate::error::{Context, Kind, Result, ensure, fail};
use crate::process::{self, captures};
use crate::workspace::Workspace;

/// `cargo fuzz` by nightly Rust.
fn cargo_fuzz<'s>(workspace: &'s Workspace, subcommand: &str) -> Result<Cmd<'s>> {
    let fuzz = workspace.cargo_of("nightly")?.args(["fuzz", subcommand]);
    let fuzz = fuzz.args(["--debug-assertions", "--target-dir"]);
    Ok(fuzz.arg(workspace.target.join("fuzz")))
}

/// Builds every target, after finding or installing nightly Rust and cargo-fuzz, and fuzzes one or all
/// from their committed corpora; what they learn stays in `target/fuzz/corpus`, what breaks one in
/// `fuzz/artifacts`. An error names every target that broke. Each gets so many `seconds` and ever new
/// inputs; for a gate, which must not fail by chance on a change that did nothing, without `seconds`,
/// the same inputs every time.
pub fn run(workspace: &Workspace, only: Option<&str>, seconds: Option<u32>) -> Result<String> {
    let sh = &workspace.sh;
    workspace.require_tool("fuzz@0.13.1")?;
    let files = workspace.files("fuzz/fuzz_targets")?;
    let names = files.iter().filter_map(|file| file.file_stem()?.to_str());
    let chosen = |name: &&str| only.is_none_or(|only| only == *name);
    let targets: Vec<_> = names.filter(chosen).collect();
    if targets.is_empty() {
        return fail(Kind::Usage, "no such file in fuzz/fuzz_targets");
    }
    cargo_fuzz(workspace, "build")?.run()?;
    let (folder, limits) = match seconds {
        None => ("smoke", "-seed=1 -runs=500000 -max_total_time=30".into()),
        Some(seconds) => ("corpus", format!("-max_total_time={seconds}")),
    };
    let (mut broken, mut least) = (Vec::new(), u64::MAX);
    for target in &targets {
        // New inputs go to the first folder; the committed seeds are only read.
        let learned = workspace.target.join("fuzz").join(folder).join(target);
        if seconds.is_none() {
            sh.remove_path(&learned)?;
        }
        sh.create_dir(&learned)?;
        let seeds = workspace.root.join("fuzz/corpus").join(target);
        let fuzz = cargo_fuzz(workspace, "run")?.arg(target).arg(learned);
        let fuzz = fuzz.arg(seeds).arg("--").args(limits.split(' '));
        let (success, text) = process::tee(fuzz)?;
        least = least.min(executions(&text).context("the fuzzer printed no figures")?);
        if !success {
            broken.push(*target);
        }
    }
    let broken = broken.join(", ");
    ensure!(broken.is_empty(), "inputs in fuzz/artifacts break {broken}");
    let count = targets.len();
    Ok(format!("{count} targets, at least {least} executions each"))
}

/// The executions in libFuzzer's last line of figures, `#9 DONE cov: 455 ft: 1803 corp: 9/1Kb exec/s: 3`.
fn executions(text: &str) -> Option<u64> {
    let lines = captures(text, r"(?m)^#(\d+)\s.*?cov: ");
    lines.last()?.parse().ok()
}

#[test]
fn executions_are_read_from_the_last_line() {
    let text = "#2\tINITED cov: 11 ft: 12\n#9\tDONE   cov: 455 ft: 1803\nDone 9 runs in 1 s\n";
    assert_eq!(executions(text), Some(9));
    assert_eq!(executions("Done 5 runs"), None);
}

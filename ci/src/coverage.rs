//! How much of `fw-core` its tests run, in regions: pieces of code that run as a whole
//! or not at all.

use std::collections::BTreeMap;
use std::process::Command;

use tinyjson::JsonValue;

use crate::error::{failed, Error, Result};
use crate::json;
use crate::numbers::Budget;
use crate::place::Place;
use crate::shell;
use crate::tool::Tool;

const CARGO_LLVM_COV: Tool = Tool {
    subcommand: "llvm-cov",
    version: "0.9.1",
};

/// What is measured, from the workspace's root.
const SOURCES: &str = "fw-core/src/";

/// Modules of tests and of what only tests use: their own code does not count.
const TESTS: [&str; 2] = ["::tests::", "::simulation::"];

/// From a line and a column to a line and a column.
type Span = [usize; 4];

/// How often a region ran, and in which function it stands.
struct Region {
    runs: usize,
    function: String,
}

/// The regions of one file.
type Regions = BTreeMap<Span, Region>;

/// Runs the tests, prints what they run of each file and what they do not.
///
/// # Errors
/// Where a test fails, cargo-llvm-cov or LLVM's tools are missing, or the figure is below its floor.
pub fn run(place: &Place) -> Result<()> {
    llvm_tools(place)?;
    let found = CARGO_LLVM_COV.find(place)?;
    let file = place.target.join("coverage.json");
    // Programs of an earlier state of the code would count as never run.
    let mut clean = CARGO_LLVM_COV.command(place, &found);
    shell::run(clean.args(["clean", "--workspace"]))?;
    let mut measure = CARGO_LLVM_COV.command(place, &found);
    measure.args(["--locked", "--json", "--output-path"]);
    measure.arg(&file);
    measure.args(["--package", "fw-core"]);
    measure.args(["--lib", "--tests"]);
    shell::run(&mut measure)?;
    let report = json::parse(&place.read(&file.to_string_lossy())?, "cargo llvm-cov")?;
    let files = files(&report);
    let (covered, all) = print(&files);
    if all == 0 {
        return failed("cargo llvm-cov saw nothing of fw-core");
    }
    #[expect(clippy::cast_precision_loss, reason = "some thousands")]
    let percent = covered as f64 * 100.0 / all as f64;
    println!("\n{covered} of {all} regions, {percent:.2} %");
    let budget = Budget::parse(&place.read("ci/budget.toml")?)?;
    let mut floors = budget.section("coverage.at_least");
    match floors.find(|(key, _)| *key == "regions_percent") {
        None => failed("ci/budget.toml has no coverage.at_least.regions_percent"),
        Some((_, floor)) if percent < floor => failed(format!(
            "{percent:.2} % of the regions are run, the floor of ci/budget.toml is {floor} %"
        )),
        Some(_) => Ok(()),
    }
}

/// Where rustup put LLVM's tools, or puts them now.
fn llvm_tools(place: &Place) -> Result<()> {
    let there = || {
        let hosts = std::fs::read_dir(place.sysroot.join("lib/rustlib"));
        let mut hosts = hosts.into_iter().flatten().flatten();
        hosts.any(|host| host.path().join("bin/llvm-profdata").is_file())
    };
    let mut add = Command::new("rustup");
    add.args(["component", "add", "llvm-tools"]);
    if there() || (shell::installed("rustup") && shell::run(&mut add).is_ok() && there()) {
        return Ok(());
    }
    Err(Error::Missing(
        "the compiler's LLVM tools are not installed (`rustup component add llvm-tools`)".into(),
    ))
}

/// The regions of every file of the core. A generic function is counted once, and ran if any of its
/// instances did.
fn files(report: &JsonValue) -> BTreeMap<String, Regions> {
    let mut files = BTreeMap::<String, Regions>::new();
    let functions = json::list(report, "data")
        .iter()
        .flat_map(|data| json::list(data, "functions"));
    for function in functions {
        let name = json::text(function, "name").unwrap_or_default();
        // With every instance's name come its crate's hash and its generic arguments.
        let name = format!("{:#}", rustc_demangle::demangle(name));
        if TESTS.iter().any(|module| name.contains(module)) {
            continue;
        }
        let names = json::list(function, "filenames");
        for region in json::list(function, "regions") {
            let numbers: Vec<usize> = json::entries(region).iter().map(json::count).collect();
            // The last number is the kind: 0 is code.
            let [a, b, c, d, runs, file, _, 0] = numbers[..] else {
                continue;
            };
            let file = names.get(file).and_then(|file| file.get::<String>());
            let Some((_, file)) = file.and_then(|file| file.split_once(SOURCES)) else {
                continue;
            };
            let regions = files.entry(file.to_owned()).or_default();
            let region = regions.entry([a, b, c, d]).or_insert_with(|| Region {
                runs: 0,
                function: name.clone(),
            });
            region.runs = region.runs.max(runs);
        }
    }
    files
}

/// Prints the table and the lines that never ran; how many regions ran, of how many.
fn print(files: &BTreeMap<String, Regions>) -> (usize, usize) {
    let mut sum = (0, 0);
    println!("\n{:>9} {:>9}  file", "covered", "regions");
    for (file, regions) in files {
        let covered = regions.values().filter(|region| region.runs > 0).count();
        println!("{covered:>9} {:>9}  {file}", regions.len());
        sum = (sum.0 + covered, sum.1 + regions.len());
    }
    println!("\nnever run:");
    for (file, regions) in files {
        for (function, lines) in never_run(regions) {
            println!("  {file}:{lines}  {function}");
        }
    }
    sum
}

/// The lines that never ran, by function in the order they stand there.
fn never_run(regions: &Regions) -> Vec<(&str, String)> {
    let mut by_function: Vec<(&str, String)> = Vec::new();
    for ([from, _, to, _], region) in regions.iter().filter(|(_, region)| region.runs == 0) {
        let lines = if from == to {
            from.to_string()
        } else {
            format!("{from}-{to}")
        };
        match by_function.last_mut() {
            Some((function, text)) if *function == region.function => {
                if !text.ends_with(&lines) {
                    *text += ",";
                    *text += &lines;
                }
            }
            _ => by_function.push((&region.function, lines)),
        }
    }
    by_function
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn instances_are_one_and_tests_do_not_count() {
        let report = r#"{"data": [{"functions": [
            {"name": "fw_core::log::f::<1>", "filenames": ["/robot/fw-core/src/log.rs"],
             "regions": [[1, 1, 3, 2, 0, 0, 0, 0], [2, 5, 2, 9, 0, 0, 0, 0]]},
            {"name": "fw_core::log::f::<2>", "filenames": ["/robot/fw-core/src/log.rs"],
             "regions": [[1, 1, 3, 2, 7, 0, 0, 0], [2, 5, 2, 9, 0, 0, 0, 0], [2, 9, 2, 9, 0, 0, 0, 3]]},
            {"name": "fw_core::log::tests::f", "filenames": ["/robot/fw-core/src/log.rs"],
             "regions": [[9, 1, 9, 2, 1, 0, 0, 0]]},
            {"name": "proofs::f", "filenames": ["/robot/proofs/src/log.rs"],
             "regions": [[9, 1, 9, 2, 1, 0, 0, 0]]}]}]}"#;
        let files = files(&json::parse(report, "").unwrap());
        assert_eq!(files.len(), 1);
        let regions = &files["log.rs"];
        assert_eq!(regions.len(), 2);
        assert_eq!(print(&files), (1, 2));
        assert_eq!(
            never_run(regions),
            [("fw_core::log::f::<1>", "2".to_owned())]
        );
    }
}

//! Gates that run tests: beside the code, and with the firmware in the loop.

use std::path::{Path, PathBuf};
use std::process::Command;

use super::firmware::check_stack_use;
use super::Outcome::{self, Passed};
use crate::budget::{Budget, Report};
use crate::error::{bail, ensure, Result};
use crate::process;
use crate::programs;
use crate::session::Session;

pub fn unit(session: &Session) -> Result<Outcome> {
    run(session.workspace.cargo("test --no-fail-fast"))
}

pub fn in_the_loop(session: &Session) -> Result<Outcome> {
    let words = "test --release --package twin --package robot-tests";
    let mut command = session.workspace.cargo_with_board(words)?;
    command.env("ROBOT_ELF", &session.image()?.path);
    for name in ["panic", "overflow"] {
        let image = session.build(&format!("test-{name}"))?;
        command.env(format!("ROBOT_ELF_{}", name.to_uppercase()), image.path);
    }
    run(command)
}

pub fn demo(session: &Session) -> Result<Outcome> {
    const FILES: [&str; 6] = [
        "map.png",
        "map.pgm",
        "map.yaml",
        "trajectory.png",
        "uart.log",
        "report.md",
    ];
    let out = session.workspace.target.join("demo");
    let ran = programs::demo(&session.workspace, &session.image()?.path, &[]);
    let missing: Vec<_> = FILES
        .into_iter()
        .filter(|file| !out.join(file).is_file())
        .collect();
    ensure!(
        ran.is_err() || missing.is_empty(),
        "the demo left no {}",
        missing.join(", ")
    );
    let (bars, report) = check_report(session, "demo", &out.join("report.json"), ran)?;
    check_stack_use(session, &report)?;
    let figure = |key| report.figure(key).unwrap_or(f64::NAN);
    Ok(Passed(format!(
        "{bars} bars; position {:.1} mm, heading {:.2}°, map {:.2}, {:.1} × real time",
        figure("position_error_mm_max"),
        figure("heading_error_deg_max"),
        figure("map_iou"),
        figure("realtime_factor"),
    )))
}

pub fn figures(session: &Session) -> Result<Outcome> {
    let out = session.workspace.target.join("figures.json");
    let elf = &session.image()?.path;
    let ran = programs::figures(&session.workspace, session.toolchain()?, elf, &[]);
    let (bars, report) = check_report(session, "figures", &out, ran)?;
    let (used, worst) = check_stack_use(session, &report)?;
    let figure = |key| report.figure(key).unwrap_or(f64::NAN);
    Ok(Passed(format!(
        "{bars} bars; tick {:.0}, frame {:.0} instructions at most, {:.0} frames/s, ready in \
         {:.1} ms, stack {used:.0} of {worst}",
        figure("tick_instructions.max"),
        figure("frame_instructions.max"),
        figure("frames_per_s_sustained"),
        figure("boot_to_ready_us") / 1000.0,
    )))
}

/// The report of a run against its bars. A run that failed may still have left the figures that say
/// why; the run's own failure counts in any case.
fn check_report(
    session: &Session,
    name: &str,
    file: &Path,
    ran: Result<PathBuf>,
) -> Result<(usize, Report)> {
    if !file.is_file() {
        ran?;
        bail!("no {}", session.workspace.relative(file));
    }
    let report = Report::parse(&session.workspace.read(file)?)?;
    let bars = Budget::read(&session.workspace)?.check(name, &report)?;
    ran.map(|_| (bars, report))
}

/// Runs tests; passed with their number. A run without a test has tested nothing.
fn run(tests: Command) -> Result<Outcome> {
    let shown = process::display(&tests);
    let (status, text) = process::tee(tests, |_| true)?;
    let failed: Vec<_> = failures(&text).collect();
    ensure!(
        failed.is_empty(),
        "{} failed: {}",
        failed.len(),
        failed.join(", ")
    );
    ensure!(status.success(), "`{shown}` ended with {status}");
    match (count(&text, " passed"), count(&text, " ignored")) {
        (0, _) => bail!("no test ran"),
        (tests, 0) => Ok(Passed(format!("{tests} tests"))),
        (tests, ignored) => Ok(Passed(format!("{tests} tests, {ignored} ignored"))),
    }
}

/// The names of the tests that failed, in the order they ran.
fn failures(text: &str) -> impl Iterator<Item = &str> {
    let lines = text.lines().filter_map(|line| line.strip_prefix("test "));
    lines.filter_map(|line| line.strip_suffix(" ... FAILED"))
}

/// The sum of one number over all of cargo's closing lines: `test result: ok. 12 passed; 0 failed; …`.
fn count(text: &str, what: &str) -> u32 {
    let closing = text
        .lines()
        .filter(|line| line.starts_with("test result: "));
    let parts = closing.flat_map(|line| line.split([';', '.']));
    let numbers = parts.filter_map(|part| part.strip_suffix(what)?.trim().parse::<u32>().ok());
    numbers.sum()
}

#[cfg(test)]
mod unit_tests {
    use super::*;

    #[test]
    fn tests_of_all_binaries_are_counted_and_failures_named() {
        let text = "\
test a::b ... ok
test a::c ... FAILED
test result: FAILED. 12 passed; 1 failed; 1 ignored; 0 measured; 0 filtered out; finished in 0.00s
noise
test result: ok. 3 passed; 0 failed; 0 ignored; 0 measured; 0 filtered out; finished in 1.20s
";
        assert_eq!((count(text, " passed"), count(text, " ignored")), (15, 1));
        assert_eq!(failures(text).collect::<Vec<_>>(), ["a::c"]);
    }
}

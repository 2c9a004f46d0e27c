//! Gates that run tests: beside the code, and with the firmware in the loop.

use std::path::{Path, PathBuf};
use std::process::Command;

use super::{passed, stack, Context, Verdict};
use crate::error::{failed, Result};
use crate::numbers::Report;
use crate::robot::{self, cargo_with_board};
use crate::shell;

pub fn unit(context: &mut Context) -> Result<Verdict> {
    run(context.place.cargo().args(["test", "--no-fail-fast"]))
}

pub fn in_the_loop(context: &mut Context) -> Result<Verdict> {
    let panic = context.built_with("test-panic")?.path;
    let overflow = context.built_with("test-overflow")?.path;
    let elf = context.image()?.path.clone();
    let packages = [
        "test",
        "--release",
        "--package",
        "twin",
        "--package",
        "robot-tests",
    ];
    let mut command = cargo_with_board(&context.place, &packages)?;
    command
        .env("ROBOT_ELF", elf)
        .env("ROBOT_ELF_PANIC", panic)
        .env("ROBOT_ELF_OVERFLOW", overflow);
    run(&mut command)
}

pub fn demo(context: &mut Context) -> Result<Verdict> {
    let elf = context.image()?.path.clone();
    let out = context.place.target.join(robot::DEMO);
    let ran = robot::demo(&context.place, &elf, &[]);
    let files = [
        "map.png",
        "map.pgm",
        "map.yaml",
        "trajectory.png",
        "uart.log",
        "report.md",
    ];
    let missing: Vec<_> = files
        .into_iter()
        .filter(|file| !out.join(file).is_file())
        .collect();
    if ran.is_ok() && !missing.is_empty() {
        return failed(format!("the demo left no {}", missing.join(", ")));
    }
    let (bars, report) = held(context, robot::DEMO, &out.join(robot::REPORT), ran)?;
    stack::holds(context, &report)?;
    let figure = |key| report.figure(key).unwrap_or(f64::NAN);
    passed(format!(
        "{bars} bars; position {:.1} mm, heading {:.2}°, map {:.2}, {:.1} × real time",
        figure("position_error_mm_max"),
        figure("heading_error_deg_max"),
        figure("map_iou"),
        figure("realtime_factor"),
    ))
}

pub fn figures(context: &mut Context) -> Result<Verdict> {
    let elf = context.image()?.path.clone();
    let out = context.place.target.join(robot::FIGURES);
    let hand = context.built_with(robot::HAND)?.path;
    let ran = robot::figures(&context.place, &elf, &hand, &[]);
    let (bars, report) = held(context, "figures", &out, ran)?;
    let (used, worst) = stack::holds(context, &report)?;
    let figure = |key| report.figure(key).unwrap_or(f64::NAN);
    passed(format!(
        "{bars} bars; tick {:.0}, frame {:.0} instructions at most, {:.0} frames/s, ready in {:.1} ms, stack {used:.0} of {worst}",
        figure("tick_instructions.max"),
        figure("frame_instructions.max"),
        figure("frames_per_s_sustained"),
        figure("boot_to_ready_us") / 1000.0,
    ))
}

/// The report of a run, held against its bars. A run that failed may still have left the figures
/// that say why; the run's own failure counts in any case.
fn held(
    context: &Context,
    name: &str,
    file: &Path,
    ran: Result<PathBuf>,
) -> Result<(usize, Report)> {
    if !file.is_file() {
        return ran.and_then(|_| failed(format!("no {}", context.place.short(file))));
    }
    let report = Report::parse(&context.read(file)?)?;
    let bars = context.budget()?.hold(name, &report)?;
    ran.map(|_| (bars, report))
}

fn run(tests: &mut Command) -> Result<Verdict> {
    let (status, text) = shell::tee_any_end(tests)?;
    let broken: Vec<_> = failures(&text).collect();
    match (status.success(), broken.is_empty()) {
        (true, true) => counted(&text),
        (_, false) => failed(format!("{} failed: {}", broken.len(), broken.join(", "))),
        (false, true) => failed(format!("`{}` ended with {status}", shell::shown(tests))),
    }
}

/// The names of the tests that failed, in the order they ran.
fn failures(text: &str) -> impl Iterator<Item = &str> {
    let lines = text.lines().filter_map(|line| line.strip_prefix("test "));
    lines.filter_map(|line| line.strip_suffix(" ... FAILED"))
}

/// Passed with the number of tests; a run without a test has tested nothing.
fn counted(text: &str) -> Result<Verdict> {
    let (tests, ignored) = count(text);
    match (tests, ignored) {
        (0, _) => failed("no test ran"),
        (_, 0) => passed(format!("{tests} tests")),
        (_, _) => passed(format!("{tests} tests, {ignored} ignored")),
    }
}

/// The tests that passed and that were ignored, over all of cargo's closing lines.
fn count(text: &str) -> (u32, u32) {
    let mut sum = (0, 0);
    for line in text
        .lines()
        .filter(|line| line.starts_with("test result: "))
    {
        let number = |what: &str| {
            let part = line.split([';', '.']).find(|part| part.ends_with(what));
            part.and_then(|part| part.trim().split(' ').next()?.parse::<u32>().ok())
                .unwrap_or(0)
        };
        sum.0 += number(" passed");
        sum.1 += number(" ignored");
    }
    sum
}

#[cfg(test)]
mod unit_tests {
    use super::*;

    #[test]
    fn the_closing_lines_of_all_binaries_are_summed() {
        let text = "\
test result: ok. 12 passed; 0 failed; 1 ignored; 0 measured; 0 filtered out; finished in 0.00s
noise
test result: ok. 3 passed; 0 failed; 0 ignored; 0 measured; 0 filtered out; finished in 1.20s
";
        assert_eq!(count(text), (15, 1));
        assert!(counted("").is_err());
    }

    #[test]
    fn the_tests_that_failed_are_named() {
        let text = "test a::b ... ok\ntest a::c ... FAILED\nFAILED\n";
        assert_eq!(failures(text).collect::<Vec<_>>(), ["a::c"]);
    }
}

//! Running other programs, beyond what xshell does.

use std::io::{BufRead, BufReader};
use std::process::{Command, Stdio};
use std::time::UNIX_EPOCH;

use regex_lite::Regex;
use xshell::Cmd;

use crate::error::{Kind, Result, fail};

/// The day, for what differs from one to the next.
pub fn days() -> Result<u64> {
    Ok(UNIX_EPOCH.elapsed()?.as_secs() / 86_400)
}

/// What a command prints, run silently; `None` where it cannot be started or does not end with 0.
pub fn output(command: Cmd<'_>) -> Option<String> {
    command.quiet().ignore_stderr().read().ok()
}

/// Requires what `installed` looks for; runs `install` once where it is missing.
pub fn require(installed: impl Fn() -> bool, install: &Cmd<'_>, what: &str) -> Result<()> {
    if installed() || (install.run().is_ok() && installed()) {
        return Ok(());
    }
    let missing = format!("{what} is missing and `{install}` failed");
    fail(Kind::MissingProgram, missing)
}

/// Runs with its output and errors printed; whether it ended with 0, and all lines.
pub fn tee(command: impl Into<Command>) -> Result<(bool, String)> {
    tee_lines(command, |_| true)
}

/// [`tee`], printing the lines that `printed` accepts.
pub fn tee_lines(command: impl Into<Command>, printed: fn(&str) -> bool) -> Result<(bool, String)> {
    let mut command = command.into();
    eprintln!("$ {command:?}");
    let (reader, writer) = std::io::pipe()?;
    command.stdin(Stdio::null());
    command.stdout(writer.try_clone()?).stderr(writer);
    let mut child = command.spawn()?;
    // Its ends of the pipe: with them open here, reading never ends.
    drop(command);
    let mut text = String::new();
    for line in BufReader::new(reader).split(b'\n') {
        let line = String::from_utf8_lossy(&line?).into_owned();
        if printed(&line) {
            println!("{line}");
        }
        text = text + &line + "\n";
    }
    Ok((child.wait()?.success(), text))
}

/// How many tests of all binaries passed, and the names of those that failed.
pub fn test_results(text: &str) -> (u32, Vec<&str>) {
    let passed = captures(text, r"(?m)^test result: .*? (\d+) passed");
    let passed = passed.iter().map(|count| count.parse().unwrap_or(0));
    let failed = captures(text, r"(?m)^test (.*) \.\.\. FAILED$");
    (passed.sum(), failed)
}

/// What the first group of a pattern matches, each time.
pub fn captures<'t>(text: &'t str, of: &str) -> Vec<&'t str> {
    let of = pattern(of);
    let found = of.captures_iter(text).filter_map(|found| found.get(1));
    found.map(|group| group.as_str()).collect()
}

/// A pattern of this program's own.
pub fn pattern(text: &str) -> Regex {
    Regex::new(text).expect("a pattern that a test runs")
}

#[test]
fn tests_are_counted_and_failures_named() {
    let text = "test a::b ... ok\ntest a::c ... FAILED\ntest d ... FAILED\n\
                test result: FAILED. 12 passed; 1 failed; 1 ignored; 0 measured\nnoise\n\
                test result: ok. 3 passed; 0 failed; 0 ignored; finished in 1.20s\n";
    assert_eq!(test_results(text), (15, vec!["a::c", "d"]));
}

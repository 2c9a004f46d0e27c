//! Running other programs: printed before they run, named when they fail.

use std::io::{BufRead, BufReader, Read, Write};
use std::process::{Child, Command, ExitStatus, Stdio};
use std::thread;
use std::time::{Duration, Instant};

use crate::error::{anyhow, bail, ensure, Context, Error, Failure, Result};

/// The command as one could type it, without its environment.
pub fn display(command: &Command) -> String {
    let words = std::iter::once(command.get_program()).chain(command.get_args());
    let quoted = words.map(|word| match word.to_string_lossy() {
        word if word.is_empty() || word.contains([' ', '"', '\'', '$', ';']) => format!("'{word}'"),
        word => word.into_owned(),
    });
    quoted.collect::<Vec<_>>().join(" ")
}

fn spawn(command: &mut Command) -> Result<Child> {
    println!("  $ {}", display(command));
    let _ = std::io::stdout().flush();
    command.spawn().map_err(|error| {
        let program = command.get_program().to_string_lossy();
        if error.kind() == std::io::ErrorKind::NotFound {
            Error::new(Failure::MissingProgram(format!(
                "{program} is not installed"
            )))
        } else {
            anyhow!("{program} cannot be started: {error}")
        }
    })
}

/// Runs with this terminal's input and output; an error where it does not end with 0.
pub fn run(command: impl Into<Command>) -> Result<()> {
    let mut command = command.into();
    let status = spawn(&mut command)?.wait()?;
    ensure!(
        status.success(),
        "`{}` ended with {status}",
        display(&command)
    );
    Ok(())
}

/// Runs silently; the output, trimmed, or `None` where it cannot be started or does not end with 0.
pub fn output(command: impl Into<Command>) -> Option<String> {
    let mut command = command.into();
    let output = command
        .stdin(Stdio::null())
        .stderr(Stdio::null())
        .output()
        .ok()?;
    let text = || String::from_utf8_lossy(&output.stdout).trim().to_owned();
    output.status.success().then(text)
}

/// Runs with its output shown as far as `shown` takes the line; returns how it ended and all of its
/// standard output and error.
pub fn tee(command: impl Into<Command>, shown: fn(&str) -> bool) -> Result<(ExitStatus, String)> {
    let mut command = command.into();
    command
        .stdin(Stdio::null())
        .stdout(Stdio::piped())
        .stderr(Stdio::piped());
    let mut child = spawn(&mut command)?;
    let errors = child.stderr.take().context("no standard error")?;
    let errors = thread::spawn(move || relay(errors, |line| eprintln!("{line}")));
    let print = |line: &str| {
        if shown(line) {
            println!("{line}");
        }
    };
    let mut text = relay(child.stdout.take().context("no standard output")?, print);
    let status = child.wait()?;
    text += &errors.join().unwrap_or_default();
    Ok((status, text))
}

fn relay(pipe: impl Read, print: impl Fn(&str)) -> String {
    let mut text = String::new();
    for line in BufReader::new(pipe)
        .split(b'\n')
        .map_while(std::io::Result::ok)
    {
        let line = String::from_utf8_lossy(&line);
        print(&line);
        text += &line;
        text.push('\n');
    }
    text
}

/// Runs without output for at most `limit`; an error says what the program printed last.
pub fn run_within(limit: Duration, command: impl Into<Command>) -> Result<()> {
    let mut command = command.into();
    command
        .stdin(Stdio::null())
        .stdout(Stdio::null())
        .stderr(Stdio::piped());
    let mut child = spawn(&mut command)?;
    let errors = child.stderr.take().context("no standard error")?;
    let errors = thread::spawn(move || relay(errors, |_| {}));
    let end = Instant::now() + limit;
    let status = loop {
        if let Some(status) = child.try_wait()? {
            break status;
        }
        if Instant::now() > end {
            let _ = child.kill().and_then(|()| child.wait());
            bail!(
                "`{}` took longer than {} s",
                display(&command),
                limit.as_secs()
            );
        }
        thread::sleep(Duration::from_millis(50));
    };
    let errors = errors.join().unwrap_or_default();
    let last = errors
        .lines()
        .rfind(|line| !line.trim().is_empty())
        .unwrap_or_default();
    ensure!(
        status.success(),
        "`{}` ended with {status}: {}",
        display(&command),
        last.trim()
    );
    Ok(())
}

/// Whether a program of that name is in the search path.
pub fn installed(program: &str) -> bool {
    let path = std::env::var_os("PATH").unwrap_or_default();
    std::env::split_paths(&path).any(|folder| folder.join(program).is_file())
}

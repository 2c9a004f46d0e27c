//! Running other programs: shown before they run, named when they fail.

use std::io::{BufRead, BufReader, Write};
use std::path::Path;
use std::process::{Child, Command, ExitStatus, Stdio};
use std::thread;
use std::time::{Duration, Instant};

use crate::compat::{failed, Of};
use crate::error::{Error, Failure, Result};

/// The command as one could type it, without its environment.
pub fn shown(command: &Command) -> String {
    let words = std::iter::once(command.get_program()).chain(command.get_args());
    let words = words.map(|word| {
        let word = word.to_string_lossy();
        if word.is_empty() || word.contains([' ', '"', '\'', '$', ';']) {
            format!("'{word}'")
        } else {
            word.into_owned()
        }
    });
    words.collect::<Vec<_>>().join(" ")
}

fn announce(command: &Command) {
    println!("  $ {}", shown(command));
    let _ = std::io::stdout().flush();
}

fn ended(command: &Command, status: ExitStatus) -> Result<()> {
    if status.success() {
        Ok(())
    } else {
        failed(format!("`{}` ended with {status}", shown(command)))
    }
}

fn cannot_start(command: &Command, error: &std::io::Error) -> Error {
    let program = command.get_program().to_string_lossy();
    if error.kind() == std::io::ErrorKind::NotFound {
        Error::new(Failure::MissingProgram(format!(
            "{program} is not installed"
        )))
    } else {
        crate::error::anyhow!("{program} cannot be started: {error}")
    }
}

/// Runs with this terminal's input and output.
///
/// # Errors
/// [`Error::Missing`] where the program is not installed, [`Error::Failed`] on another end than 0.
pub fn run(command: &mut Command) -> Result<()> {
    announce(command);
    let status = command
        .status()
        .map_err(|error| cannot_start(command, &error))?;
    ended(command, status)
}

/// Runs with the output shown and also handed back, however the program ended; both of the command's
/// outputs, for the verdict is often in the one and the figure in the other.
///
/// # Errors
/// Where the program cannot be started.
pub fn tee_any_end(command: &mut Command) -> Result<(ExitStatus, String)> {
    tee_some(command, |_| true)
}

/// The same with only those lines shown that are `telling`; all are handed back.
///
/// # Errors
/// Where the program cannot be started.
pub fn tee_some(command: &mut Command, telling: fn(&str) -> bool) -> Result<(ExitStatus, String)> {
    announce(command);
    let mut child = command
        .stdin(Stdio::null())
        .stdout(Stdio::piped())
        .stderr(Stdio::piped())
        .spawn()
        .map_err(|error| cannot_start(command, &error))?;
    let errors = child
        .stderr
        .take()
        .map(|pipe| thread::spawn(move || relay(pipe, false, telling)));
    let mut text = child
        .stdout
        .take()
        .map(|pipe| relay(pipe, true, telling))
        .unwrap_or_default();
    let status = child.wait().of(shown(command))?;
    if let Some(Ok(errors)) = errors.map(thread::JoinHandle::join) {
        text.push_str(&errors);
    }
    Ok((status, text))
}

fn relay(pipe: impl std::io::Read, to_output: bool, telling: fn(&str) -> bool) -> String {
    let mut text = String::new();
    for line in BufReader::new(pipe)
        .split(b'\n')
        .map_while(std::result::Result::ok)
    {
        let line = String::from_utf8_lossy(&line);
        match (telling(&line), to_output) {
            (true, true) => println!("{line}"),
            (true, false) => eprintln!("{line}"),
            (false, _) => {}
        }
        text.push_str(&line);
        text.push('\n');
    }
    text
}

/// Runs silently; the output, trimmed, or `None` where it cannot be started or does not end with 0.
pub fn ask(command: &mut Command) -> Option<String> {
    let output = command
        .stdin(Stdio::null())
        .stderr(Stdio::null())
        .output()
        .ok()?;
    output
        .status
        .success()
        .then(|| String::from_utf8_lossy(&output.stdout).trim().to_owned())
}

/// Runs silently for at most `limit`.
///
/// # Errors
/// What the program said last, or that it took too long.
pub fn run_within(command: &mut Command, limit: Duration) -> Result<()> {
    announce(command);
    let mut child = command
        .stdin(Stdio::null())
        .stdout(Stdio::null())
        .stderr(Stdio::piped())
        .spawn()
        .map_err(|error| cannot_start(command, &error))?;
    let said = child
        .stderr
        .take()
        .map(|pipe| thread::spawn(move || quietly(pipe)));
    let Some(status) = wait(&mut child, limit) else {
        end(&mut child);
        return failed(format!(
            "`{}` took longer than {} s",
            shown(command),
            limit.as_secs()
        ));
    };
    let said = said
        .and_then(|thread| thread.join().ok())
        .unwrap_or_default();
    if status.success() {
        return Ok(());
    }
    let last = said
        .lines()
        .rev()
        .map(str::trim)
        .find(|line| !line.is_empty())
        .unwrap_or("");
    failed(format!("`{}` ended with {status}: {last}", shown(command)))
}

fn quietly(mut pipe: impl std::io::Read) -> String {
    let mut text = Vec::new();
    let _ = pipe.read_to_end(&mut text);
    String::from_utf8_lossy(&text).into_owned()
}

/// The child's end, or `None` if it still runs after `limit`.
pub fn wait(child: &mut Child, limit: Duration) -> Option<ExitStatus> {
    let start = Instant::now();
    loop {
        if let Ok(Some(status)) = child.try_wait() {
            return Some(status);
        }
        if start.elapsed() > limit {
            return None;
        }
        thread::sleep(Duration::from_millis(50));
    }
}

/// The program, to be started with at most so many bytes of memory: what would take more ends instead
/// of taking the machine's.
pub fn within_memory(program: &Path, bytes: u64) -> Command {
    let mut command = Command::new("sh");
    // The limit counts KiB, and holds for all that is started from here.
    let script = format!("ulimit -v {} && exec \"$0\" \"$@\"", bytes / 1024);
    command.arg("-c").arg(script).arg(program);
    command
}

/// Ends a child that we started.
pub fn end(child: &mut Child) {
    let _ = child.kill();
    let _ = child.wait();
}

/// Whether a program of that name is in the PATH.
pub fn installed(program: &str) -> bool {
    std::env::var_os("PATH").is_some_and(|path| {
        std::env::split_paths(&path).any(|folder| folder.join(program).is_file())
    })
}

/// Copies `from` to `to`, making the folder of `to`.
///
/// # Errors
/// Names the file that could not be written.
pub fn copy(from: &Path, to: &Path) -> Result<()> {
    if let Some(folder) = to.parent() {
        std::fs::create_dir_all(folder).of(folder.display())?;
    }
    std::fs::copy(from, to).of(format_args!("{} to {}", from.display(), to.display()))?;
    Ok(())
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_program_gets_no_more_memory_than_it_may() {
        let mut limited = within_memory(Path::new("sh"), 1 << 30);
        limited.args(["-c", "ulimit -v; echo \"$1\"", "name", "a word"]);
        assert_eq!(ask(&mut limited).as_deref(), Some("1048576\na word"));
    }
}

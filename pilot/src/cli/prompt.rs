//! Questions at the terminal. Ctrl-C ends every one of them.

use super::output::Output;
use host_link::board_io::Interrupt;
use host_link::error::Error;
use std::io::{self, BufRead, IsTerminal};
use std::sync::mpsc::{RecvTimeoutError, channel};
use std::thread;
use std::time::Duration;

/// Polling period of the Ctrl-C flag.
const POLL: Duration = Duration::from_millis(50);

/// Asks yes or no, no being the default, also without a terminal.
///
/// # Errors
/// [`Error::Interrupted`].
pub fn confirm(question: &str, interrupt: &Interrupt, output: Output) -> Result<bool, Error> {
    if !io::stdin().is_terminal() {
        output.message(&format!(
            "{question} Cannot prompt: stdin is not a terminal; pass --yes."
        ));
        return Ok(false);
    }
    output.message(&format!("{question} [y/N]"));
    let answer = read_line(interrupt)?;
    Ok(matches!(answer.as_deref(), Some("y" | "Y" | "yes")))
}

/// Asks before the wheels move, unless `yes`.
///
/// # Errors
/// [`Error::Interrupted`]; [`Error::Usage`] without consent.
// Requirement: WIRE-program-3
pub fn confirm_drive(
    yes: bool,
    what: &str,
    interrupt: &Interrupt,
    output: Output,
) -> Result<(), Error> {
    let question = format!("{what} Keep hands off the wheels, Ctrl-C stops it. Drive?");
    if yes || confirm(&question, interrupt, output)? {
        return Ok(());
    }
    Err(Error::Usage("not driven: not confirmed".into()))
}

/// Asks until `parse` accepts the answer.
///
/// # Errors
/// [`Error::Interrupted`]; [`Error::Usage`] at the end of the input.
pub fn ask<T>(
    question: &str,
    interrupt: &Interrupt,
    output: Output,
    parse: impl Fn(&str) -> Result<T, String>,
) -> Result<T, Error> {
    loop {
        output.message(question);
        let Some(answer) = read_line(interrupt)? else {
            let why = "standard input ended before the measurement";
            return Err(Error::Usage(why.into()));
        };
        match parse(&answer) {
            Ok(value) => return Ok(value),
            Err(why) => output.message(&why),
        }
    }
}

/// A trimmed line of the standard input; none at its end. A thread reads it, so that Ctrl-C is seen.
fn read_line(interrupt: &Interrupt) -> Result<Option<String>, Error> {
    let (sender, receiver) = channel();
    thread::spawn(move || {
        let mut line = String::new();
        let read = io::stdin().lock().read_line(&mut line);
        let answer = matches!(read, Ok(bytes) if bytes > 0).then(|| line.trim().to_owned());
        // After Ctrl-C the receiver is gone.
        let _ = sender.send(answer);
    });
    loop {
        interrupt.check()?;
        match receiver.recv_timeout(POLL) {
            Ok(answer) => return Ok(answer),
            Err(RecvTimeoutError::Timeout) => {}
            Err(RecvTimeoutError::Disconnected) => return Ok(None),
        }
    }
}

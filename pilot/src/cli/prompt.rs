//! Questions to the person at the terminal. Ctrl-C answers every one of them.

use super::output::Output;
use host_link::board_io::Interrupt;
use host_link::error::Error;
use std::io::{self, BufRead, IsTerminal};
use std::sync::mpsc::{channel, RecvTimeoutError};
use std::thread;
use std::time::Duration;

/// How often Ctrl-C is looked for while nobody answers.
const LOOK: Duration = Duration::from_millis(50);

/// Asks yes or no, no being the default; without a terminal nobody can agree.
///
/// # Errors
/// [`Error::Interrupted`].
pub fn whether(question: &str, interrupt: &Interrupt, output: Output) -> Result<bool, Error> {
    if !io::stdin().is_terminal() {
        output.remark(&format!(
            "{question} Nobody can be asked, standard input is no terminal; give --yes to agree beforehand"
        ));
        return Ok(false);
    }
    output.remark(&format!("{question} [y/N]"));
    let answer = line(interrupt)?;
    Ok(matches!(answer.as_deref(), Some("y" | "Y" | "yes")))
}

/// Asks until the answer can be read, or none comes any more.
///
/// # Errors
/// [`Error::Interrupted`]; [`Error::Usage`] at the end of the input.
pub fn until<T>(
    question: &str,
    interrupt: &Interrupt,
    output: Output,
    read: impl Fn(&str) -> Result<T, String>,
) -> Result<T, Error> {
    loop {
        output.remark(question);
        let Some(answer) = line(interrupt)? else {
            return Err(Error::Usage("no answer came".into()));
        };
        match read(&answer) {
            Ok(value) => return Ok(value),
            Err(why) => output.remark(&why),
        }
    }
}

/// A line of the standard input without its blanks; none at its end. Read aside, so that Ctrl-C is seen.
fn line(interrupt: &Interrupt) -> Result<Option<String>, Error> {
    let (sender, receiver) = channel();
    thread::spawn(move || {
        let mut line = String::new();
        let read = io::stdin().lock().read_line(&mut line);
        let answer = matches!(read, Ok(bytes) if bytes > 0).then(|| line.trim().to_owned());
        // Nobody listens any more after Ctrl-C, and then nobody need.
        let _ = sender.send(answer);
    });
    loop {
        interrupt.check()?;
        match receiver.recv_timeout(LOOK) {
            Ok(answer) => return Ok(answer),
            Err(RecvTimeoutError::Timeout) => {}
            Err(RecvTimeoutError::Disconnected) => return Ok(None),
        }
    }
}

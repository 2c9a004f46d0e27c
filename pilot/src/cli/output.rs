//! Results on standard output, as a sentence or as JSON; progress and errors on standard error.

use host_link::eeprom::Progress;
use host_link::error::Error;
use rustix::event::{PollFd, PollFlags, Timespec, poll};
use rustix::termios::tcgetwinsize;
use serde::Serialize;
use std::io::{self, ErrorKind, IsTerminal, Write};

/// The format of the output.
#[derive(Clone, Copy, Debug)]
pub struct Output {
    json: bool,
    terminal: bool,
}

impl Output {
    pub fn new(json: bool) -> Self {
        Self {
            json,
            terminal: io::stderr().is_terminal(),
        }
    }

    /// A result: the sentence, or the value as one line of JSON.
    ///
    /// # Errors
    /// [`Error::PipeClosed`]; [`Error::Unwritable`] for standard output.
    pub fn result(
        self,
        value: &impl Serialize,
        sentence: impl FnOnce() -> String,
    ) -> Result<(), Error> {
        if self.json {
            Self::line(&serde_json::to_string(value).unwrap_or_default())
        } else {
            Self::line(&printable(sentence().trim_end()))
        }
    }

    /// A line on standard output.
    // Requirement: WIRE-program-2
    pub fn line(text: &str) -> Result<(), Error> {
        let mut stdout = io::stdout().lock();
        let written = writeln!(stdout, "{text}").and_then(|()| stdout.flush());
        written.map_err(|cause| match cause.kind() {
            ErrorKind::BrokenPipe => Error::PipeClosed,
            _ => Error::unwritable("standard output", &cause),
        })
    }

    /// Whether standard output is still read: for what may print nothing for long.
    ///
    /// # Errors
    /// [`Error::PipeClosed`].
    pub fn check_reader() -> Result<(), Error> {
        let stdout = io::stdout();
        let mut ends = [PollFd::new(&stdout, PollFlags::empty())];
        let closed = PollFlags::ERR | PollFlags::HUP;
        match poll(&mut ends, Some(&Timespec::default())) {
            Ok(_) if ends[0].revents().intersects(closed) => Err(Error::PipeClosed),
            _ => Ok(()),
        }
    }

    /// A message that is not the result.
    #[allow(clippy::unused_self)] // all output goes through `Output`
    pub fn message(self, text: &str) {
        let _ = writeln!(io::stderr().lock(), "{}", printable(text));
    }

    /// A message with the program's name.
    pub fn warn(self, text: &str) {
        self.message(&format!("robot: {text}"));
    }

    /// A line that the next one overwrites, on a terminal only: as much of it as fits into a row.
    pub fn live(self, text: &str) {
        if self.is_live() {
            let mut stderr = io::stderr().lock();
            let columns = tcgetwinsize(&stderr).map_or(0, |size| size.ws_col.into());
            let end = text.char_indices().nth(columns.max(2) - 1);
            let text = end.map_or(text, |(end, _)| &text[..end]);
            let _ = write!(stderr, "\r\x1b[K{text}").and_then(|()| stderr.flush());
        }
    }

    /// Keeps the overwritten line.
    pub fn end_live(self) {
        if self.is_live() {
            let _ = writeln!(io::stderr().lock());
        }
    }

    /// Shows how far an EEPROM write is.
    pub fn progress(self, step: Progress<'_>) {
        if let Progress::Written { done, of } = step {
            self.live(&format!("{done} of {of} bytes"));
        }
    }

    /// An outcome and that of what came after it: the first error ends the program, a second is shown.
    pub fn both<T>(self, outcome: Result<T, Error>, after: Result<(), Error>) -> Result<T, Error> {
        if let (Err(_), Err(second)) = (&outcome, &after) {
            self.warn(&second.to_string());
        }
        outcome.and_then(|done| after.map(|()| done))
    }

    /// Whether lines are overwritten.
    pub fn is_live(self) -> bool {
        self.terminal && !self.json
    }

    /// Whether a person sits at a terminal that can show a screen.
    pub fn is_screen(self) -> bool {
        !self.json && io::stdout().is_terminal() && io::stdin().is_terminal()
    }

    /// Whether results are JSON.
    pub fn is_json(self) -> bool {
        self.json
    }

    /// The error that ends the program.
    pub fn error(self, error: &Error) {
        self.warn(&error.to_string());
        if self.json {
            let exit = error.exit().code();
            let object = serde_json::json!({ "error": error.to_string(), "exit": exit });
            // The exit code says it, too.
            let _ = Self::line(&object.to_string());
        }
    }
}

/// The text without what would control the terminal, which the STM's log and names of files may hold.
fn printable(text: &str) -> String {
    let shown = |char: char| match char {
        '\n' | '\t' => char.into(),
        _ if char.is_control() => char.escape_default().to_string(),
        _ => String::from(char),
    };
    text.chars().map(shown).collect()
}

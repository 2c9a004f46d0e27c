//! What the program says: sentences for people, JSON for scripts. Results go to standard output,
//! progress and errors to standard error.

use host_link::error::Error;
use serde::Serialize;
use std::io::{self, IsTerminal, Write};

/// How to speak.
#[derive(Clone, Copy, Debug)]
pub struct Output {
    json: bool,
    live: bool,
}

impl Output {
    pub fn new(json: bool) -> Self {
        Self {
            json,
            live: io::stderr().is_terminal(),
        }
    }

    /// A result: the sentence, or the value as one line of JSON.
    pub fn result(self, value: &impl Serialize, sentence: impl FnOnce() -> String) {
        if self.json {
            Self::line(&serde_json::to_string(value).unwrap_or_default());
        } else {
            Self::line(sentence().trim_end());
        }
    }

    /// A line on standard output. A reader that went away is not this program's problem.
    fn line(text: &str) {
        let _ = writeln!(io::stdout().lock(), "{text}");
    }

    /// A remark that is not the result.
    #[allow(clippy::unused_self)] // how it is said may come to depend on `self`
    pub fn remark(self, text: &str) {
        let _ = writeln!(io::stderr().lock(), "{text}");
    }

    /// A line that the next one overwrites, on a terminal only.
    pub fn live(self, text: &str) {
        if self.live && !self.json {
            let mut stderr = io::stderr().lock();
            let _ = write!(stderr, "\r\x1b[K{text}").and_then(|()| stderr.flush());
        }
    }

    /// Ends the overwritten line.
    pub fn end_live(self) {
        if self.live && !self.json {
            let _ = writeln!(io::stderr().lock());
        }
    }

    /// Whether lines are overwritten.
    pub fn is_live(self) -> bool {
        self.live && !self.json
    }

    /// Whether JSON is wanted.
    pub fn is_json(self) -> bool {
        self.json
    }

    /// The error that ends the program.
    pub fn error(self, error: &Error) {
        self.remark(&format!("host-link: {error}"));
        self.failure(error);
    }

    /// Its JSON, where that is wanted.
    pub fn failure(self, error: &Error) {
        #[derive(Serialize)]
        struct Failure {
            error: String,
            exit: u8,
        }
        if self.json {
            let failure = Failure {
                error: error.to_string(),
                exit: error.exit().code(),
            };
            Self::line(&serde_json::to_string(&failure).unwrap_or_default());
        }
    }
}

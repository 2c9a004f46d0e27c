//! The first lines of something that never ends: the robot's log.

use std::io::{BufRead, BufReader, Read};
use std::path::Path;
use std::process::Command;
use std::sync::mpsc::{self, Receiver};
use std::thread;
use std::time::{Duration, Instant};

use crate::error::{Error, Of, Result};
use crate::shell;

/// Lines as they come.
pub struct Lines(Receiver<String>);

impl Lines {
    /// Reads `source` from now on, on a thread of its own.
    pub fn of(source: impl Read + Send + 'static) -> Self {
        let (sender, lines) = mpsc::channel();
        thread::spawn(move || {
            for line in BufReader::new(source)
                .split(b'\n')
                .map_while(std::result::Result::ok)
            {
                let line = String::from_utf8_lossy(&line).trim_end().to_owned();
                if sender.send(line).is_err() {
                    break;
                }
            }
        });
        Self(lines)
    }

    /// A serial device at the log's rate.
    ///
    /// # Errors
    /// [`Error::Board`] where it cannot be set or opened.
    pub fn of_serial(device: &str) -> Result<Self> {
        let mut stty = Command::new("stty");
        stty.args([
            "-F", device, "115200", "cs8", "-cstopb", "-parenb", "raw", "-echo",
        ]);
        let limit = Duration::from_secs(5);
        shell::run_within(&mut stty, limit).map_err(|error| Error::Board(error.to_string()))?;
        let port = std::fs::File::open(Path::new(device)).of(device);
        port.map(Self::of)
            .map_err(|error| Error::Board(error.to_string()))
    }

    /// Shows the first lines for which `wanted` holds: at most `most`, the first within `limit`, the
    /// others until there is a pause; how many there were.
    pub fn show(&self, most: usize, limit: Duration, wanted: impl Fn(&str) -> bool) -> usize {
        const PAUSE: Duration = Duration::from_secs(2);
        let mut end = Instant::now() + limit;
        let mut shown = 0;
        while shown < most {
            let left = end.saturating_duration_since(Instant::now());
            let Ok(line) = self.0.recv_timeout(left) else {
                break;
            };
            if wanted(&line) {
                println!("  {line}");
                shown += 1;
                end = Instant::now() + PAUSE;
            }
        }
        shown
    }

    /// The first line that starts with `start`, without it, within `limit`.
    pub fn find(&self, start: &str, limit: Duration) -> Option<String> {
        let end = Instant::now() + limit;
        loop {
            let left = end.saturating_duration_since(Instant::now());
            let line = self.0.recv_timeout(left).ok()?;
            if let Some(rest) = line.strip_prefix(start) {
                return Some(rest.trim().to_owned());
            }
        }
    }
}

/// Whether this is a line of the robot's log: `<I|W|E><count>: <text>`, five digits.
pub fn is_log(line: &str) -> bool {
    let bytes = line.as_bytes();
    bytes.len() > 8
        && b"IWE".contains(&bytes[0])
        && bytes[1..6].iter().all(u8::is_ascii_digit)
        && &bytes[6..8] == b": "
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn lines_are_found_and_counted() {
        let lines = Lines::of(&b"noise\ngdb: 127.0.0.1:3333\nI00000: a\r\nx\nW00001: b\n"[..]);
        let limit = Duration::from_secs(5);
        assert_eq!(
            lines.find("gdb: ", limit).as_deref(),
            Some("127.0.0.1:3333")
        );
        assert_eq!(lines.show(10, limit, is_log), 2);
    }

    #[test]
    fn a_log_line_has_its_level_and_five_digits() {
        assert!(is_log("I00012: ready"));
        for line in [
            "I0012: ready",
            "X00012: ready",
            "I00012 ready",
            "",
            "I00012:",
        ] {
            assert!(!is_log(line), "{line}");
        }
    }
}

//! The first lines of something that never ends: the robot's log.

use std::fs::File;
use std::io::{BufRead, BufReader, Read};
use std::sync::mpsc::{self, Receiver};
use std::thread;
use std::time::{Duration, Instant};

use xshell::cmd;

use crate::error::{Error, Kind, Result, fail};
use crate::process::pattern;
use crate::workspace::Workspace;

/// Lines as they come.
pub struct Lines(Receiver<String>);

impl Lines {
    /// Reads `source` from now on, on a thread of its own.
    pub fn read(source: impl Read + Send + 'static) -> Self {
        let (sender, lines) = mpsc::channel();
        thread::spawn(move || {
            let lines = BufReader::new(source).split(b'\n');
            for line in lines.map_while(std::io::Result::ok) {
                let line = String::from_utf8_lossy(&line).trim_end().to_owned();
                if sender.send(line).is_err() {
                    break;
                }
            }
        });
        Self(lines)
    }

    /// A serial device at the log's rate.
    pub fn read_serial(workspace: &Workspace, device: &str) -> Result<Self> {
        let options = "115200 cs8 -cstopb -parenb raw -echo".split(' ');
        let stty = cmd!(workspace.sh, "stty -F {device}").args(options);
        let port = stty.run().map_err(Error::from);
        match port.and_then(|()| Ok(File::open(device)?)) {
            Ok(port) => Ok(Self::read(port)),
            Err(error) => fail(Kind::Board, format!("{device}: {error}")),
        }
    }

    /// Prints the first log lines (`<I|W|E><count>: <text>`, five digits): at most `most`, the first
    /// within `limit`, the others until there is a pause of two seconds. Returns how many there were.
    pub fn print(&self, most: usize, limit: Duration) -> usize {
        let log_line = pattern(r"^[IWE]\d{5}: .");
        let (mut end, mut printed) = (Instant::now() + limit, 0);
        while let Some(line) = self.next_before(end).filter(|_| printed < most) {
            if log_line.is_match(&line) {
                println!("  {line}");
                printed += 1;
                end = Instant::now() + Duration::from_secs(2);
            }
        }
        printed
    }

    /// What follows `start` in the first line that begins with it, within `limit`.
    pub fn find(&self, start: &str, limit: Duration) -> Option<String> {
        let end = Instant::now() + limit;
        loop {
            if let Some(rest) = self.next_before(end)?.strip_prefix(start) {
                return Some(rest.trim().to_owned());
            }
        }
    }

    fn next_before(&self, end: Instant) -> Option<String> {
        let left = end.saturating_duration_since(Instant::now());
        self.0.recv_timeout(left).ok()
    }
}

#[test]
fn log_lines_are_found_among_others() {
    let text = "noise\ngdb: 127.0.0.1:3333\nI00000: a\r\nx\nI0012: short count\nX00012: level\n\
                I00012 colon\nI00012:\nW00001: b\n";
    let lines = Lines::read(text.as_bytes());
    let limit = Duration::from_secs(5);
    let address = lines.find("gdb: ", limit);
    assert_eq!(address.as_deref(), Some("127.0.0.1:3333"));
    assert_eq!(lines.print(10, limit), 2);
}

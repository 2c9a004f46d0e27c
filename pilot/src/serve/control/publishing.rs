//! What the clients get: replies, and the frame, the log and the map for those who watch.

use super::{CELL_MM, Next, Server};
use crate::serve::hub::ClientId;
use crate::serve::protocol::{Activity, Failure, Message, VERSION};
use crate::serve::tiles::Tiles;
use host_link::error::Error;
use host_link::log::{LONGEST, Lines};
use std::collections::BTreeMap;
use std::sync::Arc;

impl Server {
    /// Sends the frame, the log and the map to those who watch.
    pub(super) fn publish(&mut self, log: &[u8]) {
        self.frames = self.frames.wrapping_add(1);
        self.publish_log(log);
        if self.clients.values().all(|client| client.every.is_none()) {
            return;
        }
        let frame = self.latest.clone().map(Box::new).map(Message::Frame);
        let frame = frame.as_ref().map(text);
        let mut changed = Vec::new();
        if let Some(localiser) = &self.map.localiser {
            changed = self.tiles.update(localiser.grid());
        }
        let (frames, tiles) = (self.frames, &self.tiles);
        let tile = |number| {
            let tiles = vec![tiles.tile(number).clone()];
            text(&Message::Tiles { tiles })
        };
        // Written once for all who watch.
        let written = changed.iter().map(|&number| (number, tile(number)));
        let written: BTreeMap<_, _> = written.collect();
        // A client that does not keep up is dropped: nothing here waits for one.
        self.clients.retain(|_, client| {
            let Some(every) = client.every else {
                return true;
            };
            let due = frame.iter().filter(|_| frames % every == 0);
            let known = client.tiles;
            client.tiles += tiles.from(known).len();
            let shared = |number| written.get(&number).cloned();
            let fresh = known..client.tiles;
            let fresh = fresh.map(|number| shared(number).unwrap_or_else(|| tile(number)));
            let update = written.range(..known).map(|(_, text)| Arc::clone(text));
            let mut all = due.map(Arc::clone).chain(update).chain(fresh);
            all.all(|message| client.send(&message))
        });
    }

    /// The robot does not answer: the clients are served all the same.
    pub(super) fn unreachable(&mut self, error: &Error) {
        if !matches!(self.next, Some(Next::Lend)) {
            if let Some(Next::Motion(waiting)) = self.next.take() {
                self.report_end(waiting.activity(), Some(error), 0.0);
            }
            self.lease = None;
        }
        if let Some(frame) = &mut self.latest {
            (frame.error, frame.driver) = (Some(error.to_string()), None);
            frame.activity = Activity::Idle;
        }
        self.publish(&[]);
        self.handle_events();
        self.cancelled = None;
    }

    /// Sends the lines that these bytes of the log complete.
    pub(super) fn publish_log(&mut self, bytes: &[u8]) {
        let lines = log_lines(&mut self.log, bytes);
        self.clients.retain(|_, client| {
            client.every.is_none() || lines.iter().all(|line| client.send(line))
        });
    }

    pub(super) fn new_map(&mut self) {
        self.tiles = Tiles::default();
        let message = text(&Message::Map { cell_mm: CELL_MM });
        self.clients.retain(|_, client| {
            client.tiles = 0;
            client.every.is_none() || client.send(&message)
        });
    }

    pub(super) fn reply(&mut self, id: ClientId, outcome: &Result<(), Error>) {
        let error = outcome.as_ref().err().map(Failure::from);
        let version = VERSION;
        self.send_to(id, &Message::Reply { version, error });
        if let Some(client) = self.clients.get(&id) {
            client.answered();
        }
    }

    pub(super) fn send_to(&mut self, id: ClientId, message: &Message) {
        let client = self.clients.get(&id);
        if client.is_some_and(|client| !client.send(&text(message))) {
            self.clients.remove(&id);
        }
    }
}

/// The messages of the lines that these bytes complete.
fn log_lines(lines: &mut Lines, bytes: &[u8]) -> Vec<Arc<str>> {
    let lines = lines.feed(bytes).into_iter();
    let lines = lines.map(|line| String::from_utf8_lossy(&line).trim_end().to_owned());
    let lines = lines.filter(|line| line.len() <= LONGEST);
    lines.map(|line| text(&Message::Log { line })).collect()
}

/// A message as it is sent.
fn text(message: &Message) -> Arc<str> {
    // Strings, numbers and maps with keys of strings cannot fail.
    serde_json::to_string(message).unwrap_or_default().into()
}

#[test]
fn lines_of_the_log_are_whole_or_left_out() {
    let (mut begun, long) = (Lines::default(), "x".repeat(LONGEST));
    for (bytes, expected) in [
        ("I00001: a\nI0000", &["I00001: a"][..]),
        ("2: b\n", &["I00002: b"]),
        (&long, &[]),
        ("x", &[]),
        ("x\nI00003: c\n", &["I00003: c"]),
    ] {
        let message = |line: &&str| {
            text(&Message::Log {
                line: (*line).into(),
            })
        };
        let expected: Vec<_> = expected.iter().map(message).collect();
        assert_eq!(log_lines(&mut begun, bytes.as_bytes()), expected, "{bytes}");
    }
}

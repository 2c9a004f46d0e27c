//! A client of a server, over its socket or a pair of sockets in the same process.

use crate::serve::hub::Port;
use crate::serve::listener::{self, LineSocket, STALLED, Transport};
use crate::serve::protocol::{Frame, Message, Request, Tile, VERSION};
use crate::serve::tiles;
use host_link::board_io::Interrupt;
use host_link::error::{Error, Exit};
use mapper::Grid;
use mapper::map_plot::MAX_SIDE_CELLS;
use std::collections::{HashMap, VecDeque};
use std::fmt::Display;
use std::fs;
use std::io::ErrorKind;
use std::net::Shutdown;
use std::os::unix::fs::MetadataExt;
use std::os::unix::net::UnixStream;
use std::path::Path;
use std::thread;
use std::time::{Duration, Instant};

/// How long [`Client::message`] waits.
const WAIT: Duration = Duration::from_millis(10);
/// Time for a reply.
const REPLY: Duration = Duration::from_secs(5);
/// What a path without a server's socket leads to; the last, where it is too long for one.
const NO_SERVER: [ErrorKind; 3] = [
    ErrorKind::NotFound,
    ErrorKind::ConnectionRefused,
    ErrorKind::InvalidInput,
];
/// Tiles farther from the origin than the grid reaches are not taken.
const FARTHEST_TILE: i32 = (MAX_SIDE_CELLS / 2).cast_signed() / tiles::SIDE + 1;

/// A client that has joined.
pub struct Client {
    lines: LineSocket,
    /// What follows the last message.
    unread: Vec<u8>,
    queue: VecDeque<Message>,
}

impl Client {
    /// Joins the server that listens on this socket; none where there is no server.
    ///
    /// # Errors
    /// [`Error::Device`] for a socket that may not be used, those of [`Self::request`].
    pub fn connect(path: &Path, name: &str) -> Result<Option<Self>, Error> {
        let stream = match UnixStream::connect(path) {
            Ok(stream) => stream,
            Err(cause) if NO_SERVER.contains(&cause.kind()) => return Ok(None),
            Err(cause) => {
                let name = format!("the server's socket {}", path.display());
                let group = group(path);
                let group = group.unwrap_or("of the user that runs `robot serve`".into());
                let advice = format!("join the group {group}");
                return Err(Error::device(name, cause, advice));
            }
        };
        Self::join(stream, name, &Interrupt::new()).map(Some)
    }

    /// Joins a control loop of the same process.
    ///
    /// # Errors
    /// Those of [`Self::request`]; [`Error::Interrupted`].
    pub fn local(port: Port, name: &str, interrupt: &Interrupt) -> Result<Self, Error> {
        let (stream, server) = UnixStream::pair().map_err(lost)?;
        // A terminal that shows nothing for a while is behind, as far as its queue goes, and not stalled.
        thread::spawn(move || listener::serve(&LineSocket(server), &port, None));
        Self::join(stream, name, interrupt)
    }

    fn join(stream: UnixStream, name: &str, interrupt: &Interrupt) -> Result<Self, Error> {
        stream.set_write_timeout(Some(STALLED)).map_err(lost)?;
        let mut client = Self {
            lines: LineSocket(stream),
            unread: Vec::new(),
            queue: VecDeque::new(),
        };
        let hello = Request::Hello {
            version: VERSION,
            name: name.into(),
            token: String::new(),
        };
        client.exchange(&hello, interrupt)?;
        Ok(client)
    }

    /// Sends a request and waits for its reply; other messages wait for [`Self::message`].
    ///
    /// # Errors
    /// [`Error::Server`]: the refusal, or that the server has ended.
    pub fn request(&mut self, request: &Request) -> Result<(), Error> {
        self.exchange(request, &Interrupt::new())
    }

    fn exchange(&mut self, request: &Request, interrupt: &Interrupt) -> Result<(), Error> {
        let line = serde_json::to_string(request).unwrap_or_default();
        let sent = self.lines.send(&line).map_err(lost);
        let (ends, mut late) = (Instant::now() + REPLY, false);
        loop {
            interrupt.check()?;
            match self.receive()? {
                // Why a server drops a client is its last message, which no request need reach.
                Some(Message::Reply {
                    error: Some(why), ..
                }) => return Err(why.into()),
                Some(Message::Reply { .. }) => return sent,
                Some(message) => self.queue.push_back(message),
                // What came while this process was suspended has been read.
                None if late => {
                    // A reply that comes later would be taken for the next request's.
                    let _ = self.lines.stream().shutdown(Shutdown::Both);
                    return Err(lost("no reply"));
                }
                None => late = Instant::now() > ends,
            }
        }
    }

    /// The next message, if one has come within 10 ms.
    ///
    /// # Errors
    /// [`Error::Server`]: the server has ended.
    pub fn message(&mut self) -> Result<Option<Message>, Error> {
        match self.queue.pop_front() {
            Some(message) => Ok(Some(message)),
            None => self.receive(),
        }
    }

    fn receive(&mut self) -> Result<Option<Message>, Error> {
        let ends = Some(Instant::now() + WAIT);
        let line = self.lines.receive(&mut self.unread, ends).map_err(lost)?;
        let Some(line) = line else {
            return Ok(None);
        };
        let message = serde_json::from_slice(&line);
        message.map(Some).map_err(lost)
    }

    /// The latest frame.
    ///
    /// # Errors
    /// Those of [`Self::request`].
    pub fn status(&mut self) -> Result<Frame, Error> {
        match self.ask(&Request::Status)? {
            Some(Message::Frame(frame)) => Ok(*frame),
            _ => Err(lost("the robot has not answered yet")),
        }
    }

    /// Sends a request that is answered by a message; the message, which comes before the reply.
    ///
    /// # Errors
    /// Those of [`Self::request`].
    pub fn ask(&mut self, request: &Request) -> Result<Option<Message>, Error> {
        self.request(request)?;
        Ok(self.queue.pop_back())
    }
}

/// The name of the group that owns a file.
fn group(path: &Path) -> Option<String> {
    let id = fs::metadata(path).ok()?.gid().to_string();
    let groups = fs::read_to_string("/etc/group").ok()?;
    let mut groups = groups
        .lines()
        .map(|line| line.split(':').collect::<Vec<_>>());
    Some(groups.find(|group| group.get(2) == Some(&&*id))?[0].into())
}

pub(crate) fn lost(cause: impl Display) -> Error {
    let text = format!("the server does not answer ({cause}); look at what `robot serve` shows");
    let exit = Exit::Device;
    Error::Server { text, exit }
}

/// What a watching client knows: the latest frame and the map.
#[derive(Default)]
pub struct View {
    /// The latest frame.
    pub frame: Option<Frame>,
    tiles: HashMap<(i32, i32), String>,
    cell_mm: f64,
}

impl View {
    /// Takes a message.
    // Requirement: SERVE-map-1
    pub fn take(&mut self, message: &Message) {
        match message {
            Message::Frame(frame) => self.frame = Some(Frame::clone(frame)),
            Message::Map { cell_mm } => {
                self.cell_mm = *cell_mm;
                self.tiles.clear();
            }
            Message::Tiles { tiles } => {
                let within = |tile: &&Tile| tile.column.abs().max(tile.row.abs()) <= FARTHEST_TILE;
                for Tile { column, row, cells } in tiles.iter().filter(within) {
                    self.tiles.insert((*column, *row), cells.clone());
                }
            }
            _ => {}
        }
    }

    /// Tiles known of the map.
    pub fn tiles(&self) -> usize {
        self.tiles.len()
    }

    /// The map.
    pub fn grid(&self) -> Grid {
        tiles::grid(&self.tiles, self.cell_mm.max(1.0))
    }
}

// Requirement: SERVE-map-1
#[test]
fn view_takes_tiles_within_reach_until_the_map_begins_again() {
    let mut view = View::default();
    let new_map = Message::Map { cell_mm: 25.0 };
    view.take(&new_map);
    let none = view.grid().columns();
    let tile = |column| Tile {
        column,
        row: 0,
        cells: "#".repeat(1024),
    };
    let tiles = vec![tile(FARTHEST_TILE + 1), tile(-FARTHEST_TILE - 1)];
    view.take(&Message::Tiles { tiles });
    assert_eq!(view.grid().columns(), none);
    let tiles = vec![tile(FARTHEST_TILE)];
    view.take(&Message::Tiles { tiles });
    assert!(view.grid().columns() > none);
    view.take(&new_map);
    assert_eq!(view.grid().columns(), none);
}

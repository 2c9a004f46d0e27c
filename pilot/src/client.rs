//! A client of a server: over its socket, or in the same process.

use crate::serve::hub::Port;
use crate::serve::listener::{Lines, TURN, Transport};
use crate::serve::protocol::{Activity, Failure, Frame, Message, Request, Tile, VERSION};
use crate::serve::tiles;
use host_link::board_io::Interrupt;
use host_link::error::{Error, Exit};
use mapper::{Grid, Pose2};
use std::collections::{HashMap, VecDeque};
use std::io::ErrorKind;
use std::os::unix::net::UnixStream;
use std::path::Path;
use std::time::{Duration, Instant};

/// Time for a reply.
const REPLY: Duration = Duration::from_secs(5);
/// Lease of a motion that the client keeps, ms.
const LEASE_MS: u32 = 2000;
/// Tiles farther from the origin than the grid reaches are not taken.
const FARTHEST_TILE: i32 = 63;

enum Link {
    Socket(Lines<UnixStream>),
    Local(Port),
}

/// A client that has joined.
pub struct Client {
    link: Link,
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
            Err(cause)
                if matches!(
                    cause.kind(),
                    ErrorKind::NotFound | ErrorKind::ConnectionRefused
                ) =>
            {
                return Ok(None);
            }
            Err(cause) => {
                return Err(Error::Device {
                    name: format!("the server's socket {}", path.display()),
                    cause: cause.to_string(),
                    advice: "join the group of the user that runs `robot serve`".into(),
                });
            }
        };
        let lines = Lines::over(stream).map_err(|cause| lost(&cause.to_string()))?;
        let queue = VecDeque::new();
        let link = Link::Socket(lines);
        let mut client = Self { link, queue };
        client.request(&Request::Hello {
            version: VERSION,
            name: name.into(),
            token: String::new(),
        })?;
        Ok(Some(client))
    }

    /// Joins a control loop of the same process.
    ///
    /// # Errors
    /// Those of [`Self::request`].
    pub fn local(mut port: Port, name: &str) -> Result<Self, Error> {
        port.join(name.into());
        let queue = VecDeque::new();
        let link = Link::Local(port);
        let mut client = Self { link, queue };
        client.await_reply()?;
        Ok(client)
    }

    /// Sends a request and waits for its reply; other messages wait for [`Self::message`].
    ///
    /// # Errors
    /// [`Error::Server`]: the refusal, or that the server has ended.
    pub fn request(&mut self, request: &Request) -> Result<(), Error> {
        match &mut self.link {
            Link::Socket(lines) => {
                let line = serde_json::to_string(request).unwrap_or_default();
                lines
                    .send(&line)
                    .map_err(|cause| lost(&cause.to_string()))?;
            }
            Link::Local(port) => port.ask(request.clone()),
        }
        self.await_reply()
    }

    fn await_reply(&mut self) -> Result<(), Error> {
        let ends = Instant::now() + REPLY;
        while Instant::now() < ends {
            match self.receive()? {
                Some(Message::Reply { error: None, .. }) => return Ok(()),
                Some(Message::Reply {
                    error: Some(why), ..
                }) => return Err(why.into()),
                Some(message) => self.queue.push_back(message),
                None => {}
            }
        }
        Err(lost("no reply"))
    }

    /// The next message, if one has come within [`TURN`].
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
        let line = match &mut self.link {
            Link::Socket(lines) => lines.receive().map_err(|cause| lost(&cause.to_string()))?,
            Link::Local(port) => {
                let message = port.receive(TURN).map_err(|_| lost("it has ended"))?;
                message.map(|message| message.as_bytes().to_vec())
            }
        };
        let Some(line) = line else {
            return Ok(None);
        };
        let message = serde_json::from_slice(&line);
        message.map(Some).map_err(|cause| lost(&cause.to_string()))
    }

    /// The latest frame.
    ///
    /// # Errors
    /// Those of [`Self::request`].
    pub fn status(&mut self) -> Result<Frame, Error> {
        self.request(&Request::Status)?;
        while let Some(message) = self.queue.pop_front() {
            if let Message::Frame(frame) = message {
                return Ok(*frame);
            }
        }
        Err(lost("the robot has not answered yet"))
    }

    /// Makes a motion and keeps its lease until it has ended; seconds on the board's clock. `watch` gets
    /// every message.
    ///
    /// # Errors
    /// Why it did not end as planned; [`Error::Interrupted`] after Ctrl-C: the server stops the robot.
    pub fn drive(
        &mut self,
        request: &Request,
        interrupt: &Interrupt,
        mut watch: impl FnMut(&Message),
    ) -> Result<f64, Error> {
        self.request(&Request::Watch { every: 1 })?;
        self.request(request)?;
        let every = Duration::from_millis(u64::from(LEASE_MS) / 4);
        let mut keep = Instant::now() + every;
        loop {
            if interrupt.check().is_err() {
                self.request(&Request::Stop)?;
                return Err(Error::Interrupted);
            }
            match self.message()? {
                Some(Message::Done { error, seconds, .. }) => {
                    return error.map_or(Ok(seconds), |why: Failure| Err(why.into()));
                }
                Some(message) => watch(&message),
                None => {}
            }
            if Instant::now() >= keep {
                keep = Instant::now() + every;
                // Refused once the motion has ended, which the next message reports.
                let _ = self.request(&Request::Keep);
            }
        }
    }
}

/// A request to explore whose lease [`Client::drive`] keeps.
pub const EXPLORE: Request = Request::Explore { lease_ms: LEASE_MS };

/// A request to go to a pose whose lease [`Client::drive`] keeps.
pub fn goto(target: host_link::pose::Pose, criteria: &crate::drive::ArrivalCriteria) -> Request {
    Request::Goto {
        x_mm: target.x_mm,
        y_mm: target.y_mm,
        rotation_deg: Some(target.rotation_deg),
        tolerance: Some((criteria.tolerance_mm, criteria.tolerance_deg)),
        timeout_s: criteria.timeout_s,
        lease_ms: LEASE_MS,
    }
}

fn lost(cause: &str) -> Error {
    let text = format!("the server does not answer ({cause}); look at what `robot serve` shows");
    let exit = Exit::Device;
    Error::Server { text, exit }
}

/// What a watching client knows: the latest frame, the map, the path.
#[derive(Default)]
pub struct View {
    /// The latest frame.
    pub frame: Option<Frame>,
    /// The estimated path since this map began.
    pub path: Vec<Pose2>,
    /// Activity that ended last, and why.
    pub ended: Option<(Activity, Option<Failure>)>,
    tiles: HashMap<(i32, i32), String>,
    cell_mm: f64,
}

/// Farthest between two points of the path, mm.
const PATH_MM: f64 = 20.0;
/// Points of the path that are kept: 2 km.
const PATH_POINTS: usize = 100_000;

impl View {
    /// Takes a message.
    pub fn take(&mut self, message: &Message) {
        match message {
            Message::Frame(frame) => {
                if let Some(estimate) = frame.estimate {
                    let pose = crate::mapping::mapper_pose(estimate.pose);
                    let near = |last: &Pose2| last.distance_mm(&pose) < PATH_MM;
                    if !self.path.last().is_some_and(near) && self.path.len() < PATH_POINTS {
                        self.path.push(pose);
                    }
                }
                self.frame = Some(Frame::clone(frame));
            }
            Message::Map { cell_mm } => {
                self.cell_mm = *cell_mm;
                self.tiles.clear();
                self.path.clear();
            }
            Message::Tiles { tiles } => {
                let within = |tile: &&Tile| tile.column.abs().max(tile.row.abs()) <= FARTHEST_TILE;
                for Tile { column, row, cells } in tiles.iter().filter(within) {
                    self.tiles.insert((*column, *row), cells.clone());
                }
            }
            Message::Done {
                activity, error, ..
            } => self.ended = Some((*activity, error.clone())),
            Message::Log { .. } | Message::Reply { .. } => {}
        }
    }

    /// The map.
    pub fn grid(&self) -> Grid {
        tiles::grid(&self.tiles, self.cell_mm.max(1.0))
    }
}

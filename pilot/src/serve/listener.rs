//! Sockets: one thread accepts, one thread serves each client.

use super::hub::{Hub, Port};
use super::protocol::{Failure, MAX_LINE, Message, Request, VERSION};
use super::token;
use host_link::error::{Error, Exit};
use std::fs;
use std::io::{self, ErrorKind, Read, Write};
use std::net::{TcpListener, TcpStream, ToSocketAddrs};
use std::os::unix::fs::{FileTypeExt, PermissionsExt};
use std::os::unix::net::{UnixListener, UnixStream};
use std::path::{Path, PathBuf};
use std::sync::Arc;
use std::thread;
use std::time::{Duration, Instant};

/// How long a client is listened to before its messages go out.
pub const TURN: Duration = Duration::from_millis(2);
/// A client that takes no bytes for so long is dropped.
pub const STALLED: Duration = Duration::from_secs(1);
/// Time for the first message.
pub const GREETING: Duration = Duration::from_secs(5);

/// A connection that carries messages.
pub trait Transport {
    /// The next message, if one has come within [`TURN`].
    ///
    /// # Errors
    /// The connection has ended, or a message is too long.
    fn receive(&mut self) -> io::Result<Option<Vec<u8>>>;

    /// # Errors
    /// The connection has ended, or takes nothing for [`STALLED`].
    fn send(&mut self, message: &str) -> io::Result<()>;
}

/// Lines over a stream.
pub struct Lines<S> {
    stream: S,
    buffer: Vec<u8>,
}

impl Lines<UnixStream> {
    /// Over a Unix socket, whose time-outs it sets.
    ///
    /// # Errors
    /// The system's.
    pub fn over(stream: UnixStream) -> io::Result<Self> {
        stream.set_read_timeout(Some(TURN))?;
        stream.set_write_timeout(Some(STALLED))?;
        Ok(Self::new(stream))
    }
}

impl<S: Read + Write> Lines<S> {
    /// Over a stream whose time-outs are set.
    pub const fn new(stream: S) -> Self {
        let buffer = Vec::new();
        Self { stream, buffer }
    }

    fn line(&mut self) -> io::Result<Option<Vec<u8>>> {
        if let Some(end) = self.buffer.iter().position(|&byte| byte == b'\n') {
            let rest = self.buffer.split_off(end + 1);
            let mut line = std::mem::replace(&mut self.buffer, rest);
            line.pop();
            return Ok(Some(line));
        }
        if self.buffer.len() > MAX_LINE {
            return Err(io::Error::other(format!(
                "a line has at most {MAX_LINE} bytes"
            )));
        }
        Ok(None)
    }
}

impl<S: Read + Write> Transport for Lines<S> {
    // Requirement: SERVE-client-1
    fn receive(&mut self) -> io::Result<Option<Vec<u8>>> {
        if let Some(line) = self.line()? {
            return Ok(Some(line));
        }
        let mut bytes = [0; 4096];
        match self.stream.read(&mut bytes) {
            Ok(0) => Err(ErrorKind::UnexpectedEof.into()),
            Ok(len) => {
                self.buffer.extend_from_slice(&bytes[..len]);
                self.line()
            }
            Err(cause) if is_timeout(&cause) => Ok(None),
            Err(cause) => Err(cause),
        }
    }

    fn send(&mut self, message: &str) -> io::Result<()> {
        let line = [message.as_bytes(), b"\n"].concat();
        self.stream.write_all(&line)
    }
}

/// Whether only the time of a read is over.
pub fn is_timeout(cause: &io::Error) -> bool {
    use ErrorKind::{Interrupted, TimedOut, WouldBlock};
    matches!(cause.kind(), WouldBlock | TimedOut | Interrupted)
}

/// Serves one client to its end. Over a network it has to show the token.
pub fn serve(transport: &mut impl Transport, mut port: Port, token: Option<&str>) {
    let greeted = greet(transport, &mut port, token);
    let ended = greeted.and_then(|()| exchange(transport, &port, token.is_none()));
    if let Err(cause) = ended {
        let _ = transport.send(&refusal(cause.to_string(), Exit::Usage));
    }
}

/// A reply that refuses.
pub fn refusal(text: String, exit: Exit) -> String {
    let exit = exit.code();
    let error = Some(Failure { text, exit });
    let version = VERSION;
    serde_json::to_string(&Message::Reply { version, error }).unwrap_or_default()
}

// Requirement: SERVE-client-3
fn greet(transport: &mut impl Transport, port: &mut Port, token: Option<&str>) -> io::Result<()> {
    let ends = Instant::now() + GREETING;
    while Instant::now() < ends {
        let Some(line) = transport.receive()? else {
            continue;
        };
        return match Request::parse(&line) {
            Ok(Request::Hello {
                name, token: shown, ..
            }) => {
                if token.is_some_and(|token| !token::same(token, &shown)) {
                    return Err(io::Error::other("the token is wrong"));
                }
                port.join(name);
                Ok(())
            }
            Ok(_) => Err(io::Error::other("the first message is `hello`")),
            Err(what) => Err(io::Error::other(what)),
        };
    }
    Err(ErrorKind::TimedOut.into())
}

/// The robot's lines and buses are for clients of this computer (`local`).
fn exchange(transport: &mut impl Transport, port: &Port, local: bool) -> io::Result<()> {
    let gone = |_| io::Error::other("this client does not keep up, or the server has ended");
    loop {
        // A client whose request is pending is not listened to: it has one at a time.
        let wait = if port.is_pending() {
            TURN
        } else {
            Duration::ZERO
        };
        let mut next = port.receive(wait).map_err(gone)?;
        while let Some(message) = next {
            transport.send(&message)?;
            next = port.receive(Duration::ZERO).map_err(gone)?;
        }
        if port.is_pending() {
            continue;
        }
        if let Some(line) = transport.receive()? {
            match Request::parse(&line) {
                Ok(Request::Borrow) if !local => {
                    let what = "a robot is borrowed over its Unix socket only".into();
                    transport.send(&refusal(what, Exit::Usage))?;
                }
                Ok(request) => port.ask(request),
                Err(what) => transport.send(&refusal(what, Exit::Usage))?,
            }
        }
    }
}

/// Accepts clients and gives each a thread.
pub fn accept<S: Send + 'static>(
    hub: &Hub,
    mut next: impl FnMut() -> io::Result<S> + Send + 'static,
    serve: impl Fn(S, Port) + Clone + Send + 'static,
    refuse: impl Fn(S) + Send + 'static,
) {
    let hub = hub.clone();
    thread::spawn(move || {
        loop {
            let Ok(stream) = next() else {
                // No descriptor is left, or a client has gone already.
                thread::sleep(TURN);
                continue;
            };
            let Some(port) = hub.admit() else {
                refuse(stream);
                continue;
            };
            let serve = serve.clone();
            thread::spawn(move || serve(stream, port));
        }
    });
}

/// Refuses a client for which there is no place.
fn refuse_line<S: Read + Write>(stream: S) {
    let full = "the server has as many clients as it takes".into();
    let _ = Lines::new(stream).send(&refusal(full, Exit::Busy));
}

/// The file of a Unix socket, removed at the end.
pub struct SocketFile(PathBuf);

impl Drop for SocketFile {
    fn drop(&mut self) {
        let _ = fs::remove_file(&self.0);
    }
}

/// Listens on a Unix socket that its owner and group may use. The caller holds the robot's lock: a socket
/// that is there already was left by a killed server.
///
/// # Errors
/// [`Error::Unwritable`].
pub fn unix(path: &Path, hub: &Hub) -> Result<SocketFile, Error> {
    let unwritable = |cause| Error::unwritable(path, &cause);
    if fs::symlink_metadata(path).is_ok_and(|found| found.file_type().is_socket()) {
        fs::remove_file(path).map_err(unwritable)?;
    }
    let listener = UnixListener::bind(path).map_err(unwritable)?;
    let file = SocketFile(path.into());
    fs::set_permissions(path, fs::Permissions::from_mode(0o660)).map_err(unwritable)?;
    let client = |stream: UnixStream, port| {
        if let Ok(mut lines) = Lines::over(stream) {
            serve(&mut lines, port, None);
        }
    };
    accept(hub, move || Ok(listener.accept()?.0), client, refuse_line);
    Ok(file)
}

/// Binds a TCP listener.
///
/// # Errors
/// [`Error::Device`].
pub fn bind(address: &str) -> Result<TcpListener, Error> {
    let bound = address.to_socket_addrs().map(Iterator::collect::<Vec<_>>);
    let bound = bound.and_then(|all| TcpListener::bind(&all[..]));
    bound.map_err(|cause| Error::Device {
        name: format!("the address {address}"),
        cause: cause.to_string(),
        advice: "choose an address of this computer and a free port: 127.0.0.1:8040".into(),
    })
}

/// Sets the time-outs of a client's connection.
///
/// # Errors
/// The system's.
pub fn set_timeouts(stream: &TcpStream) -> io::Result<()> {
    stream.set_nodelay(true)?;
    stream.set_read_timeout(Some(TURN))?;
    stream.set_write_timeout(Some(STALLED))
}

/// Listens on TCP for clients with the token.
///
/// # Errors
/// [`Error::Device`].
pub fn tcp(address: &str, token: &Arc<str>, hub: &Hub) -> Result<(), Error> {
    let (listener, token) = (bind(address)?, Arc::clone(token));
    let client = move |stream: TcpStream, port| {
        if set_timeouts(&stream).is_ok() {
            serve(&mut Lines::new(stream), port, Some(&token));
        }
    };
    accept(hub, move || Ok(listener.accept()?.0), client, refuse_line);
    Ok(())
}

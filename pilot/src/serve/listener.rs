//! Sockets: one thread accepts; each client has one that reads and one that writes.

use super::hub::{Hub, Port};
use super::protocol::{Failure, MAX_LINE, Message, Request, VERSION};
use super::token;
use host_link::error::{Error, Exit};
use std::fs;
use std::io::{self, ErrorKind, Read, Write};
use std::net::{Shutdown, SocketAddr, TcpListener, ToSocketAddrs};
use std::os::fd::OwnedFd;
use std::os::unix::fs::{FileTypeExt, PermissionsExt};
use std::os::unix::net::{UnixListener, UnixStream};
use std::path::{Path, PathBuf};
use std::sync::Arc;
use std::sync::mpsc::{Receiver, TryRecvError};
use std::thread;
use std::time::{Duration, Instant};

/// A client that takes no bytes for so long is dropped.
pub const STALLED: Duration = Duration::from_secs(1);
/// Time for the first message.
pub const GREETING: Duration = Duration::from_secs(5);

/// A connection that carries messages: one thread receives, another one may send.
pub trait Transport: Sync {
    /// Its socket, which takes nothing for at most [`STALLED`].
    fn stream(&self) -> &UnixStream;

    /// Takes the first message out of the bytes that were read, if it is complete.
    ///
    /// # Errors
    /// The peer closes, or a message is too long.
    fn take(&self, unread: &mut Vec<u8>) -> io::Result<Option<Vec<u8>>>;

    /// # Errors
    /// The connection has ended, or takes nothing for [`STALLED`].
    fn send(&self, message: &str) -> io::Result<()>;

    /// The next message; none when it has not come by `ends`. What follows it stays in `unread`.
    ///
    /// # Errors
    /// The connection has ended, and those of [`Self::take`].
    fn receive(&self, unread: &mut Vec<u8>, ends: Option<Instant>) -> io::Result<Option<Vec<u8>>> {
        loop {
            let message = self.take(unread)?;
            if message.is_some() || !read(self.stream(), unread, ends)? {
                return Ok(message);
            }
        }
    }
}

/// Reads what has come, or waits for it; false at `ends`.
///
/// # Errors
/// The connection has ended.
pub fn read(stream: &UnixStream, unread: &mut Vec<u8>, ends: Option<Instant>) -> io::Result<bool> {
    let remaining = ends.map(|ends| ends.saturating_duration_since(Instant::now()));
    if remaining == Some(Duration::ZERO) {
        return Ok(false);
    }
    stream.set_read_timeout(remaining)?;
    let mut bytes = [0; 4096];
    match (&*stream).read(&mut bytes) {
        Ok(0) => return Err(ErrorKind::UnexpectedEof.into()),
        Ok(length) => unread.extend_from_slice(&bytes[..length]),
        Err(cause) if cause.kind() == ErrorKind::WouldBlock => return Ok(false),
        Err(cause) if cause.kind() == ErrorKind::Interrupted => {}
        Err(cause) => return Err(cause),
    }
    Ok(true)
}

/// Lines over a socket.
pub struct LineSocket(pub UnixStream);

impl Transport for LineSocket {
    fn stream(&self) -> &UnixStream {
        &self.0
    }

    // Requirement: SERVE-client-1
    fn take(&self, unread: &mut Vec<u8>) -> io::Result<Option<Vec<u8>>> {
        if let Some(end) = unread.iter().position(|&byte| byte == b'\n') {
            let rest = unread.split_off(end + 1);
            let mut line = std::mem::replace(unread, rest);
            line.pop();
            return Ok(Some(line));
        }
        if unread.len() > MAX_LINE {
            return Err(io::Error::other(format!(
                "a line has at most {MAX_LINE} bytes"
            )));
        }
        Ok(None)
    }

    fn send(&self, message: &str) -> io::Result<()> {
        (&self.0).write_all(&[message.as_bytes(), b"\n"].concat())
    }
}

/// Serves one client to its end. Over a network it has to show the token.
pub fn serve(transport: &impl Transport, port: &Port, token: Option<&str>) {
    let mut unread = Vec::new();
    let ended = greet(transport, &mut unread, token).and_then(|name| {
        let (messages, answers) = port.join(name);
        thread::scope(|scope| {
            scope.spawn(|| write(transport, messages));
            let ended = exchange(transport, &mut unread, port, &answers, token.is_none());
            // A client may go with an answer unused; it hides whether it was dropped.
            answers.try_iter().for_each(drop);
            let dropped = answers.try_recv() == Err(TryRecvError::Disconnected);
            port.leave();
            if dropped {
                let what = "this client does not keep up, or the server has ended";
                return Err(io::Error::new(ErrorKind::ConnectionAborted, what));
            }
            ended
        })
    });
    if let Err(cause) = ended {
        let exit = match cause.kind() {
            ErrorKind::ConnectionAborted => Exit::Device,
            _ => Exit::Usage,
        };
        let _ = transport.send(&refusal(cause.to_string(), exit));
    }
}

/// A reply that refuses.
pub fn refusal(text: String, exit: Exit) -> String {
    let exit = exit.code();
    let error = Some(Failure { text, exit });
    let version = VERSION;
    serde_json::to_string(&Message::Reply { version, error }).unwrap_or_default()
}

/// The name of a client that may join.
// Requirement: SERVE-client-3
fn greet(
    transport: &impl Transport,
    unread: &mut Vec<u8>,
    token: Option<&str>,
) -> io::Result<String> {
    let line = transport.receive(unread, Some(Instant::now() + GREETING))?;
    let late = || io::Error::other(format!("no `hello` came within {GREETING:?}"));
    match Request::parse(&line.ok_or_else(late)?) {
        Ok(Request::Hello {
            name, token: shown, ..
        }) => {
            if token.is_some_and(|token| !token::same(token, &shown)) {
                return Err(io::Error::other("the token is wrong"));
            }
            Ok(name)
        }
        Ok(_) => Err(io::Error::other("the first message is `hello`")),
        Err(what) => Err(io::Error::other(what)),
    }
}

/// Writes each message at once, until the control loop drops the client or the client stalls; then ends
/// its reader.
fn write(transport: &impl Transport, messages: Receiver<Arc<str>>) {
    let sent = messages
        .into_iter()
        .try_for_each(|message| transport.send(&message));
    // A client that was dropped still gets the reason.
    let ends = sent.map_or(Shutdown::Both, |()| Shutdown::Read);
    let _ = transport.stream().shutdown(ends);
}

/// Reads requests and passes each on once the one before is answered, until the control loop drops the
/// client or the connection ends, be it while a request waits for its answer. The robot's lines and buses
/// are for clients of this computer (`local`).
fn exchange(
    transport: &impl Transport,
    unread: &mut Vec<u8>,
    port: &Port,
    answers: &Receiver<()>,
    local: bool,
) -> io::Result<()> {
    loop {
        let line = transport.receive(unread, None)?.unwrap_or_default();
        if answers.recv().is_err() {
            return Ok(());
        }
        port.ask(Request::parse(&line).and_then(|request| match request {
            Request::Borrow if !local => {
                Err("a robot is borrowed over its Unix socket only".into())
            }
            request => Ok(request),
        }));
    }
}

/// Accepts clients and gives each a thread.
pub fn accept(
    hub: &Hub,
    next: impl Fn() -> io::Result<UnixStream> + Send + 'static,
    serve: impl Fn(UnixStream, Port) + Clone + Send + 'static,
    refuse: impl Fn(UnixStream) + Send + 'static,
) {
    let hub = hub.clone();
    thread::spawn(move || {
        loop {
            let limited = |stream: UnixStream| {
                stream.set_write_timeout(Some(STALLED))?;
                Ok(stream)
            };
            let Ok(stream) = next().and_then(limited) else {
                // No descriptor is left, or a client has gone already.
                thread::sleep(Duration::from_millis(10));
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
fn refuse_line(stream: UnixStream) {
    let full = "the server has as many clients as it takes".into();
    let _ = LineSocket(stream).send(&refusal(full, Exit::Busy));
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
    let client = |stream, port| serve(&LineSocket(stream), &port, None);
    accept(hub, move || Ok(listener.accept()?.0), client, refuse_line);
    Ok(file)
}

/// Binds a TCP listener; where port 0 is asked for, its address has the one that is free.
///
/// # Errors
/// [`Error::Device`].
pub fn bind(address: &str) -> Result<(TcpListener, SocketAddr), Error> {
    let bound = address.to_socket_addrs().map(Iterator::collect::<Vec<_>>);
    let bound = bound.and_then(|all| TcpListener::bind(&all[..]));
    let bound = bound.and_then(|listener| listener.local_addr().map(|at| (listener, at)));
    bound.map_err(|cause| {
        let advice = "choose an address of this computer and a free port: 127.0.0.1:8040";
        Error::device(format!("the address {address}"), cause, advice)
    })
}

/// Accepts a client over TCP. Its socket is used as a Unix one: std's calls are the same for both.
///
/// # Errors
/// The system's.
pub fn accept_tcp(listener: &TcpListener) -> io::Result<UnixStream> {
    let (stream, _) = listener.accept()?;
    stream.set_nodelay(true)?;
    Ok(OwnedFd::from(stream).into())
}

/// Listens on TCP for clients with the token; the address.
///
/// # Errors
/// [`Error::Device`].
pub fn tcp(address: &str, token: &Arc<str>, hub: &Hub) -> Result<SocketAddr, Error> {
    let ((listener, address), token) = (bind(address)?, Arc::clone(token));
    let client = move |stream, port| serve(&LineSocket(stream), &port, Some(&token));
    let next = move || accept_tcp(&listener);
    accept(&hub.of_network(), next, client, refuse_line);
    Ok(address)
}

//! The page of `serve --web`: three static files, and a web socket that carries the client protocol.
//!
//! Only a page that this server gave, opened by an address or a name of this computer, gets a socket; and
//! nothing comes over it before the token, which stands in the fragment of the page's address.

mod http;
mod socket;

use crate::serve::hub::{Hub, Port};
use crate::serve::listener;
use host_link::error::Error;
use http::Head;
use socket::Socket;
use std::fs;
use std::io::{self, ErrorKind, Write};
use std::net::IpAddr;
use std::os::unix::net::UnixStream;
use std::sync::Arc;

/// Path, type and content of the static files.
const FILES: [(&str, &str, &str); 3] = [
    ("/", "text/html", include_str!("page.html")),
    ("/page.js", "text/javascript", include_str!("page.js")),
    ("/page.css", "text/css", include_str!("page.css")),
];
/// The web socket's path.
const SOCKET: &str = "/socket";
/// Headers of every answer: nothing from elsewhere, nothing kept, no frame around the page.
const HEADERS: &str = "Content-Security-Policy: default-src 'none'; script-src 'self'; style-src 'self'; \
    connect-src 'self'; base-uri 'none'; form-action 'none'; frame-ancestors 'none'\r\n\
    X-Content-Type-Options: nosniff\r\nReferrer-Policy: no-referrer\r\n\
    Cross-Origin-Resource-Policy: same-origin\r\nCache-Control: no-store\r\nConnection: close\r\n";

/// Serves the page; its address with the token.
///
/// # Errors
/// [`Error::Device`].
pub fn serve(address: &str, token: &Arc<str>, hub: &Hub) -> Result<String, Error> {
    let (listener, address) = listener::bind(address)?;
    let url = format!("http://{address}/#{token}");
    let token = Arc::clone(token);
    let client = move |stream, port| {
        // An end of the connection ends the client.
        let _ = answer(stream, &port, &token);
    };
    let full = |stream| {
        let _ = refuse(stream, "503 Service Unavailable", "too many clients");
    };
    let next = move || listener::accept_tcp(&listener);
    listener::accept(&hub.of_network(), next, client, full);
    Ok(url)
}

fn answer(mut stream: UnixStream, port: &Port, token: &str) -> io::Result<()> {
    let head = match http::read_head(&stream) {
        Err(cause) if cause.kind() == ErrorKind::InvalidData => {
            return refuse(stream, "400 Bad Request", "not a GET request of HTTP/1.1");
        }
        head => head?,
    };
    if !is_own_host(&head, &own_name()) {
        return refuse(stream, "403 Forbidden", "unknown host");
    }
    if head.path != SOCKET {
        return match FILES.iter().find(|(path, ..)| *path == head.path) {
            Some((_, kind, content)) => respond(stream, "200 OK", kind, content),
            None => refuse(stream, "404 Not Found", "no such page"),
        };
    }
    let Some(key) = accepted_key(&head) else {
        return refuse(
            stream,
            "403 Forbidden",
            "a socket is for this server's own page",
        );
    };
    let accept = socket::accept_key(key);
    write!(
        stream,
        "HTTP/1.1 101 Switching Protocols\r\nUpgrade: websocket\r\nConnection: Upgrade\r\n\
         Sec-WebSocket-Accept: {accept}\r\n\r\n"
    )?;
    let socket = Socket::new(stream);
    listener::serve(&socket, port, Some(token));
    socket.close()
}

/// Whether the page was opened by an address of a computer or by this one's name: a foreign name that
/// leads here (DNS rebinding) is refused.
// Requirement: SERVE-client-4
fn is_own_host(head: &Head, own: &str) -> bool {
    let host = head.header("host").unwrap_or_default();
    let name = match host.rsplit_once(':') {
        Some((name, port)) if port.bytes().all(|byte| byte.is_ascii_digit()) => name,
        _ => host,
    };
    let address = name.trim_start_matches('[').trim_end_matches(']');
    let local = name.strip_suffix(".local").unwrap_or(name);
    name == "localhost" || address.parse::<IpAddr>().is_ok() || (!own.is_empty() && local == own)
}

fn own_name() -> String {
    let name = fs::read_to_string("/proc/sys/kernel/hostname").unwrap_or_default();
    name.trim().to_ascii_lowercase()
}

/// The key of a handshake that a page of this server has begun.
// Requirement: SERVE-client-4
fn accepted_key(head: &Head) -> Option<&str> {
    let own = format!("http://{}", head.header("host")?);
    let asks = |name, value| {
        head.header(name)
            .is_some_and(|found| found.eq_ignore_ascii_case(value))
    };
    let fits = asks("origin", &own) && asks("upgrade", "websocket");
    (fits && asks("sec-websocket-version", "13")).then(|| head.header("sec-websocket-key"))?
}

fn refuse(stream: UnixStream, status: &str, why: &str) -> io::Result<()> {
    respond(stream, status, "text/plain", why)
}

fn respond(mut stream: UnixStream, status: &str, kind: &str, content: &str) -> io::Result<()> {
    let length = content.len();
    write!(
        stream,
        "HTTP/1.1 {status}\r\n{HEADERS}Content-Type: {kind}; charset=utf-8\r\n\
         Content-Length: {length}\r\n\r\n{content}"
    )
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::serve::listener::GREETING;
    use std::io::Read;
    use std::net::TcpStream;

    /// Asks the server at `own` for a page, or for its socket.
    fn ask(own: &str, path: &str, host: &str, origin: &str) -> TcpStream {
        let mut stream = TcpStream::connect(own).unwrap();
        let key = "dGhlIHNhbXBsZSBub25jZQ==";
        let request = format!(
            "GET {path} HTTP/1.1\r\nHost: {host}\r\nOrigin: {origin}\r\nUpgrade: websocket\r\n\
             Sec-WebSocket-Version: 13\r\nSec-WebSocket-Key: {key}\r\n\r\n"
        );
        stream.write_all(request.as_bytes()).unwrap();
        stream
    }

    // Requirement: SERVE-client-3
    #[test]
    fn socket_without_the_token_is_refused() {
        let (hub, _events) = Hub::new();
        let url = serve("127.0.0.1:0", &"0123456789abcdef".into(), &hub).unwrap();
        let own = url.split('/').nth(2).unwrap();
        let mut stream = ask(own, SOCKET, own, &format!("http://{own}"));
        // Nothing may follow the request before its answer.
        stream.read_exact(&mut [0; 12]).unwrap();
        let hello = br#"{"do":"hello","version":1,"name":"a"}"#;
        // A text message, masked by zeros.
        let length = u8::try_from(hello.len()).unwrap();
        let head = [0x81, 0x80 | length, 0, 0, 0, 0];
        stream.write_all(&[&head[..], hello].concat()).unwrap();
        stream.set_read_timeout(Some(GREETING)).unwrap();
        let mut answer = Vec::new();
        let _ = stream.read_to_end(&mut answer);
        assert!(answer.ends_with(&[0x88, 0]), "closed: {answer:?}");
        let answer = String::from_utf8_lossy(&answer);
        assert!(answer.contains("the token is wrong"), "{answer}");
        let mut stream = TcpStream::connect(own).unwrap();
        stream.write_all(b"POST / HTTP/1.1\r\n\r\n").unwrap();
        let mut answer = String::new();
        stream.read_to_string(&mut answer).unwrap();
        assert!(answer.starts_with("HTTP/1.1 400 "), "{answer}");
    }

    // Requirement: SERVE-client-4
    #[test]
    fn foreign_host_or_origin_gets_no_socket() {
        let (hub, _events) = Hub::new();
        let url = serve("127.0.0.1:0", &"0123456789abcdef".into(), &hub).unwrap();
        let own = url.split('/').nth(2).unwrap();
        let status = |path: &str, host: &str, origin: &str| {
            let mut stream = ask(own, path, host, origin);
            let mut answer = [0; 12];
            stream.read_exact(&mut answer).unwrap();
            String::from_utf8_lossy(&answer[9..]).into_owned()
        };
        let page = format!("http://{own}");
        let named = format!("{}.local:80", own_name());
        let by_name = if own_name().is_empty() { "403" } else { "200" };
        for (path, host, origin, expected) in [
            ("/", own, "null", "200"),
            ("/page.js", "localhost:1", "null", "200"),
            ("/", "[::1]:8080", "null", "200"),
            ("/", &named, "null", by_name),
            ("/", "", "null", "403"),
            ("/", "robot.example", "null", "403"),
            ("/", "127.0.0.1.example:80", "null", "403"),
            ("/..", own, "null", "404"),
            (SOCKET, own, &page, "101"),
            (SOCKET, own, "http://robot.example", "403"),
            (SOCKET, own, "null", "403"),
            (SOCKET, "robot.example", "http://robot.example", "403"),
        ] {
            assert_eq!(
                status(path, host, origin),
                expected,
                "{path} {host} {origin}"
            );
        }
    }
}

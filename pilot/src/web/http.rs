//! The head of an HTTP request: as much of RFC 9112 as a page of three files needs.

use crate::serve::listener::{self, GREETING};
use std::collections::HashMap;
use std::io::{self, ErrorKind};
use std::os::unix::net::UnixStream;
use std::time::Instant;

/// Longest head, bytes.
const MAX_HEAD: usize = 8192;

/// A GET request's path and headers.
#[derive(Debug, PartialEq, Eq)]
pub struct Head {
    pub path: String,
    headers: HashMap<String, String>,
}

impl Head {
    /// A header by its name in lower case.
    pub fn header(&self, name: &str) -> Option<&str> {
        self.headers.get(name).map(String::as_str)
    }
}

/// Reads a head.
///
/// # Errors
/// The connection's; [`ErrorKind::InvalidData`] for what is no GET request of at most [`MAX_HEAD`] bytes.
pub fn read_head(stream: &UnixStream) -> io::Result<Head> {
    let (mut bytes, ends) = (Vec::new(), Instant::now() + GREETING);
    while !bytes.ends_with(b"\r\n\r\n") {
        if bytes.len() > MAX_HEAD || !listener::read(stream, &mut bytes, Some(ends))? {
            return Err(ErrorKind::InvalidData.into());
        }
    }
    parse(&bytes).ok_or_else(|| ErrorKind::InvalidData.into())
}

fn parse(bytes: &[u8]) -> Option<Head> {
    let text = std::str::from_utf8(bytes).ok()?;
    let mut lines = text.split("\r\n");
    let request: Vec<&str> = lines.next()?.split(' ').collect();
    let &["GET", path, "HTTP/1.1"] = request.as_slice() else {
        return None;
    };
    let mut headers = HashMap::new();
    for line in lines.filter(|line| !line.is_empty()) {
        let (name, value) = line.split_once(':')?;
        // A header that comes twice could be read in two ways.
        let name = name.to_ascii_lowercase();
        if headers.insert(name, value.trim().into()).is_some() {
            return None;
        }
    }
    let path = path.into();
    Some(Head { path, headers })
}

#[cfg(test)]
mod tests {
    use super::*;
    use std::io::Write;

    #[test]
    fn head_is_parsed_or_refused() {
        let head = parse(b"GET /a HTTP/1.1\r\nHost: b:1\r\nORIGIN: http://b\r\n\r\n").unwrap();
        assert_eq!(
            (head.path.as_str(), head.header("host")),
            ("/a", Some("b:1"))
        );
        assert_eq!(head.header("origin"), Some("http://b"));
        for wrong in [
            "POST / HTTP/1.1\r\n\r\n",
            "GET /\r\n\r\n",
            "GET / HTTP/1.1\r\nHost\r\n\r\n",
            "GET / HTTP/1.1\r\nHost: a\r\nhost: b\r\n\r\n",
        ] {
            assert_eq!(parse(wrong.as_bytes()), None, "{wrong}");
        }
        let (mut client, server) = UnixStream::pair().unwrap();
        client.write_all(&[b'a'; MAX_HEAD + 1]).unwrap();
        assert_eq!(
            read_head(&server).unwrap_err().kind(),
            ErrorKind::InvalidData
        );
    }
}

//! The head of an HTTP request: as much of RFC 9112 as a page of three files needs.

use crate::serve::listener::{GREETING, is_timeout};
use std::collections::HashMap;
use std::io::{self, ErrorKind, Read};
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
pub fn read_head(stream: &mut impl Read) -> io::Result<Head> {
    let (mut bytes, ends) = (Vec::new(), Instant::now() + GREETING);
    let mut chunk = [0; 1024];
    while !bytes.ends_with(b"\r\n\r\n") {
        if bytes.len() > MAX_HEAD || Instant::now() > ends {
            return Err(ErrorKind::InvalidData.into());
        }
        match stream.read(&mut chunk) {
            Ok(0) => return Err(ErrorKind::UnexpectedEof.into()),
            Ok(len) => bytes.extend_from_slice(&chunk[..len]),
            Err(cause) if is_timeout(&cause) => {}
            Err(cause) => return Err(cause),
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
        if headers
            .insert(name.to_ascii_lowercase(), value.trim().into())
            .is_some()
        {
            return None;
        }
    }
    let path = path.into();
    Some(Head { path, headers })
}

#[cfg(test)]
mod tests {
    use super::*;

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
        let endless = &mut io::repeat(b'a');
        assert_eq!(
            read_head(endless).unwrap_err().kind(),
            ErrorKind::InvalidData
        );
    }
}

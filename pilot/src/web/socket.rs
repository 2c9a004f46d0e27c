//! A web socket at the server's end (RFC 6455): whole text messages of at most [`MAX_LINE`] bytes.

use crate::serve::listener::Transport;
use crate::serve::protocol::MAX_LINE;
use std::io::{self, ErrorKind, Write};
use std::os::unix::net::UnixStream;
use std::sync::Mutex;

/// Appended to the client's key (section 1.3).
const GUID: &str = "258EAFA5-E914-47DA-95CA-C5AB0DC85B11";
const BASE64: &[u8; 64] = b"ABCDEFGHIJKLMNOPQRSTUVWXYZabcdefghijklmnopqrstuvwxyz0123456789+/";
/// First bytes of final frames (section 5.2).
const TEXT: u8 = 0x81;
const PING: u8 = 0x89;
const PONG: u8 = 0x8A;
const CLOSE: u8 = 0x88;

/// The answer to the key of a handshake: the SHA-1 in base 64 (section 4.2.2).
pub fn accept_key(key: &str) -> String {
    let digest = sha1_smol::Sha1::from(format!("{key}{GUID}")).digest();
    let quartet = |bytes: &[u8]| {
        let part = |index: usize| u32::from(bytes.get(index).copied().unwrap_or_default());
        let bits = part(0) << 16 | part(1) << 8 | part(2);
        let sign =
            move |index: usize| char::from(BASE64[(bits >> (18 - 6 * index) & 0x3F) as usize]);
        let fill = bytes.len() + 1;
        (0..4).map(move |index| if index < fill { sign(index) } else { '=' })
    };
    digest.bytes().chunks(3).flat_map(quartet).collect()
}

/// A web socket after its handshake.
pub struct Socket {
    stream: UnixStream,
    /// The reader answers pings between the writer's messages.
    writing: Mutex<()>,
}

impl Socket {
    /// Over a client's socket.
    pub const fn new(stream: UnixStream) -> Self {
        let writing = Mutex::new(());
        Self { stream, writing }
    }

    fn write(&self, first: u8, payload: &[u8]) -> io::Result<()> {
        let length = payload.len();
        let mut frame = vec![first];
        if let Ok(short @ 0..=125) = u8::try_from(length) {
            frame.push(short);
        } else if let Ok(length) = u16::try_from(length) {
            frame.push(126);
            frame.extend(length.to_be_bytes());
        } else {
            frame.push(127);
            frame.extend((length as u64).to_be_bytes());
        }
        frame.extend(payload);
        let _guard = self.writing.lock();
        (&self.stream).write_all(&frame)
    }

    /// Ends the socket, as the peer expects before the connection goes (section 7.1.1).
    ///
    /// # Errors
    /// The connection's.
    pub fn close(&self) -> io::Result<()> {
        self.write(CLOSE, &[])
    }
}

fn refused() -> io::Error {
    let what = format!("a message is one masked text frame of at most {MAX_LINE} bytes");
    io::Error::other(what)
}

/// The first frame of the bytes, without its mask, and its length; none while it is not complete.
///
/// # Errors
/// What no browser sends here: a fragment, an extension's bit, a frame without mask or too long.
fn parse(bytes: &[u8]) -> io::Result<Option<(u8, Vec<u8>, usize)>> {
    let Some((&[first, second], rest)) = bytes.split_first_chunk() else {
        return Ok(None);
    };
    let (length, rest, head) = match (second & 0x7F, rest.split_first_chunk()) {
        (126, Some((length, rest))) => (usize::from(u16::from_be_bytes(*length)), rest, 4),
        (126, None) => return Ok(None),
        (length, _) => (usize::from(length), rest, 2),
    };
    let whole = first & 0xF0 == 0x80 && second & 0x80 != 0;
    if !whole || second & 0x7F == 127 || length > MAX_LINE {
        return Err(refused());
    }
    let Some((mask, rest)) = rest.split_first_chunk::<4>() else {
        return Ok(None);
    };
    let payload = rest.get(..length);
    Ok(payload.map(|payload| (first, flip(payload, *mask), head + 4 + length)))
}

/// The payload with the mask put on, or taken off again (section 5.3).
fn flip(payload: &[u8], mask: [u8; 4]) -> Vec<u8> {
    let pairs = payload.iter().zip(mask.into_iter().cycle());
    pairs.map(|(byte, mask)| byte ^ mask).collect()
}

impl Transport for Socket {
    fn stream(&self) -> &UnixStream {
        &self.stream
    }

    // Requirement: SERVE-client-1
    fn take(&self, unread: &mut Vec<u8>) -> io::Result<Option<Vec<u8>>> {
        while let Some((first, payload, length)) = parse(unread)? {
            unread.drain(..length);
            match first {
                TEXT => return Ok(Some(payload)),
                PING => self.write(PONG, &payload)?,
                PONG => {}
                CLOSE => return Err(ErrorKind::UnexpectedEof.into()),
                _ => return Err(refused()),
            }
        }
        Ok(None)
    }

    fn send(&self, message: &str) -> io::Result<()> {
        self.write(TEXT, message.as_bytes())
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use proptest::prelude::*;
    use std::io::Read;

    fn masked(first: u8, payload: &[u8]) -> Vec<u8> {
        let mask = [0x37, 0xFA, 0x21, 0x3D];
        let length = u16::try_from(payload.len()).unwrap();
        let mut frame = match u8::try_from(length) {
            Ok(short @ 0..=125) => vec![first, 0x80 | short],
            _ => [&[first, 0xFE][..], &length.to_be_bytes()].concat(),
        };
        frame.extend(mask);
        frame.extend(flip(payload, mask));
        frame
    }

    // RFC 6455, sections 1.3 and 5.7.
    #[test]
    fn key_and_frames_are_those_of_the_standard() {
        let accept = accept_key("dGhlIHNhbXBsZSBub25jZQ==");
        assert_eq!(accept, "s3pPLMBiTxaQ9kYGzzhZRbK+xOo=");
        let hello = [
            0x81, 0x85, 0x37, 0xFA, 0x21, 0x3D, 0x7F, 0x9F, 0x4D, 0x51, 0x58,
        ];
        assert_eq!(parse(&hello).unwrap(), Some((TEXT, b"Hello".to_vec(), 11)));
        for short in 0..hello.len() {
            assert_eq!(parse(&hello[..short]).unwrap(), None);
        }
        for wrong in [[0x01, 0x85], [0xC1, 0x85], [0x81, 0x05], [0x81, 0xFF]] {
            assert!(parse(&wrong).is_err(), "{wrong:?}");
        }
        let long = [&[0x81, 0xFE][..], &16_385_u16.to_be_bytes()].concat();
        assert!(parse(&long).is_err());
    }

    #[test]
    fn socket_answers_ping_and_ends_with_close() {
        let (mut client, server) = UnixStream::pair().unwrap();
        let (socket, mut unread) = (Socket::new(server), Vec::new());
        let long = vec![b'a'; 300];
        for frame in [masked(PING, b"p"), masked(TEXT, &long), masked(0x88, b"")] {
            client.write_all(&frame).unwrap();
        }
        let mut receive = || socket.receive(&mut unread, None);
        assert_eq!(receive().unwrap(), Some(long.clone()));
        assert!(receive().is_err());
        socket.send(std::str::from_utf8(&long).unwrap()).unwrap();
        let mut got = [0; 3 + 4];
        client.read_exact(&mut got).unwrap();
        assert_eq!(got, [PONG, 1, b'p', TEXT, 126, 1, 44]);
    }

    proptest! {
        #[test]
        fn parse_of_any_bytes_keeps_the_limits(bytes in proptest::collection::vec(any::<u8>(), 0..300)) {
            if let Ok(Some((_, payload, length))) = parse(&bytes) {
                prop_assert!(payload.len() <= MAX_LINE && length <= bytes.len());
            }
        }
    }
}

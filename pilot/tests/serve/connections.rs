//! Clients that come, stay silent, are refused or dropped.

use crate::{join, serve};
use host_link::error::Error;
use pilot::client::Client;
use pilot::serve::hub::{self, Event, Hub, MAX_CLIENTS, MAX_WITH_NETWORK};
use pilot::serve::listener::{self, GREETING, LineSocket};
use pilot::serve::protocol::{MAX_LINE, Request};
use std::io::{BufRead, BufReader, ErrorKind, Read, Write};
use std::net::{Shutdown, TcpStream};
use std::os::unix::fs::MetadataExt;
use std::os::unix::net::{UnixDatagram, UnixListener, UnixStream};
use std::process::Command;
use std::sync::Mutex;
use std::sync::mpsc::Receiver;
use std::thread::JoinHandle;
use std::time::{Duration, Instant};
use std::{fs, thread};

// Requirement: SERVE-client-2
#[test]
fn reader_that_does_not_read_is_dropped() {
    serve(None, |hub| {
        let (mut slow, mut other) = (join(hub, "slow"), join(hub, "other"));
        slow.request(&Request::Watch { every: 1 }).unwrap();
        while other.status().unwrap().clients > 1 {}
        let mut messages = 0;
        let error = loop {
            match slow.message() {
                Ok(message) => messages += usize::from(message.is_some()),
                Err(error) => break error,
            }
        };
        assert!(matches!(error, Error::Server { .. }));
        // As many as the queue holds, but for replies, and those that came before it was full.
        assert!((500..5000).contains(&messages), "{messages}");
    });
}

// Requirement: SERVE-client-2
#[test]
fn listener_goes_on_after_a_failed_accept() {
    let (hub, _events) = Hub::new();
    let (client, server) = UnixStream::pair().unwrap();
    let accepted = Mutex::new(vec![Some(server), None]);
    let next = move || {
        let next = accepted.lock().unwrap().pop().flatten();
        next.ok_or_else(|| ErrorKind::ConnectionAborted.into())
    };
    let serve = |mut stream: UnixStream, _| stream.write_all(b"a").unwrap();
    listener::accept(&hub, next, serve, |_| ());
    (&client).read_exact(&mut [0]).unwrap();
}

fn hello(token: &str) -> Request {
    Request::Hello {
        version: 1,
        name: "a".into(),
        token: token.into(),
    }
}

/// The request as it is sent.
fn line(request: &Request) -> Vec<u8> {
    [serde_json::to_vec(request).unwrap(), b"\n".to_vec()].concat()
}

/// A connection to a server that asks for this token, its events, and its thread.
fn connected(token: Option<&'static str>) -> (UnixStream, Receiver<Event>, JoinHandle<()>) {
    let (hub, events) = Hub::new();
    let (client, server) = UnixStream::pair().unwrap();
    let serve = move || listener::serve(&LineSocket(server), &hub.admit().unwrap(), token);
    (client, events, thread::spawn(serve))
}

/// What a client gets that sends these bytes, and whether the connection has ended.
fn answer(bytes: &[u8], token: Option<&'static str>) -> String {
    let (mut client, _events, thread) = connected(token);
    // The server may refuse before everything is sent.
    let _ = client.write_all(bytes);
    client.set_read_timeout(Some(GREETING / 4)).unwrap();
    let (begun, mut text) = (Instant::now(), String::new());
    // More bytes do not give it more time.
    while client.read_to_string(&mut text).is_err() && begun.elapsed() < 2 * GREETING {
        let _ = client.write_all(b" ");
    }
    drop(client);
    thread.join().unwrap();
    text
}

// Requirement: SERVE-client-1, SERVE-client-3
#[test]
fn connection_without_a_valid_hello_gets_a_refusal() {
    let hello = |token| line(&hello(token));
    for (bytes, token, reason) in [
        (b"\x00\xFF{}\n".to_vec(), None, "expected"),
        (
            b"{\"do\":\"stop\"}\n".to_vec(),
            None,
            "the first message is `hello`",
        ),
        (vec![b'['; MAX_LINE + 8192], None, "at most 16384 bytes"),
        (
            hello("0123456789abcdef"),
            Some("0123456789abcdeF"),
            "the token is wrong",
        ),
        (hello(""), Some("0123456789abcdef"), "the token is wrong"),
        (vec![], None, "no `hello` came within 5s"),
    ] {
        let text = answer(&bytes, token);
        assert!(text.contains(reason) && text.lines().count() == 1, "{text}");
    }
}

// Requirement: SERVE-client-3
#[test]
fn network_client_without_the_token_is_refused() {
    let (hub, _events) = Hub::new();
    let address = listener::tcp("127.0.0.1:0", &"0123456789abcdef".into(), &hub).unwrap();
    let mut client = TcpStream::connect(address).unwrap();
    client.set_read_timeout(Some(GREETING)).unwrap();
    client.write_all(&line(&hello(""))).unwrap();
    let refusal = BufReader::new(client).lines().next().unwrap().unwrap();
    assert!(refusal.contains("the token is wrong"), "{refusal}");
}

/// A connection whose client has joined and waits for nothing, its events, and its thread.
fn joined() -> (UnixStream, hub::Client, Receiver<Event>, JoinHandle<()>) {
    let (mut client, events, thread) = connected(None);
    client.write_all(&line(&hello(""))).unwrap();
    let Event::Joined(joined) = events.recv().unwrap() else {
        panic!("no client");
    };
    joined.answered();
    (client, joined, events, thread)
}

// Requirement: SERVE-client-2
#[test]
fn idle_connection_of_a_dropped_client_ends() {
    let (mut client, joined, _events, thread) = joined();
    assert!(joined.send(&"reply".into()));
    // Its reader waits for a request by now.
    thread::sleep(Duration::from_millis(50));
    drop(joined);
    let mut text = String::new();
    client.read_to_string(&mut text).unwrap();
    assert!(text.starts_with("reply\n"), "{text}");
    assert!(text.contains("the server has ended"), "{text}");
    thread.join().unwrap();
}

// Requirement: SERVE-drive-2
#[test]
fn client_that_goes_leaves_before_its_request_is_answered() {
    let (mut client, _joined, events, _thread) = joined();
    client.write_all(&line(&Request::Stop)).unwrap();
    let event = || events.recv_timeout(GREETING).unwrap();
    assert!(matches!(event(), Event::Asked(0, Ok(Request::Stop))));
    drop(client);
    assert!(matches!(event(), Event::Left(0)));
}

// Requirement: SERVE-client-3
#[test]
fn robot_is_not_lent_over_a_network() {
    serve(None, |hub| {
        let (client, server) = UnixStream::pair().unwrap();
        let port = hub.admit().unwrap();
        let token = "0123456789abcdef";
        let thread =
            thread::spawn(move || listener::serve(&LineSocket(server), &port, Some(token)));
        let mut answers = BufReader::new(&client).lines();
        for (request, refused) in [(hello(token), false), (Request::Borrow, true)] {
            (&client).write_all(&line(&request)).unwrap();
            let answer = answers.next().unwrap().unwrap();
            let reason = answer.contains("over its Unix socket only");
            assert_eq!(reason, refused, "{answer}");
        }
        client.shutdown(Shutdown::Both).unwrap();
        thread.join().unwrap();
    });
}

// Requirement: SERVE-client-3
#[test]
fn socket_is_for_owner_and_group_and_takes_no_other_files_place() {
    let (hub, _events) = Hub::new();
    let folder = tempfile::tempdir().unwrap();
    let path = folder.path().join("socket");
    fs::write(&path, "notes").unwrap();
    assert!(matches!(
        listener::unix(&path, &hub),
        Err(Error::Unwritable { .. })
    ));
    assert_eq!(fs::read_to_string(&path).unwrap(), "notes");
    fs::remove_file(&path).unwrap();
    // What a killed server leaves is replaced.
    drop(UnixListener::bind(&path).unwrap());
    assert!(matches!(Client::connect(&path, "a"), Ok(None)));
    // A socket that may not be used is named with its group.
    let other = folder.path().join("other");
    let _socket = UnixDatagram::bind(&other).unwrap();
    let refused = Client::connect(&other, "a").err().unwrap().to_string();
    let group = Command::new("stat")
        .args(["-c", "%G"])
        .arg(&other)
        .output()
        .unwrap();
    let group = String::from_utf8(group.stdout).unwrap();
    assert!(
        refused.ends_with(&format!("join the group {}", group.trim())),
        "{refused}"
    );
    let socket = listener::unix(&path, &hub).unwrap_or_else(|why| panic!("{why}"));
    assert_eq!(fs::metadata(&path).unwrap().mode() & 0o777, 0o660);
    drop(socket);
    assert!(!path.exists());
}

// Requirement: SERVE-client-2
#[test]
fn socket_client_that_does_not_read_loses_its_place() {
    serve(None, |hub| {
        let folder = tempfile::tempdir().unwrap();
        let path = folder.path().join("socket");
        let _socket = listener::unix(&path, hub);
        let mut client = UnixStream::connect(&path).unwrap();
        for request in [hello(""), Request::Watch { every: 1 }] {
            client.write_all(&line(&request)).unwrap();
        }
        // It watches.
        let mut answers = BufReader::new(&client).lines();
        while !answers.next().unwrap().unwrap().contains("map") {}
        assert_eq!(free_places(hub), MAX_CLIENTS - 1);
        // A network cannot take the places of this computer's clients.
        assert_eq!(free_places(&hub.of_network()), MAX_WITH_NETWORK - 1);
        let ends = Instant::now() + Duration::from_secs(10);
        while free_places(hub) != MAX_CLIENTS {
            assert!(Instant::now() < ends);
            thread::sleep(Duration::from_millis(50));
        }
    });
}

fn free_places(hub: &Hub) -> usize {
    let ports: Vec<_> = (0..=MAX_CLIENTS).map_while(|_| hub.admit()).collect();
    ports.len()
}

//! The control loop and its clients on a board in memory.

use fw_core::eeprom::{Image, fields};
use fw_core::wire::{Command, Mode, Order};
use host_link::board_io::Interrupt;
use host_link::eeprom::{self, journal::Journal};
use host_link::error::Error;
use host_link::mock_board::{Shared, mock_board};
use host_link::session::{CommandRequest, Session, VelocityRequest};
use pilot::borrowed::Borrowed;
use pilot::client::Client;
use pilot::serve::control::{self, Options};
use pilot::serve::hub::{Event, Hub, MAX_CLIENTS};
use pilot::serve::listener::{self, Lines};
use pilot::serve::protocol::{Activity, MAX_LINE, Message, Request};
use std::io::{Read, Write};
use std::os::unix::net::UnixStream;
use std::thread;
use std::time::{Duration, Instant};

/// Serves a board in Guarded Velocity while the scenario runs; every command that the board got.
fn serve(speed: Option<f64>, scenario: impl FnOnce(&Hub) + Send) -> Vec<Command> {
    let board = serve_journaled(speed, None, scenario);
    std::mem::take(&mut board.borrow_mut().commands)
}

/// The same with the journal of the server; the board.
fn serve_journaled(
    speed: Option<f64>,
    journal: Option<Journal>,
    scenario: impl FnOnce(&Hub) + Send,
) -> Shared {
    let (hub, events) = Hub::new();
    let image = Image::FIRST_BOARD.with(fields::MODE, Mode::GuardedVelocity.code().into());
    let (board, mut io) = mock_board(&image, None);
    let end = io.interrupt.raised_on_drop();
    let options = Options {
        rate_hz: 40,
        ready_timeout_ms: 100,
        speed,
        journal,
    };
    thread::scope(|scope| {
        let scenario = scope.spawn(move || {
            let _end = end;
            scenario(&hub);
        });
        control::run(&mut io, &options, events).unwrap();
        scenario.join().unwrap();
    });
    board
}

const EXPLORE: Request = Request::Explore { lease_ms: 2000 };

fn join(hub: &Hub, name: &str) -> Client {
    Client::local(hub.admit().unwrap(), name).unwrap()
}

fn drive(forward_mm_s: f64, lease_ms: u32) -> Request {
    Request::Drive {
        forward_mm_s,
        yaw_rate_deg_s: 0.0,
        lease_ms,
    }
}

fn time_us(client: &mut Client) -> u64 {
    client.status().unwrap().robot.time_us
}

/// Waits until the client's motion has ended; why it ended.
fn end_of_motion(client: &mut Client) -> String {
    loop {
        if let Some(Message::Done { error, .. }) = client.message().unwrap() {
            return error.map_or_else(String::new, |error| error.text);
        }
    }
}

/// Frames from the last one that drives until the stop order, and the speeds of those that drove.
fn stops(commands: &[Command]) -> (usize, Vec<i32>) {
    let mut speeds: Vec<_> = commands
        .iter()
        .map(|command| command.velocity.forward)
        .collect();
    let last = speeds.iter().rposition(|&speed| speed != 0).unwrap();
    let stop = commands[last..]
        .iter()
        .position(|command| command.order == Order::Stop);
    speeds.retain(|&speed| speed != 0);
    speeds.dedup();
    (stop.unwrap(), speeds)
}

// Requirement: SERVE-drive-1, SERVE-drive-2
#[test]
fn second_driver_is_refused_until_first_has_gone() {
    let commands = serve(Some(1.0), |hub| {
        let (mut first, mut second) = (join(hub, "first"), join(hub, "second"));
        first.request(&drive(100.0, 5000)).unwrap();
        while first.status().unwrap().activity != Activity::Drive {}
        for request in [
            drive(50.0, 500),
            EXPLORE,
            Request::ClearFaults,
            Request::Keep,
        ] {
            first.request(&Request::Keep).unwrap();
            assert!(second.request(&request).is_err(), "{request:?}");
        }
        let refused = second.request(&drive(50.0, 500)).unwrap_err();
        assert!(
            refused.to_string().contains("first drives the robot"),
            "{refused}"
        );
        assert_eq!(second.status().unwrap().driver.as_deref(), Some("first"));
        drop(first);
        while second.status().unwrap().activity != Activity::Idle {}
        second.request(&drive(50.0, 500)).unwrap();
        let why = end_of_motion(&mut second);
        assert!(why.contains("the lease of second has ended"), "{why}");
    });
    assert_eq!(stops(&commands), (1, vec![100_000, 50_000]));
}

// Requirement: SERVE-drive-2
#[test]
fn lease_without_renewal_ends_in_a_stop() {
    const LEASE_MS: u32 = 1000;
    let commands = serve(Some(1.0), |hub| {
        let mut client = join(hub, "client");
        // Where this computer pauses for longer than the lease, it is taken again.
        let renewed = loop {
            client.request(&drive(100.0, LEASE_MS)).unwrap();
            thread::sleep(Duration::from_millis(200));
            let renewed = Instant::now();
            if client.request(&Request::Keep).is_ok() {
                break renewed;
            }
            end_of_motion(&mut client);
        };
        let why = end_of_motion(&mut client);
        assert!(why.contains("the lease of client has ended"), "{why}");
        assert!(renewed.elapsed() >= Duration::from_millis(LEASE_MS.into()));
    });
    assert_eq!(stops(&commands), (1, vec![100_000]));
}

// Requirement: SERVE-drive-1
#[test]
fn stop_of_a_watching_client_ends_each_motion() {
    let goto = Request::Goto {
        x_mm: 1000.0,
        y_mm: 0.0,
        rotation_deg: Some(0.0),
        lease_ms: 5000,
    };
    let commands = serve(Some(1.0), |hub| {
        let (mut driver, mut watcher) = (join(hub, "driver"), join(hub, "watcher"));
        for (motion, activity) in [
            (drive(100.0, 5000), Activity::Drive),
            (goto, Activity::Goto),
            (EXPLORE, Activity::Explore),
        ] {
            driver.request(&motion).unwrap();
            while watcher.status().unwrap().activity != activity {}
            watcher.request(&Request::Stop).unwrap();
            let why = end_of_motion(&mut driver);
            assert!(why.contains("stopped by watcher"), "{why}");
        }
        // A stop of a robot that stands is sent, too.
        let (before_us, mut now_us) = (time_us(&mut watcher), 0);
        watcher.request(&Request::Stop).unwrap();
        while now_us < before_us + 400_000 {
            now_us = time_us(&mut watcher);
        }
    });
    let ordered = commands
        .iter()
        .filter(|command| command.order == Order::Stop);
    assert_eq!(ordered.count(), 40);
}

/// Drives a borrowed robot for some frames, or until it is taken back.
fn drive_borrowed(borrowed: &Borrowed, frames: usize) -> Result<(), Error> {
    let mut io = borrowed.io(Interrupt::new());
    let mut session = Session::open(&mut io, 40, 100)?;
    let velocity = VelocityRequest {
        forward_mm_s: 100.0,
        ..VelocityRequest::default()
    };
    let request = CommandRequest {
        velocity: Some(velocity),
        ..CommandRequest::default()
    };
    (0..frames).try_for_each(|_| session.exchange(&request).map(drop))
}

// Requirement: SERVE-borrow-1, SERVE-drive-1, SERVE-drive-2
#[test]
fn borrowed_robot_is_watched_and_stopped_for_each() {
    for vanishes in [false, true] {
        let commands = serve(Some(1.0), |hub| {
            let mut watcher = join(hub, "watcher");
            let borrowed = Borrowed::new(join(hub, "tour")).unwrap();
            let refused = watcher.request(&Request::Borrow).unwrap_err();
            assert!(refused.to_string().contains("tour drives"), "{refused}");
            drive_borrowed(&borrowed, 12).unwrap();
            let seen = watcher.status().unwrap();
            assert_eq!(seen.activity, Activity::Command);
            assert!(seen.robot.link.accepted >= 8, "{:?}", seen.robot.link);
            if vanishes {
                drop(borrowed);
                while watcher.status().unwrap().activity != Activity::Idle {}
                return;
            }
            watcher.request(&Request::Stop).unwrap();
            assert!(drive_borrowed(&borrowed, 1000).is_err());
            let why = borrowed.give_back().unwrap_err().to_string();
            assert_eq!(why, "stopped by watcher");
            watcher.request(&drive(0.0, 500)).unwrap();
        });
        let (frames, speeds) = stops(&commands);
        assert!(frames <= 4 && speeds == [100_000], "{frames}, {speeds:?}");
    }
}

// Requirement: SERVE-borrow-1
#[test]
fn eeprom_write_of_a_vanished_borrower_is_undone() {
    let path = std::env::temp_dir().join(format!("robot-lent-{}", std::process::id()));
    let journal = Journal::new(&path);
    let written = Image::FIRST_BOARD.with(fields::MODE, Mode::GuardedNormal.code().into());
    let board = serve_journaled(None, Some(journal.clone()), |hub| {
        let borrowed = Borrowed::new(join(hub, "eeprom")).unwrap();
        let mut io = borrowed.io(Interrupt::new());
        let done = eeprom::program(&mut io, &written, 100, Some(&journal), |_| ()).unwrap();
        assert!(done.bytes > 0);
        borrowed.give_back().unwrap();
        let borrowed = Borrowed::new(join(hub, "eeprom")).unwrap();
        let mut io = borrowed.io(Interrupt::new());
        journal.begin(&written).unwrap();
        io.set_select(true).unwrap();
        io.delay.delay_ms(1);
        io.set_protect(false).unwrap();
        io.i2c.write(0x50, &[0, 0, 1, 2, 3]).unwrap();
        drop((io, borrowed));
        let mut watcher = join(hub, "watcher");
        while watcher.status().unwrap().robot.mode != Mode::GuardedNormal.name()
            || journal.unfinished()
        {}
    });
    let board = board.borrow();
    assert!(board.memory == written && board.protected && !board.selected);
    assert!(!path.exists());
}

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
fn hub_admits_a_bounded_number_of_clients() {
    let (hub, _events) = Hub::new();
    let mut ports: Vec<_> = (0..MAX_CLIENTS).map(|_| hub.admit().unwrap()).collect();
    assert!(hub.admit().is_none());
    ports.pop();
    assert!(hub.admit().is_some());
}

/// What a client gets that sends these bytes, and whether the connection has ended.
fn answer(bytes: &[u8], token: Option<&'static str>) -> String {
    let (hub, _events) = Hub::new();
    let (mut client, server) = UnixStream::pair().unwrap();
    let thread = thread::spawn(move || {
        listener::serve(&Lines(server), &hub.admit().unwrap(), token);
    });
    // The server may refuse before everything is sent.
    let _ = client.write_all(bytes);
    let mut text = String::new();
    let _ = client.read_to_string(&mut text);
    thread.join().unwrap();
    text
}

// Requirement: SERVE-client-1, SERVE-client-3
#[test]
fn connection_without_a_valid_hello_gets_a_refusal() {
    let hello = |token: &str| {
        let hello = Request::Hello {
            version: 1,
            name: "a".into(),
            token: token.into(),
        };
        [serde_json::to_vec(&hello).unwrap(), b"\n".to_vec()].concat()
    };
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
    ] {
        let text = answer(&bytes, token);
        assert!(text.contains(reason) && text.lines().count() == 1, "{text}");
    }
}

// Requirement: SERVE-client-2
#[test]
fn idle_connection_of_a_dropped_client_ends() {
    let (hub, events) = Hub::new();
    let (mut client, server) = UnixStream::pair().unwrap();
    let thread = thread::spawn(move || {
        listener::serve(&Lines(server), &hub.admit().unwrap(), None);
    });
    let hello = br#"{"do":"hello","version":1,"name":"a"}"#;
    client.write_all(&[hello, &b"\n"[..]].concat()).unwrap();
    let Event::Joined(joined) = events.recv().unwrap() else {
        panic!("no client");
    };
    assert!(joined.send(&"reply".into()));
    joined.answered();
    // Its reader waits for a request by now.
    thread::sleep(Duration::from_millis(50));
    drop(joined);
    let mut text = String::new();
    client.read_to_string(&mut text).unwrap();
    assert!(text.starts_with("reply\n"), "{text}");
    assert!(text.contains("the server has ended"), "{text}");
    thread.join().unwrap();
}

//! The server on the virtual board: many clients, one driver, real sockets.

use std::array;
use std::thread;
use std::time::Instant;

use host_link::board_io::Interrupt;
use host_link::error::Error;
use pilot::client::Client;
use pilot::serve::listener;
use pilot::serve::protocol::{Message, Request};
use pilot::teleop::{self, DeadMan, Key, Shown};
use robot_tests::serving::{await_motion, serve, stopped_after};
use twin::plant::Sides;

/// Watching clients, and frames that each gets.
const WATCHERS: usize = 20;
const FRAMES: usize = 60;
/// The frame period, and how far a frame may be from it, microseconds.
const PERIOD_US: (u64, u64) = (25_000, 2_000);
/// The stop deadline, microseconds.
const DEADLINE_US: u64 = 250_000;

fn drive() -> Request {
    Request::Drive {
        forward_mm_s: 100.0,
        yaw_rate_deg_s: 0.0,
        lease_ms: 5000,
    }
}

// Requirement: SERVE-client-2
#[test]
fn twenty_watchers_leave_the_frame_period_alone() {
    serve(|hub, _| {
        let folder = tempfile::tempdir().expect("a folder");
        let path = folder.path().join("socket");
        let _socket = listener::unix(&path, hub).expect("a socket");
        let watch = |number: usize| {
            let name = format!("watcher {number}");
            let mut client = Client::connect(&path, &name).unwrap().expect("a server");
            client.request(&Request::Watch { every: 1 }).unwrap();
            let (mut board_us, mut host, mut logs) = (Vec::new(), Vec::new(), 0);
            while board_us.len() < FRAMES {
                match client.message().unwrap() {
                    Some(Message::Frame(frame)) => {
                        board_us.push(frame.robot.time_us);
                        host.push(Instant::now());
                    }
                    // A line a second.
                    Some(Message::Log { .. }) => logs += 1,
                    _ => {}
                }
            }
            assert!(logs > 0, "no line of the log");
            (board_us, host)
        };
        let seen: [_; WATCHERS] = thread::scope(|scope| {
            let watchers = array::from_fn(|number| scope.spawn(move || watch(number)));
            watchers.map(|watcher| watcher.join().unwrap())
        });
        for (board_us, _) in &seen {
            for pair in board_us.windows(2) {
                let off_us = (pair[1] - pair[0]).abs_diff(PERIOD_US.0);
                assert!(off_us <= PERIOD_US.1, "{off_us} us, or a frame is missing");
            }
        }
        let mut host: Vec<_> = seen[0].1.windows(2).map(|pair| pair[1] - pair[0]).collect();
        host.sort();
        println!(
            "between two frames on this computer: median {:?}, worst {:?}",
            host[FRAMES / 2],
            host[FRAMES - 2]
        );
    });
}

// Requirement: SERVE-drive-1, SERVE-drive-2
#[test]
fn driver_that_is_gone_or_stopped_stops_the_wheels() {
    serve(|hub, board| {
        let folder = tempfile::tempdir().expect("a folder");
        let path = folder.path().join("socket");
        let _socket = listener::unix(&path, hub).expect("a socket");
        let connect = |name| Client::connect(&path, name).unwrap().expect("a server");
        let mut watcher = connect("watcher");
        let refused = |client: &mut Client| match client.request(&drive()) {
            Err(Error::Server { text, .. }) => text,
            other => panic!("{other:?}"),
        };

        let mut driver = connect("driver");
        driver.request(&drive()).unwrap();
        await_motion(board);
        let text = refused(&mut watcher);
        assert!(text.contains("driver drives the robot"), "{text}");
        let since_us = board.now_us();
        drop(driver);
        let gone_us = stopped_after(board, since_us);

        let mut driver = connect("driver");
        while driver.request(&drive()).is_err() {}
        await_motion(board);
        let since_us = board.now_us();
        watcher.request(&Request::Stop).unwrap();
        let stopped_us = stopped_after(board, since_us);
        println!(
            "wheels stop {gone_us} us after their driver has gone, {stopped_us} us after a stop"
        );
        assert!(
            gone_us <= DEADLINE_US && stopped_us <= DEADLINE_US,
            "{gone_us}, {stopped_us}"
        );
    });
}

// Requirement: SERVE-teleop-1
#[test]
fn released_key_and_leaving_stop_the_wheels() {
    serve(|hub, board| {
        let port = hub.admit().expect("a place");
        let mut client = Client::local(port, "teleop", &Interrupt::new()).expect("joined");
        for (leaves, limit_us) in [(false, 1_000_000), (true, DEADLINE_US)] {
            let mut since_us = None;
            let dead_man = Some(DeadMan::new(150.0, 45.0, None));
            let turn = |shown: Shown<'_>| {
                if let Shown::Refused(why) = shown {
                    panic!("{why}");
                }
                let duty = board.truth().duty;
                let turns = duty.left != 0.0 && duty.right != 0.0;
                Ok(match since_us {
                    None if !turns => vec![Key::Ahead],
                    None => {
                        since_us = Some(board.now_us());
                        leaves.then_some(Key::Leave).into_iter().collect()
                    }
                    Some(_) if duty == Sides::default() => vec![Key::Leave],
                    Some(_) => vec![],
                })
            };
            teleop::run(&mut client, &Interrupt::new(), dead_man, turn).expect("driven");
            let stopped_us = stopped_after(board, since_us.expect("moved"));
            println!("wheels stop {stopped_us} us after the last key; leaving: {leaves}");
            assert!(stopped_us <= limit_us, "{stopped_us} us, leaving: {leaves}");
        }
    });
}

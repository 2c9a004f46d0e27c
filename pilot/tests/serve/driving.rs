//! Who drives, what ends a motion, the map.

use crate::{EXPLORE, Served, drive, end_of_motion, in_mode, join, serve, stops, time_us};
use fw_core::types::Faults;
use fw_core::wire::{Command, Mode, Order, State};
use host_link::board_io::Interrupt;
use host_link::error::Exit;
use host_link::mock_board::OnCommand;
use pilot::client::Client;
use pilot::gamepad::Gamepad;
use pilot::serve::protocol::{Activity, Message, Request};
use pilot::teleop::{self, DeadMan, Key, Shown};
use std::io::Write;
use std::os::fd::AsRawFd;
use std::sync::Arc;
use std::sync::atomic::{AtomicI32, Ordering};
use std::thread;
use std::time::{Duration, Instant};

/// A metre ahead, with a direction to a pose, without one by a plan.
fn goto(rotation_deg: Option<f64>) -> Request {
    Request::Goto {
        x_mm: 1000.0,
        y_mm: 0.0,
        rotation_deg,
        lease_ms: 5000,
    }
}

/// The commands that drive ahead or back.
fn driven(commands: &[Command]) -> impl Iterator<Item = &Command> {
    let drives = |command: &&Command| command.velocity.forward != 0;
    commands.iter().filter(drives)
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
            Request::NewMap,
            Request::Keep,
        ] {
            first.request(&Request::Keep).unwrap();
            assert!(second.request(&request).is_err(), "{request:?}");
        }
        let refused = second.request(&drive(50.0, 500)).unwrap_err();
        let text = refused.to_string();
        assert!(text.contains("first drives the robot"), "{text}");
        assert_eq!(refused.exit(), Exit::Busy);
        assert_eq!(second.status().unwrap().driver.as_deref(), Some("first"));
        drop(first);
        let gone = Instant::now();
        while second.status().unwrap().activity != Activity::Idle {}
        // Its lease was for 5 s.
        assert!(gone.elapsed() < Duration::from_secs(3));
        second.request(&drive(50.0, 500)).unwrap();
        // Keys that are refused do not stop it when they are left.
        let mut refused = join(hub, "teleop");
        let leave = |shown: Shown<'_>| match shown {
            Shown::Refused(_) => Ok(vec![Key::Leave]),
            _ => Ok(vec![Key::Ahead]),
        };
        let dead_man = Some(DeadMan::new(150.0, 45.0, None));
        teleop::run(&mut refused, &Interrupt::new(), dead_man, leave).unwrap();
        let why = end_of_motion(&mut second);
        assert!(why.contains("the lease of second has ended"), "{why}");
    });
    assert_eq!(stops(&commands), (1, vec![100_000, 50_000]));
}

// Requirement: SERVE-drive-2
#[test]
fn lease_without_renewal_ends_in_a_stop() {
    // Not the one of a client that asks for none.
    const LEASE_MS: u32 = 1500;
    let commands = serve(Some(1.0), |hub| {
        let mut client = join(hub, "client");
        // Where this computer pauses for longer than the lease, it is taken again.
        let renewed = loop {
            client.request(&drive(100.0, LEASE_MS)).unwrap();
            thread::sleep(Duration::from_millis(200));
            let renewed = Instant::now();
            // Two renewals do not add up.
            if (0..2).all(|_| client.request(&Request::Keep).is_ok()) {
                break renewed;
            }
            end_of_motion(&mut client);
        };
        let why = end_of_motion(&mut client);
        assert!(why.contains("the lease of client has ended"), "{why}");
        let lease = Duration::from_millis(LEASE_MS.into());
        assert!((lease..lease * 2).contains(&renewed.elapsed()));
        // To stand is no error.
        client.request(&drive(0.0, 300)).unwrap();
        assert_eq!(end_of_motion(&mut client), "");
    });
    assert_eq!(stops(&commands), (1, vec![100_000]));
}

// Requirement: SERVE-drive-1
#[test]
fn stop_of_a_watching_client_ends_each_motion() {
    let commands = serve(Some(1.0), |hub| {
        let (mut driver, mut watcher) = (join(hub, "driver"), join(hub, "watcher"));
        for (motion, activity) in [
            (drive(100.0, 5000), Activity::Drive),
            (goto(Some(0.0)), Activity::Goto),
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
    let is_stop = |command: &Command| command.order == Order::Stop;
    assert_eq!(
        commands.iter().filter(|command| is_stop(command)).count(),
        40
    );
    // The second motion is straight ahead.
    let (_, rest) = commands.split_at(commands.iter().position(is_stop).unwrap());
    let (_, rest) = rest.split_at(rest.iter().position(|one| !is_stop(one)).unwrap());
    let goto = rest.split(is_stop).next().unwrap_or_default();
    assert!(goto.iter().any(|one| one.velocity.forward > 0));
    assert!(goto.iter().all(|one| one.velocity.yaw_rate == 0));
}

// Requirement: SERVE-drive-1
#[test]
fn handle_that_is_held_does_not_drive_on_after_a_stop() {
    serve(Some(1.0), |hub| {
        let (mut driver, mut watcher) = (join(hub, "teleop"), join(hub, "watcher"));
        driver.request(&drive(100.0, 5000)).unwrap();
        watcher.request(&Request::Stop).unwrap();
        for _ in 0..20 {
            let held = driver.request(&drive(100.0, 400)).unwrap_err();
            assert!(held.to_string().contains("let go"), "{held}");
            assert!(watcher.status().unwrap().driver.is_none());
            thread::sleep(Duration::from_millis(100));
        }
        // Zeros come from a handle at rest.
        for _ in 0..12 {
            let _ = driver.request(&drive(0.0, 400));
            thread::sleep(Duration::from_millis(50));
        }
        driver.request(&drive(100.0, 400)).unwrap();
        // Its own stop is no other client's.
        driver.request(&Request::Stop).unwrap();
        driver.request(&drive(100.0, 400)).unwrap();
    });
}

// Requirement: SERVE-drive-1
#[test]
fn stop_ends_the_motion_that_waits_for_the_next_frame() {
    let commands = serve(Some(1.0), |hub| {
        let mut watcher = join(hub, "watcher");
        let [driver, stopper] = ["driver", "stopper"].map(|name| {
            let port = hub.admit().unwrap();
            let received = port.join(name.into());
            (port, received)
        });
        driver.0.ask(Ok(drive(100.0, 5000)));
        while watcher.status().unwrap().activity != Activity::Drive {}
        // Both before the next frame.
        driver.0.ask(Ok(goto(Some(0.0))));
        stopper.0.ask(Ok(Request::Stop));
        while watcher.status().unwrap().activity != Activity::Idle {}
        let rest_us = time_us(&mut watcher);
        while time_us(&mut watcher) < rest_us + 200_000 {}
        driver.0.ask(Ok(Request::Borrow));
        stopper.0.ask(Ok(Request::Stop));
        let messages = &driver.1.0;
        let mut answers = std::iter::from_fn(|| messages.recv_timeout(Duration::from_secs(3)).ok());
        assert!(answers.any(|one| one.contains("reply") && one.contains("stopped by stopper")));
    });
    // The way to the pose would be driven at other speeds.
    assert_eq!(stops(&commands), (1, vec![100_000]));
}

#[test]
fn velocity_and_plans_are_refused_in_a_mode_without_velocity() {
    let served = Served {
        eeprom: in_mode(Mode::GuardedNormal),
        ..Served::at(Some(1.0))
    };
    served.run(|hub| {
        let mut client = join(hub, "client");
        for request in [drive(100.0, 5000), goto(None), EXPLORE] {
            let refused = client.request(&request).unwrap_err().to_string();
            assert!(refused.contains("velocity to drive at"), "{refused}");
            assert_eq!(client.status().unwrap().driver, None);
        }
    });
}

#[test]
fn fault_ends_a_velocity_until_it_is_cleared() {
    let mut is_stopped = true;
    let stalls: OnCommand = Box::new(move |command, report| {
        is_stopped &= command.order != Order::Resume;
        if is_stopped {
            report.state = State::Stopped;
        } else if command.velocity.forward != 0 {
            (report.state, report.faults) = (State::Faulted, Faults::LEFT_STALLED);
        } else if report.faults.difference(command.clear_faults).is_empty() {
            (report.state, report.faults) = (State::Ready, Faults::NONE);
        }
    });
    let served = Served {
        on_command: Some(stalls),
        ..Served::at(Some(1.0))
    };
    let board = served.run(|hub| {
        let mut client = join(hub, "client");
        client.request(&drive(100.0, 5000)).unwrap();
        let why = end_of_motion(&mut client);
        assert!(why.contains("left-stalled"), "{why}");
        let is_faulted = |client: &mut Client| {
            let state = client.status().unwrap().robot.state;
            state == Some(State::Faulted.name())
        };
        assert!(is_faulted(&mut client));
        let faulted_us = time_us(&mut client);
        let advised = |text: &String| text.contains("the left wheel does not follow");
        while !client.status().unwrap().advice.iter().any(advised) {
            assert!(time_us(&mut client) < faulted_us + 2_000_000);
        }
        client.request(&Request::ClearFaults).unwrap();
        let asked_us = time_us(&mut client);
        while is_faulted(&mut client) {
            assert!(time_us(&mut client) < asked_us + 1_000_000);
        }
    });
    let commands = std::mem::take(&mut board.borrow_mut().commands);
    let (frames, speeds) = stops(&commands);
    assert!(frames <= 3 && speeds == [100_000], "{frames}, {speeds:?}");
    assert!(driven(&commands).all(|command| command.clear_faults == Faults::SLIP));
}

// Requirement: SERVE-drive-1
#[test]
fn motion_of_the_driver_replaces_its_last_one() {
    serve(Some(1.0), |hub| {
        let mut driver = join(hub, "driver");
        for (motion, activity) in [
            (drive(100.0, 5000), Activity::Drive),
            (EXPLORE, Activity::Explore),
            (drive(100.0, 5000), Activity::Drive),
        ] {
            let asked_us = time_us(&mut driver);
            driver.request(&motion).unwrap();
            while driver.status().unwrap().activity != activity {
                // The lease of the first was for 5 s, of the second for 2 s.
                assert!(time_us(&mut driver) < asked_us + 1_000_000);
            }
            let refused = driver.request(&Request::NewMap).is_err();
            assert_eq!(refused, activity == Activity::Explore);
        }
        driver.request(&Request::Stop).unwrap();
        while !end_of_motion(&mut driver).contains("stopped by driver") {}
        join(hub, "other").request(&drive(0.0, 500)).unwrap();
    });
}

// Requirement: SERVE-teleop-1
#[test]
fn teleop_stops_by_its_key_and_where_its_terminal_hangs() {
    for (hangs, expected) in [
        (false, "stopped by teleop"),
        (true, "the lease of teleop has ended"),
    ] {
        let commands = serve(Some(1.0), |hub| {
            let mut client = join(hub, "teleop");
            let (mut drives, mut ended) = (false, String::new());
            let turn = |shown: Shown<'_>| {
                let key = match shown {
                    Shown::Message(Message::Frame(frame)) if frame.activity == Activity::Drive => {
                        let first = !std::mem::replace(&mut drives, true);
                        if hangs {
                            thread::sleep(Duration::from_secs(u64::from(first)));
                            return Ok(vec![]);
                        }
                        Key::Stop
                    }
                    Shown::Message(Message::Done { error, .. }) => {
                        ended = error.as_ref().map_or("", |error| &error.text).into();
                        Key::Leave
                    }
                    _ if drives => return Ok(vec![]),
                    _ => Key::Ahead,
                };
                Ok(vec![key])
            };
            let dead_man = Some(DeadMan::new(150.0, 45.0, None));
            teleop::run(&mut client, &Interrupt::new(), dead_man, turn).unwrap();
            assert!(ended.contains(expected), "{ended}");
        });
        // For less than 750 ms, by the lease of 400 ms.
        assert!(driven(&commands).count() <= 30);
    }
}

// Requirement: SERVE-teleop-1
#[test]
fn teleop_stops_by_a_button_of_the_gamepad() {
    serve(Some(1.0), |hub| {
        let mut client = join(hub, "teleop");
        let (reader, mut events) = std::io::pipe().unwrap();
        let path = format!("/proc/self/fd/{}", reader.as_raw_fd());
        let gamepad = Gamepad::open(path.as_ref()).unwrap();
        let mut event = |kind, number, [low, high]: [u8; 2]| {
            let event = [0, 0, 0, 0, low, high, kind, number];
            events.write_all(&event).unwrap();
        };
        event(2, 1, i16::MIN.to_ne_bytes());
        let (mut turns, mut ended) = (0, String::new());
        let turn = |shown: Shown<'_>| {
            turns += 1;
            match shown {
                // Once it is seen that it was not held from the beginning on.
                _ if turns == 2 => event(1, 4, [1, 0]),
                Shown::Message(Message::Frame(frame)) if frame.activity == Activity::Drive => {
                    event(1, 0, [1, 0]);
                }
                Shown::Message(Message::Done { error, .. }) => {
                    ended = error.as_ref().map_or("", |error| &error.text).into();
                    return Ok(vec![Key::Leave]);
                }
                _ => {}
            }
            Ok(vec![])
        };
        let dead_man = DeadMan::new(150.0, 45.0, Some(gamepad));
        teleop::run(&mut client, &Interrupt::new(), Some(dead_man), turn).unwrap();
        assert_eq!(ended, "stopped by teleop");
    });
}

/// Whether the map begins again within half a second of frames.
fn new_map(watcher: &mut Client) -> bool {
    let mut frames = 0;
    while frames < 20 {
        match watcher.message().unwrap() {
            Some(Message::Map { .. }) => return true,
            Some(Message::Frame(_)) => frames += 1,
            _ => {}
        }
    }
    false
}

#[test]
fn map_begins_again_after_a_jump_or_when_asked() {
    let x = Arc::new(AtomicI32::new(0));
    let stands = Arc::clone(&x);
    let robot: OnCommand =
        Box::new(move |_, report| report.pose.x = stands.load(Ordering::Relaxed));
    let served = Served {
        on_command: Some(robot),
        ..Served::at(Some(4.0))
    };
    served.run(|hub| {
        let mut watcher = join(hub, "watcher");
        watcher.request(&Request::Watch { every: 1 }).unwrap();
        while new_map(&mut watcher) {}
        // A reset takes the pose to 0; a way of 140 mm may be driven without a frame.
        for (at_mm, begins) in [(140, false), (0, false), (160, true), (0, true)] {
            x.store(1000 * at_mm, Ordering::Relaxed);
            assert_eq!(new_map(&mut watcher), begins, "{at_mm} mm");
        }
        watcher.request(&Request::NewMap).unwrap();
        assert!(new_map(&mut watcher));
    });
}

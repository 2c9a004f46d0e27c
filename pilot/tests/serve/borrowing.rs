//! The robot in the hands of a client.

use crate::{Served, drive, in_mode, join, serve, stops};
use fw_core::eeprom::Image;
use fw_core::wire::Mode;
use host_link::board_io::{BoardIo, Interrupt};
use host_link::eeprom::{self, journal::Journal};
use host_link::error::Error;
use host_link::session::{CommandRequest, Session, VelocityRequest};
use pilot::borrowed::Borrowed;
use pilot::serve::board::Call;
use pilot::serve::protocol::{Activity, Message, Request};
use std::time::{Duration, Instant};

/// Writes to the EEPROM what is no configuration, and leaves bus and protection so.
fn spoil_eeprom(io: &mut BoardIo) {
    io.set_select(true).unwrap();
    (io.delay)(1_000);
    io.set_protect(false).unwrap();
    (io.i2c)(0x50, &[0, 0, 1, 2, 3], &mut []).unwrap();
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
            let call = Call::Reset(false);
            for request in [Request::Board { call }, Request::Return] {
                assert!(watcher.request(&request).is_err(), "{request:?}");
            }
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

// Requirement: SERVE-drive-1
#[test]
fn robot_of_a_borrower_that_waits_is_free_after_a_stop() {
    serve(Some(1.0), |hub| {
        let mut watcher = join(hub, "watcher");
        let borrowed = Borrowed::new(join(hub, "tune")).unwrap();
        watcher.request(&Request::Stop).unwrap();
        let begun = Instant::now();
        while watcher.request(&Request::ClearFaults).is_err() {
            assert!(begun.elapsed() < Duration::from_secs(10));
        }
        assert!(drive_borrowed(&borrowed, 1).is_err());
        let why = borrowed.give_back().unwrap_err().to_string();
        assert_eq!(why, "stopped by watcher");
        // A loan ends with its return alone: there is no lease to renew.
        let mut client = join(hub, "eeprom");
        while client.request(&Request::Borrow).is_err() {}
        assert!(client.request(&Request::Keep).is_err());
        assert!(
            client.request(&Request::Borrow).is_err(),
            "it has it already"
        );
        client.request(&Request::Return).unwrap();
    });
}

// Requirement: SERVE-borrow-1
#[test]
fn eeprom_write_of_a_vanished_borrower_is_undone() {
    let folder = tempfile::tempdir().unwrap();
    let path = folder.path().join("before");
    let journal = Journal::new(&path);
    let written = in_mode(Mode::GuardedNormal);
    let served = Served {
        journal: Some(journal.clone()),
        ..Served::at(None)
    };
    let board = served.run(|hub| {
        let borrowed = Borrowed::new(join(hub, "eeprom")).unwrap();
        let mut io = borrowed.io(Interrupt::new());
        let mut watcher = join(hub, "watcher");
        let mut mode_of_frames = |io: &mut BoardIo| {
            let mut session = Session::open(io, 40, 100).unwrap();
            for _ in 0..8 {
                session.exchange(&CommandRequest::default()).unwrap();
            }
            watcher.status().unwrap().robot.mode
        };
        assert_eq!(mode_of_frames(&mut io), Mode::GuardedVelocity.name());
        let mut onlooker = join(hub, "onlooker");
        onlooker.request(&Request::Watch { every: 100 }).unwrap();
        let done = eeprom::program(&mut io, &written, 100, Some(&journal), |_| ()).unwrap();
        assert!(done.bytes > 0);
        // Those who watch see the new one, too.
        assert_eq!(mode_of_frames(&mut io), Mode::GuardedNormal.name());
        // The reset returns the pose to zero, and a second map is announced.
        let (mut maps, begun) = (0, Instant::now());
        while maps < 2 {
            let message = onlooker.message().unwrap();
            maps += usize::from(matches!(message, Some(Message::Map { .. })));
            assert!(begun.elapsed() < Duration::from_secs(5), "{maps} maps");
        }
        drop(io);
        borrowed.give_back().unwrap();
        let borrowed = Borrowed::new(join(hub, "eeprom")).unwrap();
        let mut io = borrowed.io(Interrupt::new());
        journal.begin(&written).unwrap();
        spoil_eeprom(&mut io);
        drop((io, borrowed));
        let mut watcher = join(hub, "watcher");
        while watcher.status().unwrap().robot.mode != Mode::GuardedNormal.name()
            || journal.unfinished()
        {}
        // Ctrl-C ends the server while its robot is lent.
        std::mem::forget(Borrowed::new(join(hub, "holder")).unwrap());
    });
    let board = board.borrow();
    assert!(board.memory == written && board.protected && !board.selected);
    assert!(!path.exists());
}

// Requirement: SERVE-borrow-1
#[test]
fn unready_robot_is_reset_after_vanished_borrower_only() {
    let folder = tempfile::tempdir().unwrap();
    let journal = Journal::new(folder.path().join("before"));
    for vanishes in [false, true] {
        let served = Served {
            journal: Some(journal.clone()),
            ..Served::at(None)
        };
        let board = served.run(|hub| {
            let mut watcher = join(hub, "watcher");
            let borrowed = Borrowed::new(join(hub, "borrower")).unwrap();
            drive_borrowed(&borrowed, 1).unwrap();
            assert!(watcher.status().unwrap().driver.is_some());
            spoil_eeprom(&mut borrowed.io(Interrupt::new()));
            if vanishes {
                drop(borrowed);
            } else {
                borrowed.give_back().unwrap();
            }
            let why = loop {
                if let Some(error) = watcher.status().unwrap().error {
                    break error;
                }
            };
            assert!(why.contains("READY"), "{why}");
            let refused = watcher.request(&drive(100.0, 500)).unwrap_err();
            assert_eq!(refused.to_string(), why);
            let borrowed = Borrowed::new(join(hub, "borrower")).unwrap();
            borrowed.give_back().unwrap();
            let shown = watcher.status().unwrap();
            assert_eq!((shown.driver, shown.activity), (None, Activity::Idle));
            // A client that watches every seventh frame gets the error too.
            watcher.request(&Request::Watch { every: 7 }).unwrap();
            let begun = Instant::now();
            let is_shown =
                |message| matches!(message, Some(Message::Frame(frame)) if frame.error.is_some());
            while !is_shown(watcher.message().unwrap()) {
                assert!(begun.elapsed() < Duration::from_secs(5));
            }
        });
        assert_eq!(board.borrow().resets, usize::from(vanishes));
    }
}

// Requirement: SERVE-borrow-1
#[test]
fn unready_robot_is_lent_and_configured_while_the_server_waits() {
    let served = Served {
        eeprom: Image::BLANK,
        ..Served::at(None)
    };
    served.run(|hub| {
        let mut watcher = join(hub, "watcher");
        let unknown = watcher.status().unwrap_err().to_string();
        assert!(unknown.contains("no frame yet"), "{unknown}");
        let borrowed = Borrowed::new(join(hub, "eeprom")).unwrap();
        let mut io = borrowed.io(Interrupt::new());
        eeprom::program(&mut io, &in_mode(Mode::GuardedNormal), 100, None, |_| ()).unwrap();
        borrowed.give_back().unwrap();
        while watcher.status().is_err() {}
    });
}

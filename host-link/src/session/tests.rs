//! Frames of a session on the mock board.

mod observation;

use super::*;
use crate::mock_board::{IoFault, mock_board};
use fw_core::eeprom::{FIELDS, Image, fields};
use fw_core::types::{Faults, Velocity};
use fw_core::wire::Mode;

/// The first board's EEPROM with so many cells.
fn image(cells: u8) -> Image {
    let taps = FIELDS.iter().filter(|field| field.tap != 0);
    let image = taps.fold(Image::FIRST_BOARD, |image, tap| image.with(tap, 1000));
    image.with(fields::CELLS, cells.into())
}

/// [`image`] of two cells in this mode.
fn image_in(mode: Mode) -> Image {
    image(2).with(fields::MODE, mode.code().into())
}

// Requirement: DOC-5.2.1-4, WIRE-battery-1
#[test]
fn frames_cycle_cells_unless_one_is_tuned() {
    let (board, mut io) = mock_board(&image(2), None);
    let mut session = Session::open(&mut io, RATE_HZ, 100).unwrap();
    let (cell, voltage) = (1, 740);
    let tune = CellCode { cell, voltage };
    for tune in [None, None, Some(tune), Some(tune), None, None, None] {
        let rest = CommandRequest::default();
        session.exchange(&CommandRequest { tune, ..rest }).unwrap();
    }
    let sent: Vec<_> = board.borrow().commands.iter().map(|c| c.tune).collect();
    let cycled = |cell| CellCode { cell, voltage: 0 };
    assert_eq!(sent[..4], [cycled(0), cycled(1), tune, tune]);
    assert_eq!(sent[4..], [cycled(0), cycled(1), cycled(0)]);
}

// Requirement: WIRE-velocity-1
#[test]
fn velocity_is_sent_by_its_nearest_code() {
    let image = image(1).with(fields::MODE, Mode::GuardedVelocity.code().into());
    let (board, mut io) = mock_board(&image, None);
    let mut session = Session::open(&mut io, RATE_HZ, 100).unwrap();
    let request = |forward_mm_s, yaw_rate_deg_s, sweep_half_width_deg| CommandRequest {
        velocity: Some(VelocityRequest {
            forward_mm_s,
            yaw_rate_deg_s,
            sweep_half_width_deg,
        }),
        ..CommandRequest::default()
    };
    for request in [
        request(123.4567, -90.0, 45.0),
        request(-1e9, 720.0, 999.0),
        CommandRequest::default(),
    ] {
        session.exchange(&request).unwrap();
    }
    let board = board.borrow();
    let sent = board.commands.iter().map(|c| (c.velocity, c.sweep));
    let code = |forward, yaw_rate| Velocity { forward, yaw_rate };
    let first = (code(123_457, -0x4000_0000), 0x2000);
    let limits = (code(i32::MIN, i32::MAX), 0x8000);
    assert!(sent.eq([first, limits, (code(0, 0), 0)]));
}

// Requirement: WIRE-spi-7
#[test]
fn frames_at_any_rate_keep_gap_and_set_up_time() {
    let (board, mut io) = mock_board(&image(2), None);
    let mut session = Session::open(&mut io, 1_000_000, 100).unwrap();
    session.exchange(&CommandRequest::default()).unwrap();
    for _ in 0..5 {
        let ended_us = board.borrow().now_us;
        session.exchange(&CommandRequest::default()).unwrap();
        // A frame takes the mock no time: the gap, the clock's resolution, the set-up time.
        assert_eq!(board.borrow().now_us - ended_us, 20 + 1 + 1);
    }
}

// Requirement: WIRE-rejected-1, WIRE-rejected-4
#[test]
fn rejected_reply_is_counted_and_keeps_last_values() {
    let (board, mut io) = mock_board(&image(2), None);
    board.borrow_mut().report.pose.x = 1_234_000;
    let mut session = Session::open(&mut io, RATE_HZ, 100).unwrap();
    let request = CommandRequest::default();
    for _ in 0..2 {
        assert!(session.exchange(&request).unwrap().is_some());
    }
    let before = (session.snapshot().pose, session.snapshot().cells_v.clone());
    assert_eq!(before.0.map(|pose| pose.x_mm), Some(1234.0));
    board.borrow_mut().report.pose.x = 0;
    board.borrow_mut().garbled_from = 0;
    for rejected in 1..=5 {
        assert_eq!(session.exchange(&request), Ok(None));
        let statistics = session.statistics();
        assert_eq!((statistics.accepted, statistics.rejected), (2, rejected));
        assert_eq!(statistics.causes.get(fw_core::wire::Cause::Key), rejected);
        let now = (session.snapshot().pose, session.snapshot().cells_v.clone());
        assert_eq!(now, before);
    }
    board.borrow_mut().fault = Some(IoFault::BusesFail(0));
    assert!(matches!(session.exchange(&request), Err(Error::Spi(_))));
    assert_eq!(session.statistics().frames, 7);
}

// Requirement: WIRE-ready-3
#[test]
fn wait_for_ready_ends_in_time_or_by_interrupt() {
    let (board, mut io) = mock_board(&Image::BLANK, None);
    let refused = Session::open(&mut io, RATE_HZ, 100).err();
    assert_eq!(refused, Some(Error::NotReady(100)));
    assert_eq!(board.borrow().now_us, 100_000);
    assert_eq!(reset::restart(&mut io, 0), Err(Error::NotReady(0)));
    assert_eq!(board.borrow().now_us, 200_000);
    board.borrow().interrupt.raise();
    let interrupted = Session::open(&mut io, RATE_HZ, 100).err();
    assert_eq!(interrupted, Some(Error::Interrupted));
    let (board, mut io) = mock_board(&image(2), None);
    assert_eq!(reset::restart(&mut io, 100), Ok(0));
    assert_eq!(board.borrow().resets, 1);
}

// Requirement: WIRE-rejected-4
#[test]
fn second_without_valid_reply_is_silence() {
    let (board, mut io) = mock_board(&image(2), None);
    let mut session = Session::open(&mut io, RATE_HZ, 100).unwrap();
    let request = CommandRequest::default();
    let garbled = |from| board.borrow_mut().garbled_from = from;
    let begun_us = board.borrow().now_us;
    for frame in 0..60 {
        session.exchange(&request).unwrap();
        assert_eq!(session.snapshot().time_us - begun_us, frame * 25_000);
        assert_eq!(session.until_next_us(), 24_999);
        // The transfer takes the set-up time of 1 µs.
        assert_eq!(board.borrow().now_us - begun_us, frame * 25_000 + 1);
    }
    garbled(0);
    assert_eq!(session.exchange(&request), Ok(None));
    assert!(session.check_answered(1).is_err() && session.check_answered(2).is_ok());
    garbled(usize::MAX);
    session.exchange(&request).unwrap();
    assert!(session.check_answered(1).is_ok());
    let end = session.statistics();
    assert_eq!((end.frames, end.accepted), (62, 61));
    assert_eq!((end.worst_gap_us, end.worst_transfer_us), (50_000, 1));
    // Normal mode's frames have no number.
    assert_eq!((end.missed, end.round_trip_frames), (None, None));
    // Slots missed by a pause are skipped.
    board.borrow_mut().now_us += SILENCE_TIMEOUT_US;
    let resumed_us = board.borrow().now_us;
    for (frame, from) in [(0, 0), (1, usize::MAX), (2, usize::MAX)] {
        garbled(from);
        session.exchange(&request).unwrap();
        assert_eq!(board.borrow().now_us - resumed_us, frame * 25_000 + 1);
    }
    garbled(0);
    let mut ends = (1..).map(|frame| (frame, session.exchange(&request)));
    let Some((40, Err(Error::Silent { ms, frames, last }))) = ends.find(|(_, end)| end.is_err())
    else {
        panic!("silent after another time");
    };
    assert_eq!((ms, frames), (1000, 40));
    assert!(last.contains("key"), "{last}");
}

// Requirement: WIRE-rejected-4
#[test]
fn ten_replies_without_a_valid_one_are_another_mode() {
    for valid in [0, 1] {
        let (board, mut io) = mock_board(&image(2), None);
        let mut session = Session::open(&mut io, RATE_HZ, 100).unwrap();
        assert!(session.check_answered(1).is_ok());
        board.borrow_mut().garbled_from = valid;
        let request = CommandRequest::default();
        let first = (0..valid).map(|_| session.exchange(&request)).last();
        assert!(first.is_none_or(|reply| reply.unwrap().is_some()));
        for _ in 1..MODE_CHECK_FRAMES {
            assert_eq!(session.exchange(&request), Ok(None));
        }
        let tenth = session.exchange(&request);
        let is_mismatch = matches!(tenth, Err(Error::ModeMismatch { frames: 10, .. }));
        assert_eq!(is_mismatch, valid == 0, "{tenth:?}");
    }
}

#[test]
fn rate_is_kept_by_a_slow_host_and_when_the_configuration_is_read_again() {
    let rates = [(0, 1_000_000), (1, 1_000_000), (40, 25_000), (3, 333_333)];
    // With a clock that takes this long to read, too.
    for (host_us, (rate_hz, period_us)) in [0, 7].map(|us| rates.map(|rate| (us, rate))).concat() {
        let (board, mut io) = mock_board(&image(2), None);
        let clocked = board.clone();
        io.clock = Box::new(move || {
            clocked.borrow_mut().now_us += host_us;
            clocked.borrow().now_us
        });
        let config = crate::settings::decode(&image(2)).unwrap();
        let mut session = Session::with_config(&mut io, config, rate_hz);
        for _ in 0..2 {
            session.exchange(&CommandRequest::default()).unwrap();
            let begun_us = board.borrow().now_us;
            for frame in 1..=20 {
                session.exchange(&CommandRequest::default()).unwrap();
                let off_us = (board.borrow().now_us - begun_us).abs_diff(frame * period_us);
                assert!(off_us <= 7 * host_us, "{rate_hz} Hz: {off_us} µs");
            }
            session = session.reread();
        }
    }
}

#[test]
fn mode_is_confirmed_by_ten_replies_or_one_guarded() {
    for (mode, frames) in [(Mode::Normal, 10), (Mode::GuardedNormal, 1)] {
        let (board, mut io) = mock_board(&image_in(mode), None);
        let mut session = Session::open(&mut io, RATE_HZ, 100).unwrap();
        session.confirm_mode().unwrap();
        assert_eq!(session.statistics().frames, frames, "{mode:?}");
        board.borrow_mut().memory = image(1);
        let mut session = session.reread();
        assert_eq!(session.config().cells(), 1);
        session.io().interrupt.raise();
        let interrupted = session.exchange(&CommandRequest::default());
        assert_eq!(interrupted, Err(Error::Interrupted));
    }
}

#[test]
fn relayed_frame_is_counted_and_its_report_taken_over() {
    let (board, mut io) = mock_board(&image_in(Mode::GuardedNormal), None);
    board.borrow_mut().report.pose.x = 1_234_000;
    let mut session = Session::open(&mut io, RATE_HZ, 100).unwrap();
    let mut frame = [0; fw_core::wire::MAX_FRAME];
    let mut client = fw_core::wire::PiLink::new(session.config().link_setup());
    let len = client.send(&Command::default(), &mut frame);
    let mut ended_us = board.borrow().now_us;
    for (frames, gap_us) in [(1, 0), (2, 21)] {
        let (reply, report) = session.relay(&frame[..len]).unwrap();
        let begun_us = session.snapshot().time_us;
        let before_us = std::mem::replace(&mut ended_us, board.borrow().now_us);
        // The gap, and the set-up time.
        assert_eq!((begun_us - before_us, ended_us - begun_us), (gap_us, 1));
        assert_eq!(client.receive(&reply).ok(), report);
        assert_eq!(session.statistics().frames, frames);
        assert_eq!(session.snapshot().pose.map(|pose| pose.x_mm), Some(1234.0));
    }
    session.exchange(&CommandRequest::default()).unwrap();
    assert_eq!(session.snapshot().time_us - ended_us, 21);
    // A reset shows by the number of the reply.
    (0..20).for_each(|_| drop(session.relay(&frame[..len]).unwrap()));
    assert!(!session.take_restart());
    reset::pulse(session.io()).unwrap();
    (0..20).for_each(|_| drop(session.relay(&frame[..len]).unwrap()));
    assert!(session.take_restart());
}

#[test]
fn stop_sends_ten_frames_that_brake() {
    for (mode, order, target_x) in [
        (Mode::GuardedNormal, Order::Stop, None),
        (Mode::Normal, Order::default(), Some(1_234_000)),
        (Mode::TuneMove, Order::default(), None),
    ] {
        let (board, mut io) = mock_board(&image_in(mode), None);
        board.borrow_mut().report.pose.x = 1_234_000;
        let mut session = Session::open(&mut io, RATE_HZ, 100).unwrap();
        session.wait_for_reply().unwrap();
        session.stop();
        // Silence does not end it early.
        board.borrow_mut().garbled_from = 0;
        board.borrow_mut().now_us += SILENCE_TIMEOUT_US;
        session.stop();
        let sent = board.borrow_mut().commands.split_off(1).into_iter();
        let sent: Vec<_> = sent
            .map(|c| (c.order, c.apply.then_some(c.expected.x), c.percent))
            .collect();
        assert_eq!(sent, [(order, target_x, Binary64(0)); 20], "{mode:?}");
    }
}

#[test]
fn ensure_drivable_stopped_or_faulted_is_an_error_in_guarded_modes() {
    for mode in [Mode::Normal, Mode::GuardedNormal] {
        let (_, mut io) = mock_board(&image_in(mode), None);
        let session = Session::open(&mut io, RATE_HZ, 100).unwrap();
        for (state, stands) in [
            (State::Booting, false),
            (State::Ready, false),
            (State::Moving, false),
            (State::Stopped, true),
            (State::Faulted, true),
        ] {
            let is_refused = session.ensure_drivable(state, Faults::NONE).is_err();
            let expected = stands && mode == Mode::GuardedNormal;
            assert_eq!(is_refused, expected, "{mode:?}, {state:?}");
        }
    }
}

// Requirement: WIRE-status-2, WIRE-deadline-4
#[test]
fn resume_clears_the_lost_link_alone() {
    let image = image_in(Mode::GuardedNormal);
    for (state, other, frames) in [
        (State::Stopped, Faults::SLIP, 3),
        (State::Ready, Faults::SLIP, 3),
        (State::Stopped, Faults::LEFT_STALLED, 41),
    ] {
        let (board, mut io) = mock_board(&image, None);
        board.borrow_mut().report.state = state;
        board.borrow_mut().report.faults = Faults::LINK_LOST | other;
        board.borrow_mut().on_command = Some(Box::new(|command, report| {
            report.faults = report.faults.difference(command.clear_faults);
            if command.order == Order::Resume && !report.faults.intersects(Faults::BLOCKING) {
                report.state = State::Ready;
            }
        }));
        let mut session = Session::open(&mut io, RATE_HZ, 100).unwrap();
        session.confirm_mode().unwrap();
        let resumed = session.resume();
        assert_eq!(resumed.is_ok(), !other.intersects(Faults::BLOCKING));
        assert_eq!(board.borrow().report.faults, other);
        let end = session.statistics();
        assert_eq!((end.missed, end.round_trip_frames), (Some(0), Some(1)));
        assert_eq!(end.round_trip_us, Some(25_001));
        assert_eq!(board.borrow().commands.len(), 1 + frames);
    }
}

// Requirement: WIRE-rejected-1
#[test]
fn resume_goes_on_after_a_rejected_reply() {
    let (board, mut io) = mock_board(&image_in(Mode::GuardedNormal), None);
    board.borrow_mut().report.state = State::Stopped;
    board.borrow_mut().on_command = Some(Box::new(|command, report| {
        if command.order == Order::Resume {
            report.state = State::Ready;
        }
    }));
    let clocked = board.clone();
    io.clock = Box::new(move || {
        let mut board = clocked.borrow_mut();
        let is_second = board.commands.len() == 1;
        board.garbled_from = if is_second { 0 } else { usize::MAX };
        board.now_us
    });
    let mut session = Session::open(&mut io, RATE_HZ, 100).unwrap();
    assert_eq!(session.resume(), Ok(()));
    assert_eq!(session.statistics().rejected, 1);
}

#[test]
fn restart_shows_by_the_number_of_the_next_reply() {
    let (_, mut io) = mock_board(&image_in(Mode::GuardedNormal), None);
    let mut session = Session::open(&mut io, RATE_HZ, 100).unwrap();
    for restarts in [false, true] {
        if restarts {
            crate::reset::pulse(session.io()).unwrap();
        }
        (0..10).for_each(|_| drop(session.exchange(&CommandRequest::default())));
        assert_eq!(session.take_restart(), restarts);
    }
}

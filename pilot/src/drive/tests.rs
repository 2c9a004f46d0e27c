//! Whatever ends a drive early, the last command keeps the robot where it is.

use super::*;
use fw_core::eeprom::{Image, fields};
use fw_core::wire::{Command, Mode, Order, State};
use host_link::board_io::BoardIo;
use host_link::mock_board::{IoFault, MockBoard, mock_board};
use std::panic::{AssertUnwindSafe, catch_unwind};

fn image(mode: Mode) -> Image {
    Image::FIRST_BOARD.with(fields::MODE, mode.code().into())
}

const TARGET: Pose = Pose::new(1000.0, -500.0, 90.0);

fn drive(io: &mut BoardIo) -> Result<Arrival, Error> {
    drive_within(io, None)
}

fn drive_within(io: &mut BoardIo, timeout_s: Option<f64>) -> Result<Arrival, Error> {
    let mut session = Session::open(io, 40, 100)?;
    let criteria = ArrivalCriteria {
        timeout_s,
        ..ArrivalCriteria::default()
    };
    go_to(&mut session, TARGET, &criteria, |_| {})
}

/// The last command keeps the robot where it is.
#[track_caller]
fn assert_holds_position(board: &MockBoard) {
    let last: &Command = board.commands.last().expect("frames were sent");
    assert!(last.apply);
    assert_ne!(last.expected, TARGET.code());
}

// Requirement: DOC-3.2-2
#[test]
fn drive_ends_at_its_target() {
    for mode in [Mode::Normal, Mode::GuardedNormal, Mode::GuardedVelocity] {
        let (board, mut io) = mock_board(&image(mode), None);
        // A velocity lasts a frame.
        board.borrow_mut().on_command = Some(Box::new(|command, report| {
            let speeds = [command.velocity.forward, command.velocity.yaw_rate].map(f64::from);
            let turned = speeds[1] / 4_294_967_296.0 * 360.0 * 0.025;
            let step = Pose::new(speeds[0] * 0.025e-3, 0.0, turned);
            report.pose = step.in_frame_of(Pose::from_code(report.pose)).code();
        }));
        let arrival = drive(&mut io).unwrap();
        assert!(arrival.off_mm < 5.0, "{arrival:?}");
        assert!(arrival.off_deg.abs() < 1.0, "{arrival:?}");
        let board = board.borrow();
        let mut orders = board.commands.iter().map(|command| command.order);
        assert!(orders.all(|order| order != Order::Stop));
        // The first frame after that of the resume drives.
        let standing = board.commands[1].velocity == fw_core::types::Velocity::default();
        assert_eq!(standing, mode != Mode::GuardedVelocity);
    }
}

#[test]
fn tour_reports_every_frame_and_each_arrival() {
    let (board, mut io) = mock_board(&image(Mode::Normal), None);
    let mut session = Session::open(&mut io, 40, 100).unwrap();
    let (way, criteria) = ([TARGET, Pose::default()], ArrivalCriteria::default());
    let (mut frames, mut reached) = (0, Vec::new());
    let arrived = |index, arrival: &Arrival| reached.push((index, arrival.off_mm < 5.0));
    tour(&mut session, &way, &criteria, |_| frames += 1, arrived).unwrap();
    assert_eq!(reached, [(0, true), (1, true)]);
    // But for one frame of each resume.
    assert_eq!(frames, board.borrow().commands.len() - 2);
}

#[test]
fn drive_interrupt_stops_robot() {
    for mode in [Mode::Normal, Mode::GuardedNormal] {
        let fault = Some(IoFault::Interrupt(20));
        let (board, mut io) = mock_board(&image(mode), fault);
        assert_eq!(drive(&mut io), Err(Error::Interrupted));
        if mode == Mode::Normal {
            assert_holds_position(&board.borrow());
        } else {
            assert_eq!(stops(&board.borrow()), 10);
        }
    }
}

/// How many stop orders came last.
fn stops(board: &MockBoard) -> usize {
    let orders = board.commands.iter().rev().map(|command| command.order);
    orders.take_while(|&order| order == Order::Stop).count()
}

#[test]
fn drive_fault_on_the_way_stops_robot() {
    let (board, mut io) = mock_board(&image(Mode::GuardedNormal), None);
    let mut frames = 0;
    board.borrow_mut().on_command = Some(Box::new(move |_, report| {
        frames += 1;
        if frames == 5 {
            report.state = State::Faulted;
        }
    }));
    assert!(matches!(drive(&mut io), Err(Error::Fault { .. })));
    let board = board.borrow();
    assert_eq!((board.commands.len(), stops(&board)), (16, 10));
}

#[test]
fn drive_ends_where_the_stm_restarts() {
    for mode in [Mode::Normal, Mode::GuardedVelocity] {
        let (board, mut io) = mock_board(&image(mode), None);
        board.borrow_mut().report.pose = Pose::new(600.0, 0.0, 0.0).code();
        let mut frames = 0;
        board.borrow_mut().on_command = Some(Box::new(move |_, report| {
            frames += 1;
            if frames >= 5 {
                report.pose = Pose::default().code();
            }
        }));
        assert_eq!(drive(&mut io), Err(Error::Restarted));
        // The reply to the next frame shows it.
        assert_eq!(board.borrow().commands.len(), 6 + 10);
    }
}

#[test]
fn robot_without_reports_stands() {
    let (board, mut io) = mock_board(&image(Mode::GuardedVelocity), None);
    board.borrow_mut().garbled_from = 10;
    let mut session = Session::open(&mut io, 40, 100).unwrap();
    // Steered to on the way.
    let aside = Pose::new(1000.0, -50.0, 90.0);
    let driven = go_to(&mut session, aside, &ArrivalCriteria::default(), |_| {});
    assert!(matches!(driven, Err(Error::Silent { .. })));
    let board = board.borrow();
    let velocities = board.commands.iter().map(|command| command.velocity);
    let velocities: Vec<_> = velocities.map(|one| [one.forward, one.yaw_rate]).collect();
    assert!(
        !velocities[17].contains(&0) && velocities[18..].concat().iter().all(|&code| code == 0)
    );
}

#[test]
fn drive_panic_in_callback_stops_robot() {
    let (board, mut io) = mock_board(&image(Mode::Normal), None);
    let outcome = catch_unwind(AssertUnwindSafe(|| {
        let mut session = Session::open(&mut io, 40, 100).unwrap();
        let mut reports = 0;
        go_to(&mut session, TARGET, &ArrivalCriteria::default(), |_| {
            reports += 1;
            assert!(reports < 3, "on purpose");
        })
    }));
    assert!(outcome.is_err());
    assert_holds_position(&board.borrow());
}

#[test]
fn drive_timeout_stops_robot() {
    let (board, mut io) = mock_board(&image(Mode::Normal), None);
    let error = drive_within(&mut io, Some(0.1)).unwrap_err();
    assert!(matches!(error, Error::NotReached { .. }), "{error:?}");
    assert_holds_position(&board.borrow());
}

#[test]
fn drive_key_mismatch_detected_within_ten_frames() {
    let (board, mut io) = mock_board(&image(Mode::Normal), None);
    // The STM booted with another key than the EEPROM holds now.
    board.borrow_mut().memory = image(Mode::Normal).with(fields::KEY_FROM_STM, 0x11);
    let error = drive(&mut io).unwrap_err();
    let Error::ModeMismatch { frames, reason, .. } = error else {
        panic!("{error:?}");
    };
    assert!(frames == 10 && reason.contains("key"), "{reason}");
}

#[test]
fn drive_of_faulted_robot_is_rejected() {
    let (board, mut io) = mock_board(&image(Mode::GuardedNormal), None);
    board.borrow_mut().report.state = State::Faulted;
    board.borrow_mut().report.faults = fw_core::types::Faults::BATTERY_CUTOFF;
    let error = drive(&mut io).unwrap_err();
    let is_fault = matches!(&error, Error::Fault { faults, .. } if faults == "battery-cutoff");
    assert!(is_fault, "{error:?}");
    assert!(board.borrow().commands.iter().all(|command| !command.apply));
}

#[test]
fn drive_in_tuning_mode_or_without_spi_is_rejected() {
    let (_, mut io) = mock_board(&image(Mode::TuneRotate), None);
    assert!(matches!(drive(&mut io), Err(Error::WrongMode { .. })));
    let (_, mut io) = mock_board(&image(Mode::Normal), Some(IoFault::BusesFail(20)));
    assert!(matches!(drive(&mut io), Err(Error::Spi(_))));
}

/// The first frame at which a robot of these poses rests.
fn rests_at(poses: impl IntoIterator<Item = Pose>) -> Option<usize> {
    let (mut rest, frames) = (RestDetector::default(), (0..).step_by(25_000));
    let mut settled = frames.zip(poses).map(|(us, pose)| rest.settled(us, pose));
    settled.position(|settled| settled)
}

#[test]
fn rest_takes_quarter_second_without_creeping() {
    let at = |mm| Pose::new(mm, 0.0, 0.0);
    // 4 mm/s: below the limit from frame to frame, far above it over a quarter second.
    let creeping = (0..400).map(|frame| at(f64::from(frame) * 0.1));
    assert_eq!(rests_at(creeping), None);
    assert_eq!(rests_at([at(0.0); 20]), Some(10));
    let arriving = (0..20).map(|frame| at(if frame < 5 { 1.0 } else { 0.0 }));
    assert_eq!(rests_at(arriving), Some(5 + 10));
    for (mm, deg, rests) in [
        (0.29, 0.0, true),
        (0.31, 0.0, false),
        (0.0, 0.09, true),
        (0.0, 0.11, false),
    ] {
        let poses = [[at(0.0), Pose::new(mm, 0.0, deg)]; 10];
        let settled = rests_at(poses.into_iter().flatten()).is_some();
        assert_eq!(settled, rests, "{mm} mm, {deg} degrees");
    }
    // Full speed, 10 mm/s, and 18 degrees/s.
    for (field, raw, seconds) in [
        (fields::MAX_SPEED, 300, 25.0),
        (fields::MAX_SPEED, 10, 95.0),
        (fields::MAX_YAW_RATE, 65_536 / 20, 50.0),
    ] {
        let config = Config::decode(&Image::FIRST_BOARD.with(field, raw)).unwrap();
        let allowed_s = ArrivalCriteria::default().allowance_s(400.0, &config);
        assert!((allowed_s - seconds).abs() < 0.1, "{allowed_s}");
    }
}

#[test]
fn drive_ends_within_both_tolerances_only() {
    for (mm, degrees, arrives) in [
        (4.9, 0.9, true),
        (5.1, 0.0, false),
        (0.0, 1.1, false),
        (0.0, -1.1, false),
    ] {
        let (board, mut io) = mock_board(&image(Mode::Normal), None);
        let near = Pose::new(mm, 0.0, degrees).in_frame_of(TARGET).code();
        board.borrow_mut().report.pose = near;
        board.borrow_mut().on_command = Some(Box::new(move |_, report| report.pose = near));
        let driven = drive_within(&mut io, Some(2.0));
        assert_eq!(driven.is_ok(), arrives, "{mm} mm, {degrees}°: {driven:?}");
    }
}

#[test]
fn speed_is_measured_ahead_over_the_last_reports() {
    let (mut meter, mut time_s, mut ahead_mm) = (SpeedMeter::default(), 0.0, 0.0);
    for expected in [100.0, -50.0] {
        let mut speed = 0.0;
        for _ in 0..8 {
            time_s += 0.025;
            ahead_mm += expected * 0.025;
            let pose = Pose::new(-0.6 * ahead_mm, 0.8 * ahead_mm, 126.869_897_6);
            speed = meter.update(time_s, pose);
        }
        assert!((speed - expected).abs() < 1e-3, "{speed}");
    }
}

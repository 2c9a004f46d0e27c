//! Whatever ends a drive early, the robot's last orders are to stand where it is.

use super::*;
use crate::board_io::Machine;
use crate::mock_board::{machine, Board, Doubles, Mishap};
use crate::settings::Settings;
use fw_core::eeprom::first_board;
use fw_core::wire::{Command, Mode, Order, State};
use std::panic::{catch_unwind, AssertUnwindSafe};

fn config(mode: Mode) -> Settings {
    let mut config = first_board();
    config.mode = mode;
    Settings {
        config,
        platform_page: true,
    }
}

const TARGET: Place = Place {
    x_mm: 1000.0,
    y_mm: -500.0,
    rotation_deg: 90.0,
};

fn drive(machine: &mut Machine<Doubles>) -> Result<Arrival, Error> {
    let mut session = Session::open(machine, 40, 100)?;
    go_to(&mut session, TARGET, &Terms::default(), |_, _| {})
}

/// The last command keeps the robot where it is.
#[track_caller]
fn assert_told_to_stay(board: &Board) {
    let last: &Command = board.commands.last().expect("frames were sent");
    assert!(last.apply);
    assert_ne!(last.expected, TARGET.code());
}

// Requirement: DOC-3.2-2
#[test]
fn a_drive_ends_at_its_target() {
    let (_, mut machine) = machine(&config(Mode::Normal).image(), None);
    let arrival = drive(&mut machine).unwrap();
    assert!(
        arrival.off_mm < 5.0 && arrival.off_deg.abs() < 1.0,
        "{arrival:?}"
    );
}

#[test]
fn a_guarded_drive_resumes_first_and_ends_at_its_target() {
    let (board, mut machine) = machine(&config(Mode::GuardedNormal).image(), None);
    drive(&mut machine).unwrap();
    assert!(board
        .borrow()
        .commands
        .iter()
        .all(|command| command.order != Order::Stop));
}

#[test]
fn ctrl_c_stops_the_robot() {
    let (board, mut machine) = machine(&config(Mode::Normal).image(), Some(Mishap::Interrupt(20)));
    assert_eq!(drive(&mut machine), Err(Error::Interrupted));
    assert_told_to_stay(&board.borrow());
}

#[test]
fn ctrl_c_brakes_a_guarded_robot() {
    let (board, mut machine) = machine(
        &config(Mode::GuardedNormal).image(),
        Some(Mishap::Interrupt(20)),
    );
    assert_eq!(drive(&mut machine), Err(Error::Interrupted));
    assert_eq!(board.borrow().commands.last().unwrap().order, Order::Stop);
}

#[test]
fn a_panic_while_watching_stops_the_robot() {
    let (board, mut machine) = machine(&config(Mode::Normal).image(), None);
    let outcome = catch_unwind(AssertUnwindSafe(|| {
        let mut session = Session::open(&mut machine, 40, 100).unwrap();
        let mut reports = 0;
        go_to(&mut session, TARGET, &Terms::default(), |_, _| {
            reports += 1;
            assert!(reports < 3, "on purpose");
        })
    }));
    assert!(outcome.is_err());
    assert_told_to_stay(&board.borrow());
}

#[test]
fn too_little_time_is_an_error_that_stops_the_robot() {
    let (board, mut machine) = machine(&config(Mode::Normal).image(), None);
    let mut session = Session::open(&mut machine, 40, 100).unwrap();
    let terms = Terms {
        timeout_s: Some(0.1),
        ..Terms::default()
    };
    let error = go_to(&mut session, TARGET, &terms, |_, _| {}).unwrap_err();
    assert!(matches!(error, Error::NotReached { .. }), "{error:?}");
    assert_told_to_stay(&board.borrow());
}

#[test]
fn a_spi_device_that_fails_is_named() {
    let (_, mut machine) = machine(&config(Mode::Normal).image(), Some(Mishap::BusesDie(20)));
    assert!(matches!(drive(&mut machine), Err(Error::Spi(_))));
}

#[test]
fn a_robot_with_other_keys_is_found_out_within_ten_frames() {
    let (board, mut machine) = machine(&config(Mode::Normal).image(), None);
    // The STM booted with another key than the EEPROM holds now.
    let mut other = config(Mode::Normal);
    other.config.key_from_stm = 0x11;
    board.borrow_mut().memory = other.image();
    let error = drive(&mut machine).unwrap_err();
    assert!(
        matches!(&error, Error::Stranger { frames: 10, why, .. } if why.contains("key")),
        "{error:?}"
    );
}

#[test]
fn a_faulted_robot_is_not_driven() {
    let (board, mut machine) = machine(&config(Mode::GuardedNormal).image(), None);
    board.borrow_mut().report.state = State::Faulted;
    board.borrow_mut().report.faults = fw_core::types::Faults::BATTERY_CUTOFF;
    let error = drive(&mut machine).unwrap_err();
    assert!(
        matches!(&error, Error::Fault { faults, .. } if faults == "battery-cutoff"),
        "{error:?}"
    );
    assert!(board.borrow().commands.iter().all(|command| !command.apply));
}

#[test]
fn a_tuning_mode_cannot_be_driven() {
    let (_, mut machine) = machine(&config(Mode::TuneRotate).image(), None);
    assert!(matches!(drive(&mut machine), Err(Error::WrongMode { .. })));
}

#[test]
fn a_creeping_robot_is_not_at_rest() {
    let mut rest = Rest::default();
    let mut at_rest = false;
    for frame in 0..400_u32 {
        // 4 mm/s: below the limit from frame to frame, far above it over a quarter second.
        let pose = Place {
            x_mm: f64::from(frame) * 0.1,
            ..Place::default()
        };
        at_rest |= rest.settled(u64::from(frame) * 25_000, pose);
    }
    assert!(!at_rest);
}

#[test]
fn a_standing_robot_is_at_rest_after_a_quarter_second() {
    let mut rest = Rest::default();
    let settled = (0..20).position(|frame| rest.settled(frame * 25_000, Place::default()));
    assert_eq!(settled, Some(10));
}

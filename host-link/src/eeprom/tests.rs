//! Every single call fails in turn: the EEPROM must end protected, its bus with the STM, and the STM
//! reset after a write.

use super::repair::{repair, Repaired};
use super::*;
use crate::error::Error;
use crate::mock_board::{mock_board, reconnect, IoFault, MockBoard};
use crate::settings::Settings;
use fw_core::eeprom::{first_board, IMAGE_LEN};
use std::panic::{catch_unwind, AssertUnwindSafe};

const BLANK: Image = [0xFF; IMAGE_LEN];

fn wanted() -> Image {
    Settings {
        config: first_board(),
        platform_page: true,
    }
    .image()
}

fn write(io: &mut crate::board_io::BoardIo) -> Result<Programmed, Error> {
    program(io, &wanted(), 100, None, |_| {})
}

fn calls_of_a_good_write() -> usize {
    let (board, mut io) = mock_board(&BLANK, None);
    write(&mut io).unwrap();
    let calls = board.borrow().calls;
    calls
}

#[track_caller]
fn assert_at_rest(board: &MockBoard, fault: IoFault) {
    assert!(board.protected, "unprotected after {fault:?}");
    assert!(!board.selected, "bus not returned after {fault:?}");
    assert!(!board.in_reset, "held in reset after {fault:?}");
}

// Requirement: DOC-2.1-1, DOC-6-3, DOC-6-7, WIRE-ready-3
#[test]
fn a_good_write_is_verified_protected_and_followed_by_one_reset() {
    let (board, mut io) = mock_board(&BLANK, None);
    let programmed = write(&mut io).unwrap();
    let board = board.borrow();
    assert!(board.memory == wanted());
    assert!(programmed.before == BLANK);
    assert_eq!(board.resets, 1);
    assert_at_rest(&board, IoFault::FailOnce(usize::MAX));
}

#[test]
fn writing_what_is_there_lifts_no_protection_and_writes_nothing() {
    let (_, mut io) = mock_board(&wanted(), None);
    let programmed = write(&mut io).unwrap();
    assert_eq!((programmed.bytes, programmed.bursts), (0, 0));
}

// Requirement: DOC-6-2
#[test]
fn one_failing_call_anywhere_leaves_the_lines_at_rest() {
    for at in 0..calls_of_a_good_write() {
        let fault = IoFault::FailOnce(at);
        let (board, mut io) = mock_board(&BLANK, Some(fault));
        let outcome = write(&mut io);
        let board = board.borrow();
        assert_at_rest(&board, fault);
        assert_eq!(board.resets, 1, "after {fault:?}");
        // One disturbed call is survived everywhere.
        assert!(
            outcome.is_ok() && board.memory == wanted(),
            "{fault:?}: {outcome:?}"
        );
    }
}

// Requirement: DOC-6-2
#[test]
fn a_bus_that_dies_anywhere_is_an_error_and_leaves_the_lines_at_rest() {
    for at in 0..calls_of_a_good_write() {
        let fault = IoFault::BusesFail(at);
        let (board, mut io) = mock_board(&BLANK, Some(fault));
        let outcome = write(&mut io);
        let board = board.borrow();
        assert_at_rest(&board, fault);
        assert_eq!(board.resets, 1, "after {fault:?}");
        match outcome {
            Ok(_) => assert!(board.memory == wanted()),
            Err(error) => assert!(
                matches!(error, Error::Eeprom { .. }),
                "{fault:?}: {error:?}"
            ),
        }
    }
}

#[test]
fn when_nothing_works_any_more_the_error_says_what_was_not_restored() {
    for at in 0..calls_of_a_good_write() {
        let fault = IoFault::AllFail(at);
        let (board, mut io) = mock_board(&BLANK, Some(fault));
        let outcome = write(&mut io);
        let board = board.borrow();
        if !board.protected || board.selected {
            assert!(
                matches!(outcome, Err(Error::NotRestored { .. })),
                "{fault:?}: {outcome:?}"
            );
        }
    }
}

#[test]
fn a_panic_anywhere_leaves_the_lines_at_rest() {
    for at in 0..calls_of_a_good_write() {
        let fault = IoFault::Panic(at);
        let (board, mut io) = mock_board(&BLANK, Some(fault));
        let outcome = catch_unwind(AssertUnwindSafe(|| write(&mut io)));
        assert!(outcome.is_err(), "{fault:?}");
        assert_at_rest(&board.borrow(), fault);
        assert_eq!(board.borrow().resets, 1, "after {fault:?}");
    }
}

#[test]
fn ctrl_c_anywhere_leaves_the_lines_at_rest() {
    for at in 0..calls_of_a_good_write() {
        let fault = IoFault::Interrupt(at);
        let (board, mut io) = mock_board(&BLANK, Some(fault));
        let outcome = write(&mut io);
        let board = board.borrow();
        assert_at_rest(&board, fault);
        assert_eq!(board.resets, 1, "after {fault:?}");
        match outcome {
            Ok(_) => assert!(board.memory == wanted()),
            Err(error) => assert_eq!(error, Error::Interrupted),
        }
    }
}

#[test]
fn reading_resets_nothing_and_leaves_the_lines_at_rest_whatever_fails() {
    for at in 0..20 {
        for fault in [
            IoFault::FailOnce(at),
            IoFault::BusesFail(at),
            IoFault::Interrupt(at),
        ] {
            let (board, mut io) = mock_board(&wanted(), Some(fault));
            let _ = read(&mut io);
            let board = board.borrow();
            assert_at_rest(&board, fault);
            assert_eq!(board.resets, 0, "after {fault:?}");
        }
    }
}

#[test]
fn an_absent_eeprom_is_an_error_within_a_second() {
    let (_, mut io) = mock_board(&BLANK, Some(IoFault::BusesFail(0)));
    let error = read(&mut io).unwrap_err();
    assert!(
        matches!(
            error,
            Error::Eeprom {
                doing: "reading",
                address: 0,
                ..
            }
        ),
        "{error:?}"
    );
    assert!(io.clock.micros() < 1_000_000);
}

#[test]
fn a_journal_stands_while_a_write_runs_and_stays_if_it_is_cut_short() {
    let folder = std::env::temp_dir().join(format!("host-link-journal-{}", std::process::id()));
    let journal = Journal::new(folder.join("before"));
    let (_, mut whole) = mock_board(&BLANK, None);
    program(&mut whole, &wanted(), 100, Some(&journal), |step| {
        assert_eq!(
            journal.unfinished(),
            matches!(step, Progress::Written { .. })
        );
    })
    .unwrap();
    assert!(!journal.unfinished());

    let (_, mut cut) = mock_board(&BLANK, Some(IoFault::BusesFail(30)));
    program(&mut cut, &wanted(), 100, Some(&journal), |_| {}).unwrap_err();
    assert!(journal.unfinished());
    assert!(image::load(journal.path()).unwrap() == BLANK);
    std::fs::remove_dir_all(folder).unwrap();
}

#[test]
fn what_any_failure_left_is_whole_after_the_next_start() {
    let folder = std::env::temp_dir().join(format!("host-link-repair-{}", std::process::id()));
    let journal = Journal::new(folder.join("before"));
    let mut undone = 0;
    for at in 0..calls_of_a_good_write() {
        for fault in [
            IoFault::BusesFail(at),
            IoFault::AllFail(at),
            IoFault::Interrupt(at),
        ] {
            let (board, mut first) = mock_board(&BLANK, Some(fault));
            let outcome = program(&mut first, &wanted(), 100, Some(&journal), |_| {});
            {
                let mut board = board.borrow_mut();
                board.fault = None;
                board.interrupt = crate::board_io::Interrupt::new();
            }
            let repaired = repair(&mut reconnect(&board), &journal, true, 100).unwrap();
            let board = board.borrow();
            assert_at_rest(&board, fault);
            let whole = if repaired == (Repaired::Reset { due: true }) || outcome.is_ok() {
                wanted()
            } else {
                BLANK
            };
            assert!(
                board.memory == whole,
                "{fault:?}: {outcome:?}, {repaired:?}"
            );
            assert!(!journal.unfinished() && !journal.reset_due());
            undone += usize::from(matches!(repaired, Repaired::RolledBack { bytes } if bytes > 0));
        }
    }
    assert!(undone > 50, "{undone}");
    std::fs::remove_dir_all(folder).unwrap();
}

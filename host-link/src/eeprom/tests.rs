//! Every single call fails in turn: the EEPROM must end protected, its bus with the STM, and the STM
//! reset after a write.

use super::repair::{repair, Repaired};
use super::*;
use crate::error::Error;
use crate::mock_board::{again, machine, Board, Mishap};
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

fn write(
    machine: &mut crate::board_io::Machine<crate::mock_board::Doubles>,
) -> Result<Programmed, Error> {
    program(machine, &wanted(), 100, None, |_| {})
}

fn calls_of_a_good_write() -> usize {
    let (board, mut machine) = machine(&BLANK, None);
    write(&mut machine).unwrap();
    let calls = board.borrow().calls;
    calls
}

#[track_caller]
fn assert_at_rest(board: &Board, mishap: Mishap) {
    assert!(board.protected, "unprotected after {mishap:?}");
    assert!(!board.selected, "bus not returned after {mishap:?}");
    assert!(!board.in_reset, "held in reset after {mishap:?}");
}

// Requirement: DOC-2.1-1, DOC-6-3, DOC-6-7, WIRE-ready-3
#[test]
fn a_good_write_is_verified_protected_and_followed_by_one_reset() {
    let (board, mut machine) = machine(&BLANK, None);
    let programmed = write(&mut machine).unwrap();
    let board = board.borrow();
    assert!(board.memory == wanted());
    assert!(programmed.before == BLANK);
    assert_eq!(board.resets, 1);
    assert_at_rest(&board, Mishap::FailOnce(usize::MAX));
}

#[test]
fn writing_what_is_there_lifts_no_protection_and_writes_nothing() {
    let (_, mut machine) = machine(&wanted(), None);
    let programmed = write(&mut machine).unwrap();
    assert_eq!((programmed.bytes, programmed.bursts), (0, 0));
}

// Requirement: DOC-6-2
#[test]
fn one_failing_call_anywhere_leaves_the_lines_at_rest() {
    for at in 0..calls_of_a_good_write() {
        let mishap = Mishap::FailOnce(at);
        let (board, mut machine) = machine(&BLANK, Some(mishap));
        let outcome = write(&mut machine);
        let board = board.borrow();
        assert_at_rest(&board, mishap);
        assert_eq!(board.resets, 1, "after {mishap:?}");
        // One disturbed call is survived everywhere.
        assert!(
            outcome.is_ok() && board.memory == wanted(),
            "{mishap:?}: {outcome:?}"
        );
    }
}

// Requirement: DOC-6-2
#[test]
fn a_bus_that_dies_anywhere_is_an_error_and_leaves_the_lines_at_rest() {
    for at in 0..calls_of_a_good_write() {
        let mishap = Mishap::BusesDie(at);
        let (board, mut machine) = machine(&BLANK, Some(mishap));
        let outcome = write(&mut machine);
        let board = board.borrow();
        assert_at_rest(&board, mishap);
        assert_eq!(board.resets, 1, "after {mishap:?}");
        match outcome {
            Ok(_) => assert!(board.memory == wanted()),
            Err(error) => assert!(
                matches!(error, Error::Eeprom { .. }),
                "{mishap:?}: {error:?}"
            ),
        }
    }
}

#[test]
fn when_nothing_works_any_more_the_error_says_what_was_not_restored() {
    for at in 0..calls_of_a_good_write() {
        let mishap = Mishap::AllDies(at);
        let (board, mut machine) = machine(&BLANK, Some(mishap));
        let outcome = write(&mut machine);
        let board = board.borrow();
        if !board.protected || board.selected {
            assert!(
                matches!(outcome, Err(Error::NotRestored { .. })),
                "{mishap:?}: {outcome:?}"
            );
        }
    }
}

#[test]
fn a_panic_anywhere_leaves_the_lines_at_rest() {
    for at in 0..calls_of_a_good_write() {
        let mishap = Mishap::Panic(at);
        let (board, mut machine) = machine(&BLANK, Some(mishap));
        let outcome = catch_unwind(AssertUnwindSafe(|| write(&mut machine)));
        assert!(outcome.is_err(), "{mishap:?}");
        assert_at_rest(&board.borrow(), mishap);
        assert_eq!(board.borrow().resets, 1, "after {mishap:?}");
    }
}

#[test]
fn ctrl_c_anywhere_leaves_the_lines_at_rest() {
    for at in 0..calls_of_a_good_write() {
        let mishap = Mishap::Interrupt(at);
        let (board, mut machine) = machine(&BLANK, Some(mishap));
        let outcome = write(&mut machine);
        let board = board.borrow();
        assert_at_rest(&board, mishap);
        assert_eq!(board.resets, 1, "after {mishap:?}");
        match outcome {
            Ok(_) => assert!(board.memory == wanted()),
            Err(error) => assert_eq!(error, Error::Interrupted),
        }
    }
}

#[test]
fn reading_resets_nothing_and_leaves_the_lines_at_rest_whatever_fails() {
    for at in 0..20 {
        for mishap in [
            Mishap::FailOnce(at),
            Mishap::BusesDie(at),
            Mishap::Interrupt(at),
        ] {
            let (board, mut machine) = machine(&wanted(), Some(mishap));
            let _ = read(&mut machine);
            let board = board.borrow();
            assert_at_rest(&board, mishap);
            assert_eq!(board.resets, 0, "after {mishap:?}");
        }
    }
}

#[test]
fn an_absent_eeprom_is_an_error_within_a_second() {
    let (_, mut machine) = machine(&BLANK, Some(Mishap::BusesDie(0)));
    let error = read(&mut machine).unwrap_err();
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
    assert!(crate::board_io::Clock::micros(&mut machine.clock) < 1_000_000);
}

#[test]
fn a_journal_stands_while_a_write_runs_and_stays_if_it_is_cut_short() {
    let folder = std::env::temp_dir().join(format!("host-link-journal-{}", std::process::id()));
    let journal = Journal::new(folder.join("before"));
    let (_, mut whole) = machine(&BLANK, None);
    program(&mut whole, &wanted(), 100, Some(&journal), |step| {
        assert_eq!(journal.unfinished(), matches!(step, Step::Written { .. }));
    })
    .unwrap();
    assert!(!journal.unfinished());

    let (_, mut cut) = machine(&BLANK, Some(Mishap::BusesDie(30)));
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
        for mishap in [
            Mishap::BusesDie(at),
            Mishap::AllDies(at),
            Mishap::Interrupt(at),
        ] {
            let (board, mut first) = machine(&BLANK, Some(mishap));
            let outcome = program(&mut first, &wanted(), 100, Some(&journal), |_| {});
            {
                let mut board = board.borrow_mut();
                board.mishap = None;
                board.interrupt = crate::board_io::Interrupt::new();
            }
            let repaired = repair(&mut again(&board), &journal, true, 100).unwrap();
            let board = board.borrow();
            assert_at_rest(&board, mishap);
            let whole = if repaired == (Repaired::Reset { due: true }) || outcome.is_ok() {
                wanted()
            } else {
                BLANK
            };
            assert!(
                board.memory == whole,
                "{mishap:?}: {outcome:?}, {repaired:?}"
            );
            assert!(!journal.unfinished() && !journal.reset_due());
            undone += usize::from(matches!(repaired, Repaired::Undone { bytes } if bytes > 0));
        }
    }
    assert!(undone > 50, "{undone}");
    std::fs::remove_dir_all(folder).unwrap();
}

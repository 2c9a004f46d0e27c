//! Every single call fails in turn: the EEPROM ends protected, its bus with the STM, and the STM reset
//! after a write.

use super::repair::{Repaired, repair};
use super::*;
use crate::board_io::IoError;
use crate::error::Error;
use crate::mock_board::{IoFault, MockBoard, injected, mock_board, reconnect};
use std::os::unix::fs::MetadataExt;
use std::panic::{AssertUnwindSafe, catch_unwind};

const BLANK: Image = Image::BLANK;

fn wanted() -> Image {
    Image::FIRST_BOARD
}

fn write(io: &mut crate::board_io::BoardIo) -> Result<Programmed, Error> {
    program(io, &wanted(), 100, None, |_| {})
}

/// A journal in a folder that does not exist yet, within one of the test's own.
fn journal() -> (tempfile::TempDir, Journal) {
    let folder = tempfile::tempdir().unwrap();
    let journal = Journal::new(folder.path().join("folder/before"));
    (folder, journal)
}

fn calls_of_a_good_write() -> usize {
    let (board, mut io) = mock_board(&BLANK, None);
    write(&mut io).unwrap();
    board.borrow().calls
}

#[track_caller]
fn assert_idle(board: &MockBoard, fault: Option<IoFault>) {
    assert!(board.protected, "unprotected after {fault:?}");
    assert!(!board.selected, "bus not returned after {fault:?}");
    assert!(!board.in_reset, "held in reset after {fault:?}");
}

// Requirement: DOC-2.1-1, DOC-6-3, DOC-6-7, WIRE-ready-3
#[test]
fn write_is_verified_protected_and_followed_by_one_reset() {
    let (board, mut io) = mock_board(&BLANK, None);
    // As a killed run may leave it.
    board.borrow_mut().protected = false;
    let (mut steps, mut progress) = (0, (0, 0));
    let programmed = program(&mut io, &wanted(), 100, None, |step| {
        steps += 1;
        match step {
            Progress::Before(_) => assert!(board.borrow().protected),
            Progress::Written { done, of } => progress = (done, of),
        }
    });
    let programmed = programmed.unwrap();
    assert_eq!(steps, 1 + programmed.bursts);
    assert_eq!(progress, (programmed.bytes, programmed.bytes));
    // A write cycle of the mock takes 3 ms, a poll 0.25 ms, a reset 100 ms.
    let cycles_us = board.borrow().now_us - 100_000;
    assert!(cycles_us < programmed.bursts as u64 * 3_250 + 1_000);
    assert!(board.borrow().memory == wanted());
    assert!(programmed.before == BLANK);
    assert_eq!(board.borrow().resets, 1);
    assert_idle(&board.borrow(), None);
    // What is there already is not written, nor is the protection lifted for it.
    let unlocked = || IoError::new("protection lifted");
    let locked = Box::new(move |high: bool| high.then_some(()).ok_or_else(unlocked));
    let protect = std::mem::replace(&mut io.protect, locked);
    let programmed = write(&mut io).unwrap();
    io.protect = protect;
    assert_eq!((programmed.bytes, programmed.bursts), (0, 0));
    // What changes after its burst was read back.
    let (_folder, journal) = journal();
    let outcome = program(&mut io, &BLANK, 100, Some(&journal), |step| {
        assert!(!matches!(step, Progress::Before(before) if *before != wanted()));
        board.borrow_mut().memory.0[0x3F0] = 0;
    });
    let address = 0x3F0;
    assert!(matches!(outcome, Err(Error::Verify { address: at, .. }) if at == address));
    assert!(journal.unfinished());
    // A burst that the part does not take is found before the next.
    let (_, mut io) = mock_board(&BLANK, None);
    io.protect = Box::new(|_| Ok(()));
    let mut bursts = 0;
    let outcome = program(&mut io, &wanted(), 100, None, |step| {
        bursts += usize::from(matches!(step, Progress::Written { .. }));
    });
    assert!(matches!(outcome, Err(Error::Verify { .. })) && bursts == 0);
}

#[test]
fn transaction_without_an_answer_ends_in_time() {
    for (fails_from, doing, end_us) in [
        (0, "writing", 10_000),
        (1, "waiting for a write cycle's end", 20_000),
    ] {
        let (board, mut io) = mock_board(&BLANK, Some(IoFault::BusesFail(fails_from)));
        (board.borrow_mut().selected, board.borrow_mut().protected) = (true, false);
        let outcome = chip::write_burst(&mut io, 0x21, &[1]);
        let Err(Error::Eeprom {
            doing: found,
            address,
            ..
        }) = outcome
        else {
            panic!("{outcome:?}");
        };
        assert_eq!((found, address), (doing, 0x21));
        assert_eq!(board.borrow().now_us, end_us);
    }
    // What fails once is tried again, a write cycle later.
    let (board, mut io) = mock_board(&BLANK, Some(IoFault::FailOnce(0)));
    (board.borrow_mut().selected, board.borrow_mut().protected) = (true, false);
    chip::write_burst(&mut io, 0, &[1]).unwrap();
    assert_eq!(board.borrow().now_us, 5_000 + 3_000);
    // A whole image is read in four transactions of 256 bytes.
    let before = board.borrow().calls;
    chip::read(&mut io, 0, &mut [0; 0x400]).unwrap();
    assert_eq!(board.borrow().calls - before, 4);
    io.interrupt.raise();
    let interrupted = chip::read(&mut io, 0, &mut [0]);
    assert_eq!(interrupted, Err(Error::Interrupted));
}

#[test]
fn verify_names_address_and_both_bytes_of_first_difference() {
    assert_eq!(chip::verify(0x20, &[1, 2, 3], &[1, 2, 3]), Ok(()));
    let expected = Error::Verify {
        address: 0x21,
        written: 2,
        read: 7,
    };
    let found = chip::verify(0x20, &[1, 2, 3], &[1, 7, 7]);
    assert_eq!(found, Err(expected));
}

#[test]
fn hex_has_sixteen_bytes_a_line_and_no_unwritten_line() {
    assert_eq!(image::hex(&BLANK), "blank: every cell reads 0xFF\n");
    let mut some = BLANK;
    (some.0[0x1F], some.0[0x3F0]) = (0x0A, 0xFE);
    let blank = " FF".repeat(15);
    let expected = format!("0010 {blank} 0A\n03F0  FE{blank}\n");
    assert_eq!(image::hex(&some), expected);
}

#[test]
fn image_file_shorter_than_an_original_one_is_refused() {
    let folder = tempfile::tempdir().unwrap();
    let path = folder.path().join("image.bin");
    for (len, is_image) in [
        (image::ORIGINAL_LEN - 1, false),
        (image::ORIGINAL_LEN, true),
        (image::LARGEST_LEN, true),
        (image::LARGEST_LEN + 1, false),
    ] {
        std::fs::write(&path, vec![0; len]).unwrap();
        let loaded = image::load(&path);
        assert_eq!(loaded.is_ok(), is_image, "{len}");
        let is_blank = |image: Image| image.0[0x300..].iter().all(|&byte| byte == 0xFF);
        let is_original = loaded.is_ok_and(is_blank);
        assert_eq!(is_original, len == image::ORIGINAL_LEN, "{len}");
    }
}

// Requirement: DOC-6-6
#[test]
fn lines_left_elsewhere_are_idle_after_read_or_repair() {
    let (board, mut io) = mock_board(&BLANK, None);
    read(&mut io).unwrap();
    assert_eq!(board.borrow().resets, 1, "it was not ready");
    let (board, mut io) = mock_board(&wanted(), None);
    board.borrow_mut().selected = true;
    // Begins a write cycle.
    (io.i2c)(0x50, &[0, 0, 0], &mut []).unwrap();
    assert!(read(&mut io).is_ok());
    let (_folder, journal) = journal();
    for (memory, killed, repaired) in [
        (wanted(), true, Repaired::Nothing),
        (BLANK, false, Repaired::Nothing),
        (BLANK, true, Repaired::Reset { due: false }),
    ] {
        let (board, mut io) = mock_board(&memory, None);
        (board.borrow_mut().selected, board.borrow_mut().protected) = (true, false);
        assert_eq!(repair(&mut io, &journal, killed, 100), Ok(repaired));
        let resets = usize::from(repaired != Repaired::Nothing);
        assert_eq!(board.borrow().resets, resets, "killed: {killed}");
        assert_idle(&board.borrow(), None);
    }
    // A line that cannot be read does not show that the STM is ready.
    let (_, mut io) = mock_board(&wanted(), None);
    io.ready = Box::new(|| Err(injected()));
    let repaired = repair(&mut io, &journal, true, 100);
    assert_eq!(repaired, Ok(Repaired::Reset { due: false }));
}

// Requirement: DOC-6-2
#[test]
fn write_fault_at_any_call_leaves_lines_idle() {
    for at in 0..calls_of_a_good_write() {
        let faults = [
            IoFault::FailOnce,
            IoFault::BusesFail,
            IoFault::Interrupt,
            IoFault::Panic,
        ];
        for fault in faults.map(|fault| fault(at)) {
            let (board, mut io) = mock_board(&BLANK, Some(fault));
            let outcome = catch_unwind(AssertUnwindSafe(|| write(&mut io)));
            let board = board.borrow();
            assert_idle(&board, Some(fault));
            assert_eq!(board.resets, 1, "after {fault:?}");
            match (fault, outcome) {
                // One disturbed call is survived everywhere.
                (_, Ok(Ok(_))) => assert!(board.memory == wanted(), "{fault:?}"),
                (IoFault::Panic(_), Err(_))
                | (IoFault::BusesFail(_), Ok(Err(Error::Eeprom { .. })))
                | (IoFault::Interrupt(_), Ok(Err(Error::Interrupted))) => {}
                (fault, outcome) => panic!("{fault:?}: {:?}", outcome.ok()),
            }
        }
    }
}

#[test]
fn line_that_fails_is_named() {
    let (_, mut io) = mock_board(&BLANK, Some(IoFault::AllFail(0)));
    for (outcome, net) in [
        (io.set_reset(true), "RESET"),
        (io.set_select(true), "SELECT"),
        (io.set_protect(true), "WP_EEPROM"),
        (io.is_ready().map(drop), "STM_READY"),
    ] {
        assert!(matches!(outcome, Err(Error::Pin(name, _)) if name == net));
    }
}

#[test]
fn write_total_failure_names_what_was_not_restored() {
    let mut after_another = 0;
    for at in 0..calls_of_a_good_write() {
        let fault = IoFault::AllFail(at);
        let (board, mut io) = mock_board(&BLANK, Some(fault));
        let outcome = write(&mut io);
        let board = board.borrow();
        let restored = board.protected && !board.selected && !board.in_reset;
        let is_named = matches!(outcome, Err(Error::NotRestored { .. }));
        assert!(restored || is_named, "{fault:?}: {outcome:?}");
        let has_first = matches!(outcome, Err(Error::NotRestored { first: Some(_), .. }));
        after_another += usize::from(has_first);
    }
    assert!(after_another > 50, "{after_another}");
}

// Requirement: DOC-6-2
#[test]
fn protection_line_that_fails_keeps_neither_bus_nor_stm() {
    let (board, mut io) = mock_board(&BLANK, None);
    io.protect = Box::new(|_| Err(injected()));
    assert!(matches!(write(&mut io), Err(Error::Pin("WP_EEPROM", _))));
    assert_idle(&board.borrow(), None);
    assert_eq!(board.borrow().resets, 1);
    // Also where it fails only once the bus is taken.
    let (board, mut io) = mock_board(&wanted(), None);
    let mut works = true;
    io.protect = Box::new(move |_| {
        let worked = std::mem::take(&mut works);
        worked.then_some(()).ok_or_else(injected)
    });
    assert!(matches!(read(&mut io), Err(Error::NotRestored { .. })));
    assert_idle(&board.borrow(), None);
}

#[test]
fn read_fault_leaves_lines_idle_without_reset() {
    for at in 0..20 {
        let faults = [IoFault::FailOnce, IoFault::BusesFail, IoFault::Interrupt];
        for fault in faults.map(|fault| fault(at)) {
            let (board, mut io) = mock_board(&wanted(), Some(fault));
            let _ = read(&mut io);
            let board = board.borrow();
            assert_idle(&board, Some(fault));
            assert_eq!(board.resets, 0, "after {fault:?}");
        }
    }
}

#[test]
fn absent_eeprom_is_an_error_within_a_second() {
    let (_, mut io) = mock_board(&BLANK, Some(IoFault::BusesFail(0)));
    let error = read(&mut io).unwrap_err();
    let expected = matches!(error, Error::Eeprom { doing, address: 0, .. } if doing == "reading");
    assert!(expected, "{error:?}");
    assert!((io.clock)() < 1_000_000);
}

#[test]
fn eeprom_is_noticed_where_it_answers() {
    let (board, mut io) = mock_board(&BLANK, None);
    io.set_select(true).unwrap();
    (io.delay)(1000);
    // The probe writes nothing, even where a killed run has lifted the protection.
    board.borrow_mut().protected = false;
    assert!(chip::answers(&mut io));
    assert!(board.borrow().memory == BLANK);
    board.borrow_mut().fault = Some(IoFault::BusesFail(0));
    assert!(!chip::answers(&mut io));
}

#[test]
fn journal_of_complete_write_asks_for_reset_until_it_succeeds() {
    let (_folder, journal) = journal();
    journal.begin(&wanted()).unwrap();
    journal.written().unwrap();
    assert!(!journal.unfinished());
    // Due until it succeeds; the calls are three idle lines and the two edges of RESET.
    for at in 0..=5 {
        let (_, mut io) = mock_board(&wanted(), Some(IoFault::AllFail(at)));
        assert!(journal.reset_due(), "call {at}");
        let repaired = repair(&mut io, &journal, false, 100);
        let is_reset = repaired == Ok(Repaired::Reset { due: true });
        assert_eq!(is_reset, at == 5, "call {at}: {repaired:?}");
    }
    assert!(!journal.reset_due());
    // What cannot be removed is an error.
    std::fs::create_dir(journal.path()).unwrap();
    assert!(matches!(journal.end(), Err(Error::Unwritable { .. })));
}

#[test]
fn write_cycle_without_end_is_an_error_after_20_ms() {
    let ends = (0..40).map(|at| {
        let (board, mut io) = mock_board(&BLANK, Some(IoFault::BusesFail(at)));
        let outcome = write(&mut io);
        let now_us = board.borrow().now_us;
        (outcome, now_us)
    });
    let mut waits = ends.filter(
        |(end, _)| matches!(end, Err(Error::Eeprom { doing, .. }) if doing.starts_with("waiting")),
    );
    // Behind the settling of the bus; a reset and the wait for STM_READY follow.
    assert_eq!(waits.next().unwrap().1, 200 + 20_000 + 100_000 + 100_000);
}

#[test]
fn journal_exists_during_write_and_after_its_failure() {
    let (_folder, journal) = journal();
    let (_, mut whole) = mock_board(&BLANK, None);
    program(&mut whole, &wanted(), 100, Some(&journal), |step| {
        let writes = matches!(step, Progress::Written { .. });
        assert_eq!(journal.unfinished(), writes);
    })
    .unwrap();
    assert!(!journal.unfinished() && !journal.reset_due());
    // What is there already needs none.
    program(&mut whole, &wanted(), 100, Some(&journal), |_| {}).unwrap();

    let (_, mut cut) = mock_board(&BLANK, Some(IoFault::BusesFail(30)));
    program(&mut cut, &wanted(), 100, Some(&journal), |_| {}).unwrap_err();
    assert_eq!(journal.path().metadata().unwrap().mode() & 0o777, 0o660);
    // The half-written content does not replace the last complete one.
    journal.begin(&wanted()).unwrap();
    assert!(image::load(journal.path()).unwrap() == BLANK);
    // A repair that fails leaves it to the next one.
    let (_, mut cut) = mock_board(&wanted(), Some(IoFault::BusesFail(30)));
    assert!(repair(&mut cut, &journal, false, 100).is_err() && journal.unfinished());
    // Also where the last run was not killed.
    let (board, mut io) = mock_board(&wanted(), None);
    let repaired = repair(&mut io, &journal, false, 100);
    assert!(matches!(repaired, Ok(Repaired::RolledBack { bytes }) if bytes > 0));
    assert!(board.borrow().memory == BLANK);
}

#[test]
fn repair_after_any_failure_restores_whole_image() {
    let (_folder, journal) = journal();
    let (mut undone, mut completed) = (0, 0);
    for at in 0..calls_of_a_good_write() {
        let faults = [IoFault::BusesFail, IoFault::AllFail, IoFault::Interrupt];
        for fault in faults.map(|fault| fault(at)) {
            let (board, mut first) = mock_board(&BLANK, Some(fault));
            let outcome = program(&mut first, &wanted(), 100, Some(&journal), |_| {});
            board.borrow_mut().fault = None;
            board.borrow_mut().interrupt = crate::board_io::Interrupt::new();
            let repaired = repair(&mut reconnect(&board), &journal, true, 100).unwrap();
            let board = board.borrow();
            assert_idle(&board, Some(fault));
            assert!(board.resets > 0, "{fault:?}");
            let written = repaired == (Repaired::Reset { due: true }) || outcome.is_ok();
            let whole = if written { wanted() } else { BLANK };
            assert!(board.memory == whole, "{fault:?}: {repaired:?}");
            assert!(!journal.unfinished() && !journal.reset_due());
            completed += usize::from(repaired == Repaired::Reset { due: true });
            undone += usize::from(matches!(repaired, Repaired::RolledBack { bytes } if bytes > 0));
        }
    }
    // A complete write is not undone.
    assert!(undone > 50 && completed > 0, "{undone}, {completed}");
}

//! T12 with the ELF: whichever call of an EEPROM write the process is killed before, the next run finds or
//! restores a complete image, protected and on the STM's bus, and the STM runs with it. What one failing call
//! leaves is host-link's own test.

use std::cell::RefCell;
use std::rc::Rc;

use fw_core::eeprom::{IMAGE_LEN, Image, fields};
use fw_core::wire::Mode;
use host_link::board_io::{BoardIo, IoError, OutputLine};
use host_link::eeprom::journal::Journal;
use host_link::eeprom::program;
use host_link::eeprom::repair::{Repaired, repair};
use host_link::session::Session;
use robot_tests::exploration::READY_MS;
use robot_tests::test_board::Rig;

const RATE_HZ: u32 = 400;

/// The calls of a process: none from `killed_before` on reaches the board. The writer leaves the journal alone
/// where they fail, as a process that is no more.
struct Calls {
    killed_before: usize,
    made: usize,
    /// Those that polled for an end that was not reached.
    polls: Vec<usize>,
}

type Process = Rc<RefCell<Calls>>;

fn call<T>(
    process: &Process,
    act: impl FnOnce() -> Result<T, IoError>,
    is_reached: fn(&T) -> bool,
) -> Result<T, IoError> {
    let calls = &mut *process.borrow_mut();
    calls.made += 1;
    if calls.made > calls.killed_before {
        return Err(IoError::new("killed"));
    }
    let outcome = act();
    if !outcome.as_ref().is_ok_and(is_reached) {
        calls.polls.push(calls.made - 1);
    }
    outcome
}

fn called(io: BoardIo, process: &Process) -> BoardIo {
    let line = |mut inner: OutputLine| -> OutputLine {
        let process = Rc::clone(process);
        Box::new(move |high| call(&process, || inner(high), |()| true))
    };
    let (writer, mut i2c) = (Rc::clone(process), io.i2c);
    let (reader, mut ready) = (Rc::clone(process), io.ready);
    let (waiter, mut delay) = (Rc::clone(process), io.delay);
    BoardIo {
        i2c: Box::new(move |address, write, read| {
            call(&writer, || i2c(address, write, read), |()| true)
        }),
        reset: line(io.reset),
        select: line(io.select),
        protect: line(io.protect),
        ready: Box::new(move || call(&reader, &mut ready, |&high| high)),
        // Time passes only while the process runs.
        delay: Box::new(move |us| {
            let calls = waiter.borrow();
            if calls.made <= calls.killed_before {
                delay(us);
            }
        }),
        ..io
    }
}

// Requirement: DOC-6-2, DOC-6-3, DOC-6-6, DOC-6-7
#[test]
fn eeprom_write_killed_is_repaired_by_next_run() {
    // Two original images: no checksum detects a mixture, which is accepted as a configuration.
    let mut before = Image::FIRST_BOARD;
    before.make_original();
    let after = before
        .clone()
        .with(fields::MODE, Mode::GuardedNormal.code().into())
        .with(fields::FORWARD_P, 7.3_f64.to_bits())
        .with(fields::ROTATION_D, 49.9_f64.to_bits());
    let rig = Rig::booted(Some(before.0.to_vec()));
    let folder = tempfile::tempdir().expect("a folder");
    let journal = Journal::new(folder.path().join("before"));
    let write = |killed_before| {
        // The STM keeps the configuration it booted with.
        let there = before.0;
        rig.eeprom(move |part| part.bytes_mut()[..IMAGE_LEN].copy_from_slice(&there));
        let process = Process::new(RefCell::new(Calls {
            killed_before,
            made: 0,
            polls: Vec::new(),
        }));
        let mut io = called(rig.io(), &process);
        let outcome = program(&mut io, &after, READY_MS, Some(&journal), |_| {});
        drop(io);
        (
            outcome,
            Rc::into_inner(process).expect("dropped").into_inner(),
        )
    };
    let assert_whole = |runs: bool, when: &str| {
        let image = rig.eeprom(|part| Image(*part.bytes().first_chunk().expect("four pages")));
        assert!(image == before || image == after, "{when}");
        assert!(rig.eeprom(|part| part.write_protected), "{when}");
        let controller = rig.i2c_bus(|bus, _| bus.controller());
        assert_eq!(controller, twin::I2cController::Stm, "{when}");
        if runs {
            let mut io = rig.io();
            let met = Session::open(&mut io, RATE_HZ, READY_MS).and_then(|mut s| s.confirm_mode());
            assert_eq!(met, Ok(()), "{when}: {}", rig.log());
        }
        image
    };
    let (outcome, Calls { made, polls, .. }) = write(usize::MAX);
    assert!(outcome.is_ok(), "{outcome:?}");
    assert!(assert_whole(true, "after a write") == after);
    // Between two other polls of the same wait a kill has the same effect as before them.
    let is_poll = |at: &usize| polls.binary_search(at).is_ok();
    let is_within = |at: usize| at > 0 && [at - 1, at, at + 1].iter().all(is_poll);
    let (mut undone, mut reset) = (0, 0);
    for at in (0..made).filter(|&at| !is_within(at)) {
        let (outcome, _) = write(at);
        assert!(outcome.is_err(), "killed before call {at}: {outcome:?}");
        let repaired = repair(&mut rig.io(), &journal, true, READY_MS);
        let repaired = repaired.unwrap_or_else(|error| panic!("after call {at}: {error}"));
        assert!(!journal.unfinished() && !journal.reset_due());
        let when = format!("killed before call {at}: {repaired:?}");
        assert_whole(repaired != Repaired::Nothing, &when);
        undone += usize::from(matches!(repaired, Repaired::RolledBack { bytes } if bytes > 0));
        reset += usize::from(matches!(repaired, Repaired::Reset { .. }));
    }
    println!("{undone} writes undone, {reset} resets repeated");
    assert!(undone > 5 && reset > 2, "{undone} {reset}");
}

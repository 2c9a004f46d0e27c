//! T12: whichever single call fails while the EEPROM is written, or kills the process, the write
//! protection ends up set, the bus is returned, the STM is reset, and the next run finds or restores a
//! complete image. Every call in turn, on the virtual board with the ELF booting from the image.

use std::panic::{AssertUnwindSafe, catch_unwind};
use tempfile::TempDir;

use fw_core::eeprom::{IMAGE_LEN, Image, fields};
use fw_core::wire::Mode;
use host_link::eeprom::journal::Journal;
use host_link::eeprom::repair::{Repaired, repair};
use host_link::eeprom::{Programmed, program};
use host_link::error::Error;
use host_link::session::Session;
use robot_tests::io_faults::{Calls, IoFault, ProcessKilled, with_fault};
use robot_tests::test_board::Rig;

const READY_MS: u32 = 1_000;
const RATE_HZ: u32 = 400;

/// An original image: no checksum detects a mixture of two.
fn before() -> Image {
    let mut image = Image::FIRST_BOARD;
    image.make_original();
    image
}

/// Another original image: a mixture with the first is accepted as a configuration.
fn after() -> Image {
    before()
        .with(fields::MODE, Mode::GuardedNormal.code().into())
        .with(fields::FORWARD_P, 7.3_f64.to_bits())
        .with(fields::ROTATION_D, 49.9_f64.to_bits())
}

/// A robot whose EEPROM is written repeatedly, and the files that outlive the writing process.
struct EepromTest {
    rig: Rig,
    journal: Journal,
    _folder: TempDir,
}

impl EepromTest {
    fn new() -> Self {
        let folder = tempfile::tempdir().expect("a folder");
        Self {
            rig: Rig::booted(Some(before().0.to_vec())),
            journal: Journal::new(folder.path().join("before")),
            _folder: folder,
        }
    }

    /// Restores the first image; the STM keeps the configuration it booted with.
    fn restore_image(&self) {
        self.journal.end().expect("the journal's file");
        let there = before();
        self.rig
            .eeprom(move |part| part.bytes_mut()[..IMAGE_LEN].copy_from_slice(&there.0));
    }

    fn write(&self, fault: IoFault) -> (std::thread::Result<Result<Programmed, Error>>, Calls) {
        let (mut machine, calls) = with_fault(self.rig.io(), fault);
        let image = after();
        let outcome = catch_unwind(AssertUnwindSafe(|| {
            program(&mut machine, &image, READY_MS, Some(&self.journal), |_| {})
        }));
        (outcome, calls)
    }

    fn image(&self) -> Image {
        self.rig
            .eeprom(|part| Image(*part.bytes().first_chunk().expect("four pages")))
    }

    #[track_caller]
    fn assert_at_rest(&self, fault: IoFault) {
        let protected = self.rig.eeprom(|part| part.is_write_protected());
        assert!(protected, "unprotected after {fault:?}");
        let controller = self.rig.i2c_bus(|bus, _| bus.controller());
        assert_eq!(controller, twin::I2cController::Stm, "after {fault:?}");
    }

    /// The STM runs with the present image: both ends use its mode.
    #[track_caller]
    fn assert_runs(&self, fault: IoFault) {
        let mut machine = self.rig.io();
        let met = Session::open(&mut machine, RATE_HZ, READY_MS).and_then(|mut s| s.confirm_mode());
        assert_eq!(met, Ok(()), "after {fault:?}: {}", self.rig.log());
    }

    /// The repair at the start of every command.
    #[track_caller]
    fn repair_after(&self, fault: IoFault) -> Repaired {
        let repaired = repair(&mut self.rig.io(), &self.journal, true, READY_MS);
        let repaired = repaired.unwrap_or_else(|error| panic!("after {fault:?}: {error}"));
        assert!(!self.journal.unfinished() && !self.journal.reset_due());
        self.assert_at_rest(fault);
        repaired
    }

    /// The calls of a successful write.
    fn calls(&self) -> Vec<usize> {
        self.restore_image();
        let (outcome, calls) = self.write(IoFault::None);
        assert!(matches!(outcome, Ok(Ok(_))), "{outcome:?}");
        assert!(self.image() == after());
        self.assert_at_rest(IoFault::None);
        self.assert_runs(IoFault::None);
        calls.distinct()
    }
}

// Requirement: DOC-6-2, DOC-6-3, DOC-6-6, DOC-6-7
#[test]
fn eeprom_write_survives_one_failing_call() {
    let test = EepromTest::new();
    for at in test.calls() {
        let fault = IoFault::FailsOnce(at);
        test.restore_image();
        let resets = test.rig.resets().len();
        let (outcome, _) = test.write(fault);
        test.assert_at_rest(fault);
        assert!(matches!(outcome, Ok(Ok(_))), "{fault:?}: {outcome:?}");
        assert!(test.image() == after(), "{fault:?}");
        assert_eq!(test.rig.resets().len(), resets + 1, "{fault:?}");
    }
    test.rig.assert_modelled();
}

#[test]
fn eeprom_write_killed_is_repaired_by_next_run() {
    let test = EepromTest::new();
    let (mut undone, mut reset, mut killed) = (0, 0, 0);
    for at in test.calls() {
        let fault = IoFault::Killed(at);
        test.restore_image();
        let (outcome, _) = test.write(fault);
        match outcome {
            Err(payload) => assert!(payload.is::<ProcessKilled>(), "{fault:?}"),
            Ok(outcome) => panic!("{fault:?}: {outcome:?}"),
        }
        killed += 1;
        let repaired = test.repair_after(fault);
        undone += usize::from(matches!(repaired, Repaired::RolledBack { bytes } if bytes > 0));
        reset += usize::from(matches!(repaired, Repaired::Reset { .. }));
        let image = test.image();
        let whole = image == before() || image == after();
        assert!(whole, "{fault:?}: {repaired:?}");
        if repaired != Repaired::Nothing {
            test.assert_runs(fault);
        }
    }
    println!("{killed} kills: {undone} writes undone, {reset} resets repeated");
    assert!(undone > 5 && reset > 2, "{undone} {reset}");
}

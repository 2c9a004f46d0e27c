//! T12: whatever single call fails while the EEPROM is written, or the process dies before, the write
//! protection ends up set, the bus goes back, the STM is reset, and the next run finds the image
//! whole or makes it so. Every call in turn, on the virtual board with the ELF booting from what is
//! there.

use std::panic::{catch_unwind, AssertUnwindSafe};
use std::path::PathBuf;

use fw_core::eeprom::{first_board, Image, IMAGE_LEN};
use fw_core::wire::Mode;
use host_link::board_io::{BoardIo, Interrupt};
use host_link::eeprom::journal::Journal;
use host_link::eeprom::repair::{repair, Repaired};
use host_link::eeprom::{program, Programmed};
use host_link::error::Error;
use host_link::session::Session;
use host_link::settings::Settings;
use pilot::virtual_board;
use robot_tests::io_faults::{with_mishap, Calls, Died, Mishap};
use robot_tests::test_board::Rig;

const SPI_HZ: u32 = 8_000_000;
const READY_MS: u32 = 1_000;
const RATE_HZ: u32 = 400;

/// An original image, which no checksum protects against being half of this and half of that.
fn before() -> Image {
    Settings {
        config: first_board(),
        platform_page: false,
    }
    .image()
}

/// Original too: half of one and half of the other would pass for a configuration.
fn wanted() -> Image {
    let mut config = first_board();
    config.mode = Mode::GuardedNormal;
    config.forward.p = fw_core::binary64::Binary64(7.3_f64.to_bits());
    config.rotation.d = fw_core::binary64::Binary64(49.9_f64.to_bits());
    Settings {
        config,
        platform_page: false,
    }
    .image()
}

/// A robot whose EEPROM is written again and again, and what survives the processes that do it.
struct Bench {
    rig: Rig,
    journal: Journal,
    folder: PathBuf,
}

impl Bench {
    fn new(name: &str) -> Self {
        let folder = std::env::temp_dir().join(format!("robot-{name}-{}", std::process::id()));
        Self {
            rig: Rig::booted(Some(before().to_vec())),
            journal: Journal::new(folder.join("before")),
            folder,
        }
    }

    fn machine(&self) -> BoardIo {
        virtual_board::board_io(&self.rig.board, SPI_HZ, Interrupt::new())
    }

    /// The image of before. The STM runs by whichever it booted from.
    fn start_over(&self) {
        self.journal.end().expect("the journal's file");
        let there = before();
        self.rig.board.i2c_bus(move |bus, _| {
            let part = bus.eeprom.as_mut().expect("an EEPROM");
            part.bytes_mut()[..IMAGE_LEN].copy_from_slice(&there);
        });
    }

    fn write(&self, mishap: Mishap) -> (std::thread::Result<Result<Programmed, Error>>, Calls) {
        let (mut machine, calls) = with_mishap(self.machine(), mishap);
        let image = wanted();
        let outcome = catch_unwind(AssertUnwindSafe(|| {
            program(&mut machine, &image, READY_MS, Some(&self.journal), |_| {})
        }));
        (outcome, calls)
    }

    fn image(&self) -> Image {
        self.rig.board.i2c_bus(|bus, _| {
            let part = bus.eeprom.as_ref().expect("an EEPROM");
            *part.bytes().first_chunk().expect("four pages")
        })
    }

    #[track_caller]
    fn assert_at_rest(&self, mishap: Mishap) {
        let (protected, controller) = self.rig.board.i2c_bus(|bus, _| {
            let part = bus.eeprom.as_ref().expect("an EEPROM");
            (part.is_write_protected(), bus.controller())
        });
        assert!(protected, "unprotected after {mishap:?}");
        assert_eq!(controller, twin::I2cController::Stm, "after {mishap:?}");
    }

    /// The STM runs, by the image that is there: both ends speak its mode.
    #[track_caller]
    fn assert_runs(&self, mishap: Mishap) {
        let mut machine = self.machine();
        let met = Session::open(&mut machine, RATE_HZ, READY_MS).and_then(|mut s| s.confirm_mode());
        assert_eq!(met, Ok(()), "after {mishap:?}: {}", self.rig.log());
    }

    /// What every command begins with.
    #[track_caller]
    fn next_start(&self, mishap: Mishap) -> Repaired {
        let repaired = repair(&mut self.machine(), &self.journal, true, READY_MS);
        let repaired = repaired.unwrap_or_else(|error| panic!("after {mishap:?}: {error}"));
        assert!(!self.journal.unfinished() && !self.journal.reset_due());
        self.assert_at_rest(mishap);
        repaired
    }

    /// The calls of a good write.
    fn calls(&self) -> Vec<usize> {
        self.start_over();
        let (outcome, calls) = self.write(Mishap::None);
        assert!(matches!(outcome, Ok(Ok(_))), "{outcome:?}");
        assert!(self.image() == wanted());
        self.assert_at_rest(Mishap::None);
        self.assert_runs(Mishap::None);
        calls.telling()
    }
}

impl Drop for Bench {
    fn drop(&mut self) {
        let _ = std::fs::remove_dir_all(&self.folder);
    }
}

// Requirement: DOC-6-2, DOC-6-3, DOC-6-6, DOC-6-7
#[test]
fn one_failing_call_anywhere_is_survived() {
    let bench = Bench::new("fails");
    for at in bench.calls() {
        let mishap = Mishap::Fails(at);
        bench.start_over();
        let resets = bench.rig.board.resets().len();
        let (outcome, _) = bench.write(mishap);
        bench.assert_at_rest(mishap);
        assert!(matches!(outcome, Ok(Ok(_))), "{mishap:?}: {outcome:?}");
        assert!(bench.image() == wanted(), "{mishap:?}");
        assert_eq!(bench.rig.board.resets().len(), resets + 1, "{mishap:?}");
    }
    bench.rig.assert_modelled();
}

#[test]
fn a_process_that_dies_anywhere_is_repaired_by_the_next_run() {
    let bench = Bench::new("dies");
    let (mut undone, mut reset, mut died) = (0, 0, 0);
    for at in bench.calls() {
        let mishap = Mishap::Dies(at);
        bench.start_over();
        let (outcome, _) = bench.write(mishap);
        match outcome {
            Err(payload) => assert!(payload.is::<Died>(), "{mishap:?}"),
            Ok(outcome) => panic!("{mishap:?}: {outcome:?}"),
        }
        died += 1;
        let repaired = bench.next_start(mishap);
        undone += usize::from(matches!(repaired, Repaired::RolledBack { bytes } if bytes > 0));
        reset += usize::from(matches!(repaired, Repaired::Reset { .. }));
        let image = bench.image();
        let whole = image == before() || image == wanted();
        assert!(whole, "{mishap:?}: {repaired:?}");
        if repaired != Repaired::Nothing {
            bench.assert_runs(mishap);
        }
    }
    println!("{died} deaths: {undone} writes undone, {reset} resets made up for");
    assert!(undone > 5 && reset > 2, "{undone} {reset}");
}

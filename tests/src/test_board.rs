//! The release ELF on the virtual board, and its frames byte by byte.

use std::ops::Deref;
use std::path::PathBuf;

use crate::reference::{normal_frame, original_image};
use embedded_hal::spi::SpiDevice;
use host_link::board_io::{BoardIo, Interrupt};
use pilot::virtual_board::board_io;
use twin::plant::{Room, Sides};
use twin::trace::{Event, EventKind};
use twin::{Board, Options};

/// Environment variable with the path of the release ELF; `cargo xtask` sets it.
pub const ELF: &str = "ROBOT_ELF";
/// Environment variable with the path of the ELF that panics on purpose.
pub const ELF_PANIC: &str = "ROBOT_ELF_PANIC";
/// Environment variable with the path of the ELF that overflows its stack on purpose.
pub const ELF_OVERFLOW: &str = "ROBOT_ELF_OVERFLOW";
/// Environment variable with the path of the bring-up firmware's ELF.
pub const ELF_BRINGUP: &str = "ROBOT_ELF_BRINGUP";

/// TIM5's compare 1 (RM0383, table 1 and 13.4.21), which every tick writes.
pub const TIM5_CCR1: u64 = 0x4000_0C34;

/// Right and left motor: TIM4's compare value of the enable, the port's set and reset register, and the bits of
/// both inputs in it.
pub const BRIDGES: [(u64, u64, u64); 2] = [
    (0x4000_083C, 0x4002_0018, 0x000C_000C),
    (0x4000_0840, 0x4002_0818, 0xC000_C000),
];

/// TIM4's event generation (RM0383, table 1).
const TIM4_EGR: u64 = 0x4000_0814;
/// More than the L298P's slowest turn-off, nanoseconds.
const DEAD_TIME_NS: u64 = 2_000;

/// The Pi's SPI clock, hertz.
const SPI_HZ: u32 = 8_000_000;

/// READY may take this long, microseconds: a reset, the log's first lines and 1 KiB of EEPROM.
pub const READY_US: u64 = 200_000;

/// The Pi's lines and buses to a board.
pub fn io(board: &Board) -> BoardIo {
    board_io(board, SPI_HZ, Interrupt::new())
}

/// Walls within the reach of every rangefinder.
pub fn near_walls() -> Room {
    Room::default()
        .with_wall(900.0, -800.0, 900.0, 800.0)
        .with_wall(900.0, 800.0, -900.0, 800.0)
        .with_wall(-900.0, -800.0, 900.0, -800.0)
}

/// The ELF that the variable names, or the one that `cargo xtask firmware` leaves on a machine whose own
/// compiler has the target.
///
/// # Panics
/// Where there is none: the firmware has to be built first.
pub fn elf(variable: &str) -> Vec<u8> {
    let path = std::env::var_os(variable).map_or_else(
        || {
            let name = match variable {
                ELF_BRINGUP => "bringup.elf",
                ELF_PANIC => "fw-pac-test-panic.elf",
                ELF_OVERFLOW => "fw-pac-test-overflow.elf",
                _ => "fw-pac.elf",
            };
            PathBuf::from(env!("CARGO_MANIFEST_DIR"))
                .join("../target/elf")
                .join(name)
        },
        PathBuf::from,
    );
    std::fs::read(&path).unwrap_or_else(|error| {
        panic!(
            "{}: {error}. Build the firmware first (`cargo xtask firmware`) or name it in {variable}",
            path.display()
        )
    })
}

/// A robot under test: a [`Board`] with a firmware.
pub struct Rig {
    /// The board.
    pub board: Board,
    /// It runs the release ELF, which uses nothing that the models lack and breaks no rule of the part.
    release: bool,
}

impl Drop for Rig {
    fn drop(&mut self) {
        if self.release && !std::thread::panicking() {
            self.assert_modelled();
        }
    }
}

impl Deref for Rig {
    type Target = Board;

    fn deref(&self) -> &Board {
        &self.board
    }
}

impl Rig {
    /// A robot with the release ELF.
    ///
    /// # Panics
    /// Where the board cannot be made.
    pub fn new(options: Options) -> Self {
        Self::with_elf(&elf(ELF), options)
    }

    /// A robot with an ELF of its own.
    ///
    /// # Panics
    /// Where the board cannot be made.
    pub fn with_elf(elf: &[u8], options: Options) -> Self {
        twin::processor::keep_to_one();
        let board = Board::new(elf, options).expect("a board");
        let release = elf == self::elf(ELF);
        Self { board, release }
    }

    /// A robot with this EEPROM, booted until READY or for as long as that may take.
    pub fn booted(eeprom: Option<Vec<u8>>) -> Self {
        let options = Options::default();
        let rig = Self::new(Options { eeprom, ..options });
        rig.await_ready();
        rig
    }

    /// A robot that has become READY.
    ///
    /// # Panics
    /// With the log, where it has not.
    pub fn ready(options: Options) -> Self {
        let rig = Self::new(options);
        rig.assert_ready();
        rig
    }

    /// A robot that has become READY with this EEPROM.
    ///
    /// # Panics
    /// With the log, where it has not.
    pub fn configured(eeprom: Vec<u8>) -> Self {
        Self::ready(Options::with_eeprom(eeprom))
    }

    /// A robot of the first board that drives three metres ahead.
    ///
    /// # Panics
    /// With the log, where it does not.
    pub fn driving() -> Self {
        let rig = Self::booted(Some(original_image()));
        rig.drive_off();
        rig
    }

    /// Drives three metres ahead.
    ///
    /// # Panics
    /// With the log, where it does not.
    pub fn drive_off(&self) {
        let _ = self.keep_sending(&normal_frame(3_000_000, 0, 0, true), 1_000_000);
        assert!(!self.motors_off(), "{}", self.log());
    }

    /// The Pi's lines and buses.
    pub fn io(&self) -> BoardIo {
        io(&self.board)
    }

    /// Lets time pass until READY, at most [`READY_US`]; whether it came.
    pub fn await_ready(&self) -> bool {
        self.board.run_until(READY_US, 100, Board::is_ready)
    }

    /// What the firmware writes to `registers` until it is READY on the first board, in order: addresses and values.
    ///
    /// # Panics
    /// Where it does not become READY.
    pub fn written_at_boot(registers: &[u64]) -> Vec<(u64, u64)> {
        let rig = Self::new(Options::with_eeprom(original_image()));
        for &register in registers {
            rig.trace_writes(register);
        }
        rig.assert_ready();
        let events = rig.take_events().into_iter();
        let write = |event: Event| match event.kind {
            EventKind::Write { address, value } => Some((address, value)),
            _ => None,
        };
        events.filter_map(write).collect()
    }

    /// What each of `registers` holds when the firmware is READY on the first board.
    ///
    /// # Panics
    /// Where it does not become READY, or has not written one of them.
    pub fn registers_after_boot<const N: usize>(registers: [u64; N]) -> [u64; N] {
        let written = Self::written_at_boot(&registers);
        registers.map(|register| {
            let last = written.iter().rfind(|(address, _)| *address == register);
            last.expect("written").1
        })
    }

    /// From here on for [`Self::take_input_changes`].
    pub fn trace_bridges(&self) {
        self.trace_writes(TIM4_EGR);
        for (compare, port, _) in BRIDGES {
            self.trace_writes(compare);
            self.trace_writes(port);
        }
    }

    /// When the inputs of the right and of the left motor changed, nanoseconds.
    ///
    /// # Panics
    /// Where the enable had not been low for the dead time, or both inputs were high.
    pub fn take_input_changes(&self) -> [Vec<u64>; 2] {
        let events = self.take_events();
        BRIDGES.map(|(compare, port, inputs)| {
            let (mut duty, mut off_since, mut changes) = (None, None, Vec::new());
            let mut high = 0;
            for event in &events {
                match event.kind {
                    EventKind::Write { address, value } if address == compare => {
                        (duty, off_since) = (Some(value), None);
                    }
                    // A zero is in effect from the update on.
                    EventKind::Write { address, .. } if address == TIM4_EGR && duty == Some(0) => {
                        off_since = Some(event.at_ns);
                    }
                    EventKind::Write { address, value }
                        if address == port && value & inputs != 0 =>
                    {
                        let off = event.at_ns - off_since.expect("the enable is low");
                        assert!(off >= DEAD_TIME_NS, "{off} ns at {}", event.at_ns);
                        high = high & !(value >> 16) | value & 0xFFFF;
                        assert_ne!(high, inputs & 0xFFFF, "both at {}", event.at_ns);
                        changes.push(event.at_ns);
                    }
                    _ => {}
                }
            }
            changes
        })
    }

    /// The log so far.
    ///
    /// # Panics
    /// Where it is not ASCII.
    pub fn log(&self) -> String {
        let bytes = self.board.uart();
        assert!(bytes.is_ascii(), "the log is ASCII");
        String::from_utf8(bytes).expect("ASCII is UTF-8")
    }

    /// Fails where the log does not have a text.
    ///
    /// # Panics
    /// With the log.
    #[track_caller]
    pub fn assert_logged(&self, text: &str) {
        let log = self.log();
        assert!(log.contains(text), "the log does not say `{text}`:\n{log}");
    }

    /// Becomes READY.
    ///
    /// # Panics
    /// With the log, where it does not.
    #[track_caller]
    pub fn assert_ready(&self) {
        assert!(self.await_ready(), "{}", self.log());
    }

    /// One chip-select at 8 MHz: what the STM sent meanwhile.
    ///
    /// # Panics
    /// Where the emulation has ended.
    pub fn frame(&self, bytes: &[u8]) -> Vec<u8> {
        let mut back = vec![0; bytes.len()];
        self.board
            .spi()
            .transfer(&mut back, bytes)
            .expect("the emulation runs");
        back
    }

    /// The same frame at 40 Hz for `us`, the last reply.
    pub fn keep_sending(&self, bytes: &[u8], us: u64) -> Vec<u8> {
        let ends = self.board.now_us() + us;
        let mut back = self.frame(bytes);
        while self.board.now_us() < ends {
            self.board.run_us(25_000 - 60);
            back = self.frame(bytes);
        }
        back
    }

    /// Whether both motors get nothing.
    pub fn motors_off(&self) -> bool {
        self.board.truth().duty == Sides::default()
    }

    /// Ends the check of what the firmware touches: from here on an injected fault has it refused.
    ///
    /// # Panics
    /// Where something has been refused before.
    pub fn end_check(&mut self) {
        self.assert_modelled();
        self.release = false;
    }

    /// Fails where the firmware touched something that no model covers.
    ///
    /// # Panics
    /// With the list.
    pub fn assert_modelled(&self) {
        let unmodelled = self.board.unmodelled();
        assert!(unmodelled.is_empty(), "{unmodelled}");
    }
}

//! The release ELF on the virtual board, and its frames byte by byte.

use std::ops::Deref;
use std::path::PathBuf;

use crate::reference::{normal_frame, original_image};
use embedded_hal::spi::SpiDevice;
use fw_core::eeprom::{Image, fields};
use fw_core::wire::Mode;
use host_link::board_io::{BoardIo, Interrupt};
use object::{Object, ObjectSection};
use pilot::virtual_board::board_io;
use twin::components::eeprom::Eeprom;
use twin::plant::{Pose2, Room, Sides};
use twin::trace::EventKind;
use twin::{Board, Options};

/// Environment variable with the path of the release ELF; `cargo xtask` sets it.
pub const ELF: &str = "ROBOT_ELF";
/// Environment variable with the path of the ELF that panics on purpose.
pub const ELF_PANIC: &str = "ROBOT_ELF_PANIC";
/// Environment variable with the path of the ELF that overflows its stack on purpose.
pub const ELF_OVERFLOW: &str = "ROBOT_ELF_OVERFLOW";
/// Environment variable with the path of the bring-up firmware's ELF.
pub const ELF_BRINGUP: &str = "ROBOT_ELF_BRINGUP";

/// Environment variable with a number, 0 where it is not set: each board's seed is higher by it, and the frames come
/// at other phases to the ticks.
pub const SEED: &str = "ROBOT_BOARD_SEED";

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
const READY_US: u64 = 200_000;

/// The Pi's lines and buses to a board.
pub fn io(board: &Board) -> BoardIo {
    board_io(board, SPI_HZ, Interrupt::new())
}

/// A write of the firmware to a traced register.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct RegisterWrite {
    /// Nanoseconds of virtual time.
    pub at_ns: u64,
    /// The register.
    pub address: u64,
    /// What it is set to.
    pub value: u64,
}

/// Takes the events so far, and of them the writes.
pub fn take_writes(board: &Board) -> Vec<RegisterWrite> {
    let events = board.take_events().into_iter();
    let writes = events.filter_map(|event| match event.kind {
        EventKind::Write { address, value } => Some(RegisterWrite {
            at_ns: event.at_ns,
            address,
            value,
        }),
        _ => None,
    });
    writes.collect()
}

/// I2C1's first control register, and bits of it.
pub const I2C1_CR1: u64 = 0x4000_5400;
/// See [`I2C1_CR1`].
pub const START: u64 = 1 << 8;
/// See [`I2C1_CR1`].
pub const STOP: u64 = 1 << 9;

/// Whether a write since the last look set this bit.
pub fn wrote(bit: u64) -> impl Fn(&Board) -> bool {
    move |board| {
        take_writes(board)
            .iter()
            .any(|write| write.value & bit != 0)
    }
}

/// The first board with a servo, which the sweep asks for.
pub fn image_with_servo(mode: Mode) -> Image {
    Image::FIRST_BOARD
        .with(fields::SERVO, 1)
        .with(fields::MODE, mode.code().into())
}

/// Three metres ahead in mode Normal.
pub fn ahead() -> [u8; 19] {
    normal_frame(3_000_000, 0, 0, true)
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

/// The ELF with the NMI's handler as that of I2C1's errors, for [`Board::stop_crystal`]: the emulated core has no line
/// to its NMI.
pub fn elf_of_mortal_crystal(mut elf: Vec<u8>) -> Vec<u8> {
    let file = object::File::parse(&*elf).expect("an ELF");
    let vectors = file.section_by_name(".vector_table").expect("vectors");
    let at = usize::try_from(vectors.file_range().expect("in the file").0).expect("an offset");
    elf.copy_within(at + 4 * 2..at + 4 * 3, at + 4 * (16 + 32));
    elf
}

/// The number of [`SEED`].
fn shift() -> u64 {
    std::env::var(SEED).map_or(0, |number| number.parse().expect("a number"))
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
    pub fn new(options: Options) -> Self {
        Self::with_elf(&elf(ELF), options)
    }

    /// A robot with an ELF of its own.
    pub fn with_elf(elf: &[u8], mut options: Options) -> Self {
        twin::processor::keep_to_one();
        options.seed += shift();
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
    pub fn ready(options: Options) -> Self {
        let rig = Self::new(options);
        rig.assert_ready();
        rig
    }

    /// A robot that has become READY, its core at so many instructions a microsecond.
    pub fn with_mips(mips: u64, options: Options) -> Self {
        let mips = mips.try_into().expect("a core that runs");
        Self::ready(Options { mips, ..options })
    }

    /// A robot that has become READY with this EEPROM.
    pub fn configured(eeprom: Vec<u8>) -> Self {
        Self::ready(Options::with_eeprom(eeprom))
    }

    /// A robot with a servo, READY in this mode for a tenth of a second.
    pub fn in_mode(mode: Mode) -> Self {
        let rig = Self::configured(image_with_servo(mode).0.to_vec());
        rig.run_us(100_000);
        rig
    }

    /// A robot of the first board that drives three metres ahead.
    pub fn driving() -> Self {
        let rig = Self::booted(Some(original_image()));
        rig.drive_off();
        rig
    }

    /// Drives three metres ahead.
    pub fn drive_off(&self) {
        let _ = self.keep_sending(&ahead(), 1_000_000);
        assert!(!self.motors_off(), "{}", self.log());
    }

    /// The Pi's lines and buses.
    pub fn io(&self) -> BoardIo {
        io(&self.board)
    }

    /// Lets time pass until READY, at most `READY_US`, and to the phase of [`SEED`]; whether it came.
    pub fn await_ready(&self) -> bool {
        let is_ready = self.run_until(READY_US, 100, Board::is_ready);
        self.run_us(shift() * 1_337 % 61_000);
        is_ready
    }

    /// What the firmware writes to `registers` until it is READY on the first board, in order.
    pub fn written_at_boot(registers: &[u64]) -> Vec<RegisterWrite> {
        let rig = Self::new(Options::with_eeprom(original_image()));
        for &register in registers {
            rig.trace_writes(register);
        }
        rig.assert_ready();
        take_writes(&rig)
    }

    /// What each of `registers` holds when the firmware is READY on the first board.
    pub fn registers_after_boot<const N: usize>(registers: [u64; N]) -> [u64; N] {
        let written = Self::written_at_boot(&registers);
        registers.map(|register| {
            let last = written.iter().rfind(|write| write.address == register);
            last.expect("written").value
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

    /// When the inputs of the right and of the left motor changed, nanoseconds: each time with the enable low for
    /// the dead time, and never both high.
    pub fn take_input_changes(&self) -> [Vec<u64>; 2] {
        let writes = take_writes(self);
        BRIDGES.map(|(compare, port, inputs)| {
            let (mut duty, mut off_since, mut changes) = (None, None, Vec::new());
            let mut high = 0;
            for write in &writes {
                let RegisterWrite { at_ns, value, .. } = *write;
                if write.address == compare {
                    (duty, off_since) = (Some(value), None);
                } else if write.address == TIM4_EGR && duty == Some(0) {
                    // A zero is in effect from the update on.
                    off_since = Some(at_ns);
                } else if write.address == port && value & inputs != 0 {
                    let off = at_ns - off_since.expect("the enable is low");
                    assert!(off >= DEAD_TIME_NS, "{off} ns at {at_ns}");
                    high = high & !(value >> 16) | value & 0xFFFF;
                    assert_ne!(high, inputs & 0xFFFF, "both at {at_ns}");
                    changes.push(at_ns);
                }
            }
            changes
        })
    }

    /// Looks at the fitted EEPROM, or changes it.
    pub fn eeprom<T: Send + 'static>(
        &self,
        work: impl FnOnce(&mut Eeprom) -> T + Send + 'static,
    ) -> T {
        self.i2c_bus(|bus, _| work(bus.eeprom.as_mut().expect("it is fitted")))
    }

    /// The true pose, seen from where the robot started.
    pub fn pose(&self) -> Pose2 {
        let start = self.world(|world| world.room().start);
        self.truth().pose.relative_to(&start)
    }

    /// The faster wheel's speed, degrees a second.
    pub fn max_wheel_deg_s(&self) -> f64 {
        let Sides { left, right } = self.truth().wheel_deg_s;
        left.abs().max(right.abs())
    }

    /// The log so far.
    pub fn log(&self) -> String {
        let bytes = self.board.uart();
        assert!(bytes.is_ascii(), "the log is ASCII");
        String::from_utf8(bytes).expect("ASCII is UTF-8")
    }

    /// Fails where the log does not have a text.
    #[track_caller]
    pub fn assert_logged(&self, text: &str) {
        let log = self.log();
        assert!(log.contains(text), "the log does not say `{text}`:\n{log}");
    }

    /// Becomes READY.
    #[track_caller]
    pub fn assert_ready(&self) {
        assert!(self.await_ready(), "{}", self.log());
    }

    /// One chip-select at 8 MHz: what the STM sent meanwhile.
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

    /// Lets time pass until at most 10 µs after a tick.
    #[track_caller]
    pub fn run_to_tick(&self) {
        self.trace_writes(TIM5_CCR1);
        let is_tick = |write: &RegisterWrite| write.address == TIM5_CCR1;
        let ticked = |board: &Board| take_writes(board).iter().any(is_tick);
        let _ = ticked(self);
        assert!(self.run_until(10_100, 10, ticked));
    }

    /// Whether both motors get nothing.
    pub fn motors_off(&self) -> bool {
        self.board.truth().duty == Sides::default()
    }

    /// Ends the check of what the firmware touches: from here on an injected fault has it refused.
    pub fn end_check(&mut self) {
        self.assert_modelled();
        self.release = false;
    }

    /// Fails where the firmware touched something that no model covers.
    pub fn assert_modelled(&self) {
        let unmodelled = self.board.unmodelled();
        assert!(unmodelled.is_empty(), "{unmodelled:#?}");
    }
}

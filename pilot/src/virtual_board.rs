//! The virtual board: the firmware's ELF on the emulated STM32, behind the same traits as the real
//! buses. Its EEPROM lives in a file from run to run; the robot boots in each run.

use crate::ground_truth::{GroundTruth, Point};
use host_link::board_io::{BoardIo, I2c, Interrupt, delay, i2c, input, output, spi};
use host_link::eeprom::image;
use host_link::error::Error;
use host_link::file::{self, Kind};
use plant::{Params, Pose2, Rng, Room};
use std::fmt::Write;
use std::path::{Path, PathBuf};
use twin::Board;
use twin::hal::{Line, SpiTiming};
pub use twin::processor::keep_to_one as keep_to_one_processor;

/// Which virtual board.
pub struct Options {
    /// The firmware.
    pub elf: PathBuf,
    /// A room file; the default room without it.
    pub room: Option<PathBuf>,
    /// Seed of everything random.
    pub seed: u64,
    /// The figures of the robot and of the air, independent of the EEPROM; the true ones, but for imperfections.
    pub params: Params,
    /// SPI clock, hertz.
    pub spi_hz: u32,
    /// The EEPROM's content from run to run; a blank part if the file does not exist.
    pub eeprom_image: PathBuf,
    /// Where to write the STM's log, if anywhere.
    pub uart_log: Option<PathBuf>,
}

/// Measures the virtual robot as a person with a tape does.
pub struct SimulatedTape {
    board: Board,
    marks: Pose2,
    rng: Rng,
}

impl SimulatedTape {
    /// The robot's position now becomes its marks; `seed` draws the noise of the readings.
    pub fn new(board: &Board, seed: u64) -> Self {
        Self {
            board: board.clone(),
            marks: board.truth().pose,
            rng: Rng::new(seed),
        }
    }
}

impl GroundTruth for SimulatedTape {
    fn put_back(&mut self) {
        let marks = self.marks;
        self.board.world(move |world| {
            let back = marks.relative_to(&world.pose());
            world.push(&back);
        });
    }

    fn measure(&mut self, deviation_mm: f64) -> Point {
        let true_end = self.board.truth().pose.relative_to(&self.marks);
        let mut read = |mm: f64| mm + deviation_mm * self.rng.normal();
        Point::new(read(true_end.x_mm), read(true_end.y_mm))
    }
}

/// The EEPROM's bus. Each write cycle goes to the EEPROM's file at once: a killed process loses none.
fn persistent_i2c(board: &Board, file: PathBuf) -> Box<I2c> {
    let (board, mut bus, mut writes) = (board.clone(), i2c(board.i2c()), 0);
    Box::new(move |address, write, read| {
        bus(address, write, read)?;
        let known = writes;
        let fresh = board.i2c_bus(move |bus, _| {
            let part = bus.eeprom.as_ref().filter(|part| part.writes() > known)?;
            Some((part.writes(), part.bytes().to_vec()))
        });
        if let Some((now, bytes)) = fresh {
            // A file that cannot be written is reported by `close`.
            let _ = file::save(&file, Kind::Any, &bytes);
            writes = now;
        }
        Ok(())
    })
}

/// A virtual board whose EEPROM lives in a file.
pub struct VirtualBoard {
    /// The board itself: the truth, faults, the log.
    pub board: Board,
    eeprom_image: PathBuf,
    uart_log: Option<PathBuf>,
}

/// The I/O of a board.
pub fn board_io(board: &Board, spi_hz: u32, interrupt: Interrupt) -> BoardIo {
    let (clock, log, mut read, mut set) = (board.clone(), board.clone(), 0, 0);
    BoardIo {
        spi: spi(board.spi_with(SpiTiming {
            hz: spi_hz.into(),
            ..SpiTiming::default()
        })),
        i2c: i2c(board.i2c()),
        reset: output(board.pin(Line::Reset)),
        select: output(board.pin(Line::Select)),
        protect: output(board.pin(Line::WriteProtect)),
        ready: input(board.pin(Line::Ready)),
        delay: delay(board.delay()),
        clock: Box::new(move || clock.now_us()),
        real_time: false,
        log: Box::new(move |baud| {
            if std::mem::replace(&mut set, baud) != baud {
                log.set_receiver(baud);
            }
            let fresh = log.uart_from(read);
            read += fresh.len();
            Ok(fresh)
        }),
        interrupt,
    }
}

/// Builds the board, boots the firmware on it and gives its I/O.
///
/// # Errors
/// [`Error::Unreadable`] and [`Error::Content`] for the files, [`Error::Device`] if the firmware does
/// not fit the board.
pub fn open(options: Options, interrupt: Interrupt) -> Result<(VirtualBoard, BoardIo), Error> {
    if !options.elf.exists() {
        let name = format!("the firmware {}", options.elf.display());
        let advice = "build it with `cargo xtask firmware`, or name one with --elf";
        return Err(Error::device(name, "there is no such file", advice));
    }
    let elf = file::read(&options.elf, MAX_ELF)?;
    let room = options.room.as_deref();
    let room = room.map_or_else(|| Ok(Room::two_rooms()), load_room)?;
    file::check(&options.eeprom_image, Kind::Image)?;
    let eeprom = match file::read(&options.eeprom_image, image::LARGEST_LEN as u64) {
        Err(_) if !options.eeprom_image.exists() => Vec::new(),
        read => read?,
    };
    if let Some(log) = &options.uart_log {
        file::check(log, Kind::Log)?;
    }
    let built = twin::Options {
        seed: options.seed,
        room,
        params: options.params,
        ..twin::Options::with_eeprom(eeprom)
    };
    let board = Board::new(&elf, built).map_err(|cause| {
        let name = format!("the virtual board with {}", options.elf.display());
        Error::device(
            name,
            cause,
            "build the firmware with `cargo xtask firmware`",
        )
    })?;
    let mut io = board_io(&board, options.spi_hz, interrupt);
    io.i2c = persistent_i2c(&board, options.eeprom_image.clone());
    let virtual_board = VirtualBoard {
        board,
        eeprom_image: options.eeprom_image,
        uart_log: options.uart_log,
    };
    Ok((virtual_board, io))
}

/// Largest firmware that is read, bytes.
const MAX_ELF: u64 = 64 << 20;

/// The room of a file.
///
/// # Errors
/// Where it cannot be read, or its first malformed line.
pub fn load_room(path: &Path) -> Result<Room, Error> {
    Room::parse(&file::read_text(path)?).map_err(|error| {
        let what = error.problem.to_string();
        Error::content(path, error.line, what)
    })
}

/// Lines of the log shown when the STM does not start.
const TAIL_LINES: usize = 4;

impl VirtualBoard {
    /// The last lines of the STM's log, each marked as such.
    pub fn log_tail(&self) -> String {
        let log = self.board.uart();
        let log = String::from_utf8_lossy(&log);
        let lines: Vec<&str> = log.lines().collect();
        let from = lines.len().saturating_sub(TAIL_LINES);
        let mut words = String::new();
        for line in lines.iter().skip(from) {
            let _ = writeln!(words, "STM log: {line}");
        }
        words
    }

    /// Keeps the EEPROM's content and the log.
    ///
    /// # Errors
    /// [`Error::Unwritable`]; [`Error::Device`] if the emulation has ended.
    pub fn close(self) -> Result<(), Error> {
        if let Some(path) = &self.uart_log {
            file::save(path, Kind::Log, &self.board.uart())?;
        }
        let bytes = self.board.try_stopped(|stopped| {
            stopped.i2c_bus(|bus, _| bus.eeprom.as_ref().map(|part| part.bytes().to_vec()))
        });
        let ended = |cause| Error::device("the virtual board", cause, "read its report above");
        let bytes = bytes.map_err(ended)?;
        file::save(&self.eeprom_image, Kind::Any, &bytes.unwrap_or_default())
    }
}

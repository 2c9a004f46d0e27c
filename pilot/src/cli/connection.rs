//! The robot that the options choose: its lock, its I/O, and the repair of what a killed run left.

use super::args::BoardArgs;
use super::output::Output;
use host_link::board_io::{BoardIo, Interrupt};
use host_link::eeprom::image;
use host_link::eeprom::journal::Journal;
use host_link::eeprom::repair::{self, Repaired};
use host_link::error::Error;
use host_link::session::Session;
use pilot::ground_truth::GroundTruth;
use std::fs::{self, File, TryLockError};
use std::io::Write;
use std::path::{Path, PathBuf};
use std::sync::OnceLock;

/// What every command has: the options that choose the robot, and the output.
#[derive(Clone, Copy)]
pub struct Context<'a> {
    pub board: &'a BoardArgs,
    pub output: Output,
}

/// An open robot.
pub struct Connection {
    pub io: BoardIo,
    /// Of an unfinished EEPROM write.
    pub journal: Journal,
    /// The virtual robot's true position.
    pub truth: Option<Box<dyn GroundTruth>>,
}

impl Context<'_> {
    /// Opens the chosen robot, holds its lock, repairs what a killed run left, and runs `job`.
    ///
    /// # Errors
    /// Those of opening and of `job`.
    pub fn with_board<T>(
        self,
        job: impl FnOnce(&mut Connection) -> Result<T, Error>,
    ) -> Result<T, Error> {
        let interrupt = interrupt()?;
        if self.state_file(TUNE_MODE).exists() {
            self.output.warn(
                "an earlier `tune` did not finish; its mode may still be in the EEPROM. The next \
                 `robot tune` restores what was there (`robot tune rollback` does nothing else).",
            );
        }
        if self.board.virtual_board.chosen {
            self.on_virtual_board(interrupt, job)
        } else {
            self.on_this_computer(interrupt, job)
        }
    }

    /// Reads the EEPROM and starts exchanging frames.
    pub fn open_session<'io>(&self, io: &'io mut BoardIo) -> Result<Session<'io>, Error> {
        Session::open(io, self.board.rate, self.board.ready_timeout)
    }

    /// Where something about this robot is kept from run to run.
    pub fn state_file(&self, name: &str) -> PathBuf {
        if self.board.virtual_board.chosen {
            image::with_suffix(&self.board.virtual_board.eeprom_image, &format!(".{name}"))
        } else {
            self.board.state_dir.join(format!("robot-{name}"))
        }
    }

    /// Runs the job on an open robot whose lock is held.
    #[cfg_attr(not(any(feature = "linux", feature = "virtual")), allow(dead_code))]
    fn run<T>(
        self,
        connection: &mut Connection,
        lock: &mut Lock,
        job: impl FnOnce(&mut Connection) -> Result<T, Error>,
    ) -> Result<T, Error> {
        if lock.killed {
            let text = "the last run was killed; EEPROM protection and bus are restored";
            self.output.warn(text);
        }
        let Connection { io, journal, .. } = connection;
        let repaired = repair::repair(io, journal, lock.killed, self.board.ready_timeout)?;
        lock.killed = false;
        match repaired {
            Repaired::Nothing => {}
            Repaired::Reset { due: true } => self
                .output
                .warn("the EEPROM had been written; the STM has been reset to read it"),
            Repaired::Reset { due: false } => {
                self.output.warn("the STM was not ready and has been reset");
            }
            Repaired::RolledBack { bytes } => self.output.warn(&format!(
                "an earlier EEPROM write did not finish and is undone: {bytes} bytes are what they were \
                 before it, and the STM has been reset"
            )),
        }
        job(connection)
    }

    #[cfg(feature = "linux")]
    fn on_this_computer<T>(
        self,
        interrupt: Interrupt,
        job: impl FnOnce(&mut Connection) -> Result<T, Error>,
    ) -> Result<T, Error> {
        use host_link::linux::{Devices, open};
        let board = self.board;
        let mut lock = Lock::take(&board.state_dir.join("robot.lock"))?;
        let devices = Devices {
            spi: board.spi.clone(),
            spi_hz: board.spi_hz,
            i2c: board.i2c.clone(),
            gpiochip: board.gpiochip.clone(),
            uart: board.uart.clone(),
        };
        let mut connection = Connection {
            io: open(&devices, interrupt)?,
            journal: Journal::new(self.state_file("eeprom.before")),
            truth: None,
        };
        self.run(&mut connection, &mut lock, job)
    }

    #[cfg(not(feature = "linux"))]
    fn on_this_computer<T>(
        self,
        _: Interrupt,
        _: impl FnOnce(&mut Connection) -> Result<T, Error>,
    ) -> Result<T, Error> {
        Err(not_built(
            "this computer's buses",
            "linux",
            " or give --virtual",
        ))
    }

    #[cfg(feature = "virtual")]
    fn on_virtual_board<T>(
        self,
        interrupt: Interrupt,
        job: impl FnOnce(&mut Connection) -> Result<T, Error>,
    ) -> Result<T, Error> {
        use pilot::virtual_board::{SimulatedTape, open};
        let options = self.board.virtual_options();
        let mut lock = Lock::take(&image::with_suffix(&options.eeprom_image, ".lock"))?;
        let (virtual_board, io) = open(&options, interrupt)?;
        let mut connection = Connection {
            io,
            journal: Journal::new(self.state_file("before")),
            truth: Some(Box::new(SimulatedTape::new(&virtual_board.board))),
        };
        let outcome = self.run(&mut connection, &mut lock, job);
        if let Err(Error::NotReady { .. }) = outcome {
            self.output.message(virtual_board.log_tail().trim_end());
        }
        let closed = virtual_board.close();
        outcome.and_then(|done| closed.map(|()| done))
    }

    #[cfg(not(feature = "virtual"))]
    fn on_virtual_board<T>(
        self,
        _: Interrupt,
        _: impl FnOnce(&mut Connection) -> Result<T, Error>,
    ) -> Result<T, Error> {
        Err(not_built("the virtual board", "virtual", ""))
    }
}

#[cfg(not(all(feature = "linux", feature = "virtual")))]
fn not_built(name: &str, feature: &str, otherwise: &str) -> Error {
    Error::Device {
        name: name.into(),
        cause: format!("this `robot` was built without the feature `{feature}`"),
        advice: format!(
            "build it with `cargo build --release -p pilot --features {feature}`{otherwise}"
        ),
    }
}

/// The flag that Ctrl-C raises; its handler can be installed only once.
fn interrupt() -> Result<Interrupt, Error> {
    static INTERRUPT: OnceLock<Interrupt> = OnceLock::new();
    if let Some(installed) = INTERRUPT.get() {
        return Ok(installed.clone());
    }
    let interrupt = INTERRUPT.get_or_init(Interrupt::new).clone();
    let raised = interrupt.clone();
    ctrlc::set_handler(move || raised.raise()).map_err(|cause| Error::Device {
        name: "the handler of Ctrl-C".into(),
        cause: cause.to_string(),
        advice: "start the program in another way".into(),
    })?;
    Ok(interrupt)
}

/// One process at a time uses a robot. The system releases the lock when the process ends, also by a
/// kill; the file is emptied by an orderly end only.
#[cfg_attr(not(any(feature = "linux", feature = "virtual")), allow(dead_code))]
struct Lock {
    file: File,
    /// The last holder was killed, and that has not been repaired yet.
    killed: bool,
}

#[cfg_attr(not(any(feature = "linux", feature = "virtual")), allow(dead_code))]
impl Lock {
    fn take(path: &Path) -> Result<Self, Error> {
        let unwritable = |cause| Error::unwritable(path, &cause);
        if let Some(folder) = path.parent() {
            fs::create_dir_all(folder).map_err(|cause| Error::unwritable(folder, &cause))?;
        }
        let mut options = File::options();
        options.create(true).truncate(false).write(true);
        let mut file = options.open(path).map_err(unwritable)?;
        match file.try_lock() {
            Ok(()) => {}
            Err(TryLockError::WouldBlock) => return Err(Error::Busy { path: path.into() }),
            Err(TryLockError::Error(cause)) => return Err(unwritable(cause)),
        }
        let killed = file.metadata().map_err(unwritable)?.len() > 0;
        file.write_all(b"held\n").map_err(unwritable)?;
        Ok(Self { file, killed })
    }
}

impl Drop for Lock {
    fn drop(&mut self) {
        if !self.killed {
            // If that fails, the next run repairs what needs none.
            let _ = self.file.set_len(0);
        }
    }
}

/// What the EEPROM held before a measurement changed its mode.
pub const TUNE_MODE: &str = "tune-mode.before";

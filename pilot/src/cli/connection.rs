//! Which robot: opens the machine that the options choose, and runs one job on it.

use super::args::Robot;
use super::output::Output;
use host_link::board_io::{Interrupt, Machine, Wires};
use host_link::eeprom::journal::Journal;
use host_link::eeprom::repair::{self, Repaired};
use host_link::error::{Error, Exit};
use host_link::reset;
use serde::Serialize;
use std::fs::{self, File, TryLockError};
use std::io::Write;
use std::path::{Path, PathBuf};
use std::sync::OnceLock;

/// Something to do with a machine, whichever it is.
pub trait Job {
    /// What comes of it.
    type Result;

    /// Does it.
    fn run<W: Wires>(
        self,
        machine: &mut Machine<W>,
        journal: &Journal,
    ) -> Result<Self::Result, Error>;
}

/// Opens the chosen machine, holds its lock, repairs what a killed run left, and runs the job.
pub fn with_machine<J: Job>(robot: &Robot, job: J) -> Result<J::Result, Error> {
    let interrupt = interrupt()?;
    if kept(robot, TUNE_MODE).exists() {
        eprintln!(
            "host-link: an earlier `tune` did not finish; its mode may still be in the EEPROM. The next \
             `host-link tune` restores what was there (`tune rollback` does nothing else)."
        );
    }
    if robot.board.chosen {
        on_virtual_board(robot, interrupt, job)
    } else {
        on_this_computer(robot, interrupt, job)
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

/// Runs the job on an opened machine whose lock is held.
#[cfg_attr(not(any(feature = "linux", feature = "virtual")), allow(dead_code))]
fn work<W: Wires, J: Job>(
    machine: &mut Machine<W>,
    journal: &Journal,
    lock: &mut Lock,
    ready_timeout: u32,
    job: J,
) -> Result<J::Result, Error> {
    if lock.killed {
        eprintln!("host-link: the last run was killed; protection and bus are brought back");
    }
    let repaired = repair::repair(machine, journal, lock.killed, ready_timeout)?;
    lock.killed = false;
    match repaired {
        Repaired::Nothing => {}
        Repaired::Reset { due: true } => {
            eprintln!("host-link: the EEPROM had been written; the STM has been reset to read it");
        }
        Repaired::Reset { due: false } => {
            eprintln!("host-link: the STM was not ready and has been reset");
        }
        Repaired::Undone { bytes } => eprintln!(
            "host-link: an earlier EEPROM write did not finish and is undone: {bytes} bytes are what they were \
             before it, and the STM has been reset"
        ),
    }
    job.run(machine, journal)
}

/// One host-link at a time talks to a robot. The lock goes when the file is closed, also by a kill;
/// what stands in the file goes with an orderly end only.
#[cfg_attr(not(any(feature = "linux", feature = "virtual")), allow(dead_code))]
struct Lock {
    file: File,
    /// The last holder did not end in an orderly way, and that has not been repaired yet.
    killed: bool,
}

#[cfg_attr(not(any(feature = "linux", feature = "virtual")), allow(dead_code))]
impl Lock {
    fn take(path: &Path) -> Result<Self, Error> {
        let unwritable = |cause| Error::unwritable(path, &cause);
        if let Some(folder) = path.parent() {
            fs::create_dir_all(folder).map_err(|cause| Error::unwritable(folder, &cause))?;
        }
        let mut file = File::options()
            .create(true)
            .truncate(false)
            .write(true)
            .open(path)
            .map_err(unwritable)?;
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

/// `path` with something added to its name.
fn beside(path: &Path, ending: &str) -> PathBuf {
    let mut name = path.as_os_str().to_owned();
    name.push(ending);
    name.into()
}

/// What the EEPROM held before a measurement changed its mode.
pub const TUNE_MODE: &str = "tune-mode.before";

/// Where something about this robot is kept from run to run.
pub fn kept(robot: &Robot, name: &str) -> PathBuf {
    if robot.board.chosen {
        beside(&robot.board.eeprom_image, &format!(".{name}"))
    } else {
        robot.state_dir.join(format!("host-link-{name}"))
    }
}

#[cfg(feature = "linux")]
fn on_this_computer<J: Job>(
    robot: &Robot,
    interrupt: Interrupt,
    job: J,
) -> Result<J::Result, Error> {
    use host_link::linux::{open, Devices};
    let mut lock = Lock::take(&robot.state_dir.join("host-link.lock"))?;
    let devices = Devices {
        spi: robot.spi.clone(),
        spi_hz: robot.spi_hz,
        i2c: robot.i2c.clone(),
        gpiochip: robot.gpiochip.clone(),
        uart: robot.uart.clone(),
    };
    let mut machine = open(&devices, interrupt)?;
    work(
        &mut machine,
        &Journal::new(robot.state_dir.join("host-link-eeprom.before")),
        &mut lock,
        robot.ready_timeout,
        job,
    )
}

#[cfg(not(feature = "linux"))]
fn on_this_computer<J: Job>(_: &Robot, _: Interrupt, _: J) -> Result<J::Result, Error> {
    Err(Error::Device {
        name: "this computer's buses".into(),
        cause: "this host-link was built without the feature `linux`".into(),
        advice:
            "build it with `cargo build --release -p host-link --features linux`, or give --virtual"
                .into(),
    })
}

#[cfg(feature = "virtual")]
fn on_virtual_board<J: Job>(
    robot: &Robot,
    interrupt: Interrupt,
    job: J,
) -> Result<J::Result, Error> {
    use pilot::virtual_board::{open, Options};
    let board = &robot.board;
    let mut lock = Lock::take(&beside(&board.eeprom_image, ".lock"))?;
    let options = Options {
        elf: board.elf.clone(),
        room: board.room.clone(),
        chassis: plant::Chassis {
            wheel_diameter_mm: plant::Sides::new(
                board.true_diameter_left,
                board.true_diameter_right,
            ),
            track_mm: board.true_track,
            ..plant::Chassis::default()
        },
        seed: board.seed,
        air_c: board.air,
        spi_hz: robot.spi_hz,
        eeprom_image: board.eeprom_image.clone(),
        uart_log: board.uart_log.clone(),
    };
    let mut opened = open(&options, interrupt)?;
    let journal = Journal::new(beside(&board.eeprom_image, ".before"));
    let outcome = work(
        &mut opened.machine,
        &journal,
        &mut lock,
        robot.ready_timeout,
        job,
    );
    if let Err(Error::NotReady { .. }) = outcome {
        eprint!("{}", opened.last_words());
    }
    let closed = opened.close();
    outcome.and_then(|done| closed.map(|()| done))
}

#[cfg(not(feature = "virtual"))]
fn on_virtual_board<J: Job>(_: &Robot, _: Interrupt, _: J) -> Result<J::Result, Error> {
    Err(Error::Device {
        name: "the virtual board".into(),
        cause: "this host-link was built without the feature `virtual`".into(),
        advice: "build it with `cargo build --release -p host-link --features virtual \
                 --ignore-rust-version`"
            .into(),
    })
}

/// The command `reset`.
pub struct Reset<'a> {
    pub robot: &'a Robot,
    pub output: Output,
}

impl Job for Reset<'_> {
    type Result = Exit;

    fn run<W: Wires>(self, machine: &mut Machine<W>, _: &Journal) -> Result<Exit, Error> {
        #[derive(Serialize)]
        struct Done {
            ready_ms: u32,
        }
        let ready_ms = reset::restart(machine, self.robot.ready_timeout)?;
        self.output.result(&Done { ready_ms }, || {
            format!("STM reset; ready after {ready_ms} ms")
        });
        Ok(Exit::Ok)
    }
}

//! Which robot: opens the machine that the options choose, and runs one job on it.

use super::args::Robot;
use super::report::Output;
use host_link::eeprom::journal::Journal;
use host_link::error::{Error, Exit};
use host_link::machine::{Interrupt, Machine, Wires};
use host_link::reset;
use serde::Serialize;
use std::fs::{self, File, TryLockError};
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
    job: J,
) -> Result<J::Result, Error> {
    if journal.unfinished() {
        eprintln!(
            "host-link: an earlier EEPROM write did not finish. Protection and bus are restored now; what \
             the EEPROM held before is in {} (`host-link eeprom restore` brings it back).",
            journal.path().display()
        );
    }
    machine.rest()?;
    job.run(machine, journal)
}

/// One host-link at a time talks to a robot. The lock goes when the file is closed, also by a kill.
#[cfg_attr(not(any(feature = "linux", feature = "virtual")), allow(dead_code))]
fn lock(path: &Path) -> Result<File, Error> {
    if let Some(folder) = path.parent() {
        fs::create_dir_all(folder).map_err(|cause| Error::unwritable(folder, &cause))?;
    }
    let file = File::options()
        .create(true)
        .truncate(false)
        .write(true)
        .open(path)
        .map_err(|cause| Error::unwritable(path, &cause))?;
    match file.try_lock() {
        Ok(()) => Ok(file),
        Err(TryLockError::WouldBlock) => Err(Error::Busy { path: path.into() }),
        Err(TryLockError::Error(cause)) => Err(Error::unwritable(path, &cause)),
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
    let _lock = lock(&robot.state_dir.join("host-link.lock"))?;
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
    use host_link::virtual_board::{open, Options};
    let board = &robot.board;
    let _lock = lock(&beside(&board.eeprom_image, ".lock"))?;
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
        spi_hz: robot.spi_hz,
        eeprom_image: board.eeprom_image.clone(),
        uart_log: board.uart_log.clone(),
    };
    let mut opened = open(&options, interrupt)?;
    let journal = Journal::new(beside(&board.eeprom_image, ".before"));
    let outcome = work(&mut opened.machine, &journal, job);
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

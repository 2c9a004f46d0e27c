//! The robot that the options choose: its lock, its I/O, and the repair of what a killed run left.

use super::board_args::{self, BoardArgs};
use super::lock::Lock;
use super::output::Output;
use clap::ArgMatches;
use host_link::board_io::{BoardIo, Interrupt};
use host_link::eeprom::journal::Journal;
use host_link::eeprom::repair::{self, Repaired};
use host_link::error::Error;
use host_link::file;
use host_link::session::Session;
use pilot::borrowed::Borrowed;
use pilot::client::Client;
use pilot::drive;
use pilot::ground_truth::GroundTruth;
use pilot::serve::control;
use pilot::serve::hub::Hub;
use signal_hook::consts::{SIGHUP, SIGINT, SIGTERM};
use signal_hook::flag;
use std::fs;
use std::panic::resume_unwind;
use std::path::{Path, PathBuf};
use std::sync::OnceLock;
use std::thread;

/// What every command has: the command line, the options that choose the robot, and the output.
#[derive(Clone, Copy)]
pub struct Context<'a> {
    pub matches: &'a ArgMatches,
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

/// Ends a connection; the flag is set if the STM did not start.
type Finish = Box<dyn FnOnce(bool) -> Result<(), Error>>;

impl Context<'_> {
    /// Joins the server of the chosen robot, if one runs.
    ///
    /// # Errors
    /// Those of [`Client::connect`] and [`board_args::check_joined`].
    pub fn server(self) -> Result<Option<Client>, Error> {
        let name = format!("{} ({})", self.command(), std::process::id());
        let server = Client::connect(&self.state_file("sock"), &name)?;
        if server.is_some() {
            board_args::check_joined(self.matches)?;
        }
        Ok(server)
    }

    fn command(&self) -> &str {
        self.matches.subcommand_name().unwrap_or_default()
    }

    /// Runs `job` on the chosen robot: borrows it where a server owns it, or opens it.
    ///
    /// # Errors
    /// Those of opening and of `job`.
    // Requirement: SERVE-borrow-1
    pub fn with_board<T>(
        self,
        job: impl FnOnce(&mut Connection) -> Result<T, Error>,
    ) -> Result<T, Error> {
        let Some(client) = self.server()? else {
            #[cfg(feature = "virtual")]
            if self.board.virtual_board.chosen {
                pilot::virtual_board::keep_to_one_processor();
            }
            return self.with_own_board(job);
        };
        let borrowed = Borrowed::new(client)?;
        let mut connection = Connection {
            io: borrowed.io(interrupt()?),
            journal: self.journal(),
            truth: None,
        };
        let outcome = job(&mut connection);
        // Why the robot was taken back is the cause of what `job` reports.
        borrowed.give_back().and(outcome)
    }

    /// Opens the chosen robot, holds its lock, repairs what a killed run left, and runs `job`.
    ///
    /// # Errors
    /// Those of opening and of `job`.
    pub fn with_own_board<T>(
        self,
        job: impl FnOnce(&mut Connection) -> Result<T, Error>,
    ) -> Result<T, Error> {
        let interrupt = interrupt()?;
        let device = (!self.board.virtual_board.chosen).then_some(self.board.spi.as_path());
        let mut lock = Lock::take(&self.state_file("lock"), device)?;
        let (io, truth, finish) = if self.board.virtual_board.chosen {
            open_virtual(self, interrupt)?
        } else {
            open_linux(self, self.board.spi_hz, interrupt)?
        };
        let journal = self.journal();
        let mut connection = Connection { io, journal, truth };
        let outcome = self
            .repair(&mut connection, &mut lock)
            .and_then(|()| job(&mut connection));
        let finished = finish(matches!(outcome, Err(Error::NotReady { .. })));
        let outcome = outcome.map_err(|error| error.of_image(self.image_file(None)));
        self.output.both(outcome, finished)
    }

    /// The image file that is given, or the virtual robot's.
    pub fn image_file<'f>(&'f self, given: Option<&'f Path>) -> Option<&'f Path> {
        let own = &self.board.virtual_board;
        given.or(own.chosen.then_some(own.eeprom_image.as_path()))
    }

    /// Of an EEPROM write.
    pub fn journal(&self) -> Journal {
        Journal::new(self.state_file("eeprom.before"))
    }

    /// Runs `job` as a client of the robot's server, or of one in this process, after `prepare`.
    ///
    /// # Errors
    /// Those of opening, of serving and of `job`.
    pub fn with_client<T: Send>(
        self,
        prepare: impl FnOnce(&mut Connection) -> Result<(), Error>,
        job: impl FnOnce(&mut Client) -> Result<T, Error> + Send,
    ) -> Result<T, Error> {
        if let Some(mut client) = self.server()? {
            return job(&mut client);
        }
        self.with_own_board(|connection| {
            prepare(connection)?;
            let options = control::Options {
                rate_hz: self.board.rate,
                ready_timeout_ms: self.board.ready_timeout,
                body_mm: self.board.body_radius,
                speed: self.board.virtual_board.chosen.then_some(1.0),
                journal: None,
            };
            let (hub, events) = Hub::new();
            // Ctrl-C ends the client, and its end the server.
            let io = &mut connection.io;
            let interrupt = std::mem::replace(&mut io.interrupt, Interrupt::new());
            let ended = io.interrupt.raised_on_drop();
            thread::scope(|scope| {
                let client = scope.spawn(move || {
                    let _ended = ended;
                    let port = hub.admit().ok_or(Error::Interrupted)?;
                    job(&mut Client::local(port, self.command(), &interrupt)?)
                });
                let served = control::run(io, &options, events);
                let done = client.join().unwrap_or_else(|panic| resume_unwind(panic));
                served.and(done)
            })
        })
    }

    /// Reads the EEPROM and starts exchanging frames.
    pub fn open_session<'io>(&self, io: &'io mut BoardIo) -> Result<Session<'io>, Error> {
        drive::open_session(io, self.board.rate, self.board.ready_timeout)
    }

    /// Where something about this robot is kept from run to run.
    pub fn state_file(&self, name: &str) -> PathBuf {
        if let Some(image) = self.image_file(None) {
            file::with_suffix(image, &format!(".{name}"))
        } else {
            let spi = &self.board.spi;
            let device = fs::canonicalize(spi).unwrap_or_else(|_| spi.clone());
            let device = device.file_name().unwrap_or_default().to_string_lossy();
            let chosen = self.board.state_dir.as_deref();
            let package = Some(Path::new("/var/lib/robot")).filter(|path| path.is_dir());
            let folder = chosen.or(package).unwrap_or(Path::new("/var/tmp"));
            folder.join(format!("robot-{device}-{name}"))
        }
    }

    /// Repairs what a killed run left, and reports it.
    fn repair(self, connection: &mut Connection, lock: &mut Lock) -> Result<(), Error> {
        if lock.killed {
            let text = "the last run was killed; EEPROM protection and bus are restored";
            self.output.warn(text);
        }
        let Connection { io, journal, .. } = connection;
        let repaired = repair::repair(io, journal, lock.killed, self.board.ready_timeout)?;
        lock.killed = false;
        let text = match repaired {
            Repaired::Nothing => return Ok(()),
            Repaired::Reset { due: true } => {
                "the EEPROM had been written; the STM has been reset to read it".into()
            }
            Repaired::Reset { due: false } => "the STM was not ready and has been reset".into(),
            Repaired::RolledBack { bytes } => format!(
                "an earlier EEPROM write or measurement did not finish and is undone: {bytes} bytes are what \
                 they were before it, and the STM has been reset"
            ),
        };
        self.output.warn(&text);
        Ok(())
    }
}

type Opened = (BoardIo, Option<Box<dyn GroundTruth>>, Finish);

/// The real robot's I/O, its SPI at `spi_hz`.
#[cfg(feature = "linux")]
pub fn open_linux(
    context: Context<'_>,
    spi_hz: u32,
    interrupt: Interrupt,
) -> Result<Opened, Error> {
    let mut devices = context.board.devices();
    devices.spi_hz = spi_hz;
    let io = host_link::linux::open(&devices, interrupt)?;
    Ok((io, None, Box::new(|_| Ok(()))))
}

#[cfg(not(feature = "linux"))]
pub fn open_linux(_: Context<'_>, _: u32, _: Interrupt) -> Result<Opened, Error> {
    Err(not_built(
        "this computer's buses",
        "linux",
        ", or give --virtual",
    ))
}

#[cfg(feature = "virtual")]
fn open_virtual(context: Context<'_>, interrupt: Interrupt) -> Result<Opened, Error> {
    use pilot::virtual_board::{SimulatedTape, open};
    let (virtual_board, io) = open(context.board.virtual_options(), interrupt)?;
    let truth = SimulatedTape::new(&virtual_board.board, context.board.virtual_board.seed);
    let output = context.output;
    let finish = move |not_ready| {
        if not_ready {
            output.message(virtual_board.log_tail().trim_end());
        }
        virtual_board.close()
    };
    Ok((io, Some(Box::new(truth)), Box::new(finish)))
}

#[cfg(not(feature = "virtual"))]
fn open_virtual(_: Context<'_>, _: Interrupt) -> Result<Opened, Error> {
    Err(not_built("the virtual board", "virtual", ""))
}

#[cfg(not(all(feature = "linux", feature = "virtual")))]
fn not_built(name: &str, feature: &str, otherwise: &str) -> Error {
    let cause = format!("this `robot` was built without the feature `{feature}`");
    let build = format!("cargo build --release -p pilot --features {feature}");
    Error::device(name, cause, format!("build it with `{build}`{otherwise}"))
}

/// The flag that Ctrl-C, SIGTERM and SIGHUP raise. A SIGHUP that is ignored already, as by nohup, stays so.
pub fn interrupt() -> Result<Interrupt, Error> {
    static INTERRUPT: OnceLock<Interrupt> = OnceLock::new();
    if let Some(installed) = INTERRUPT.get() {
        return Ok(installed.clone());
    }
    let interrupt = INTERRUPT.get_or_init(Interrupt::new).clone();
    let ignored = ignored_signals(&fs::read_to_string("/proc/self/status").unwrap_or_default());
    for signal in [SIGINT, SIGTERM, SIGHUP] {
        if signal != SIGHUP || ignored & 1 << (SIGHUP - 1) == 0 {
            flag::register(signal, interrupt.flag()).map_err(|cause| {
                let advice = "start the program in another way";
                Error::device("the handler of Ctrl-C", cause, advice)
            })?;
        }
    }
    Ok(interrupt)
}

/// The mask of ignored signals in a process's status, as proc(5) describes it.
fn ignored_signals(status: &str) -> u64 {
    let mut lines = status.lines();
    let mask = lines.find_map(|line| line.strip_prefix("SigIgn:"));
    mask.and_then(|mask| u64::from_str_radix(mask.trim(), 16).ok())
        .unwrap_or_default()
}

//! The robot that the options choose: its lock, its I/O, and the repair of what a killed run left.

use super::board_args::{self, BoardArgs};
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
use std::fs::{self, File, Permissions, TryLockError};
use std::io::{self, ErrorKind, Write};
use std::os::unix::fs::{MetadataExt, PermissionsExt, fchown};
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

/// One process at a time uses a robot. The system releases the lock when the process ends, also by a
/// kill; the file is emptied by an orderly end only.
struct Lock {
    file: File,
    /// The last holder was killed, and that has not been repaired yet.
    killed: bool,
}

impl Lock {
    /// Takes the lock; it has the group of `device`.
    fn take(path: &Path, device: Option<&Path>) -> Result<Self, Error> {
        let unwritable = |cause| Error::unwritable(path, &cause);
        if let Some(folder) = path.parent() {
            fs::create_dir_all(folder).map_err(|cause| Error::unwritable(folder, &cause))?;
        }
        let mut file = open_lock(path, device).map_err(unwritable)?;
        match file.try_lock() {
            Ok(()) => {}
            Err(TryLockError::WouldBlock) => return Err(Error::Busy(path.into())),
            Err(TryLockError::Error(cause)) => return Err(unwritable(cause)),
        }
        let killed = file.metadata().map_err(unwritable)?.len() > 0;
        file.write_all(b"held\n").map_err(unwritable)?;
        Ok(Self { file, killed })
    }
}

/// Opens or makes a lock file. In a shared folder a link, or a file that is more than a lock, may wait in
/// its place.
fn open_lock(path: &Path, device: Option<&Path>) -> io::Result<File> {
    let mut options = File::options();
    options.write(true);
    // Not `create`: the kernel refuses it for the file of another user in /var/tmp.
    let file = match fs::symlink_metadata(path) {
        Err(cause) if cause.kind() == ErrorKind::NotFound => {
            let file = options.create_new(true).open(path)?;
            if let Some(device) = device {
                let group = fs::metadata(device).map(|device| device.gid());
                // Only a member of the group can give it to the group.
                let _ = group.and_then(|group| {
                    fchown(&file, None, Some(group))?;
                    file.set_permissions(Permissions::from_mode(0o660))
                });
            }
            file
        }
        Err(cause) => return Err(cause),
        Ok(present) if present.is_file() => options.open(path)?,
        Ok(_) => return Err(io::Error::other("it is a link, a folder or a device")),
    };
    let (opened, there) = (file.metadata()?, fs::symlink_metadata(path)?);
    if (opened.dev(), opened.ino()) != (there.dev(), there.ino()) || opened.len() > MAX_LOCK {
        return Err(io::Error::other("it is no lock of this program"));
    }
    Ok(file)
}

/// Longest lock file, bytes.
const MAX_LOCK: u64 = 16;

impl Drop for Lock {
    fn drop(&mut self) {
        if !self.killed {
            // If that fails, the next run repairs what needs none.
            let _ = self.file.set_len(0);
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use std::os::unix::fs::symlink;

    #[test]
    fn lock_is_shared_by_group_exclusive_and_no_link() {
        let folder = tempfile::tempdir().unwrap();
        let folder = folder.path();
        let (path, device) = (folder.join("lock"), folder.join("device"));
        fs::write(&device, "").unwrap();
        let take = |path: &Path| Lock::take(path, Some(&device));
        let held = take(&path).unwrap();
        assert!(!held.killed);
        assert_eq!(fs::metadata(&path).unwrap().mode() & 0o777, 0o660);
        assert!(matches!(take(&path), Err(Error::Busy { .. })));
        drop(held);
        fs::write(&path, "held\n").unwrap();
        assert!(take(&path).unwrap().killed);
        fs::write(&device, "a letter, not a lock").unwrap();
        let link = folder.join("link");
        symlink(&device, &link).unwrap();
        for wrong in [&link, &device, folder] {
            assert!(
                matches!(take(wrong), Err(Error::Unwritable { .. })),
                "{wrong:?}"
            );
        }
    }
}

//! What can go wrong, as one sentence each, and the exit code a script can rely on.

use std::fmt;
use std::path::PathBuf;

/// Exit codes of the `host-link` program. They are part of its interface and do not change.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
#[repr(u8)]
pub enum Exit {
    /// Done.
    Ok = 0,
    /// `eeprom diff` found differences.
    Differs = 1,
    /// The command line is wrong.
    Usage = 2,
    /// An input file is missing, unreadable or wrong.
    BadFile = 3,
    /// The EEPROM or its bus failed.
    Eeprom = 4,
    /// The configuration was rejected.
    Rejected = 5,
    /// `STM_READY` did not rise in time.
    NotReady = 6,
    /// No valid frame came over the SPI link.
    Link = 7,
    /// The target was not reached in time.
    NotReached = 8,
    /// The robot reports a fault and refuses to drive.
    Fault = 9,
    /// A device of the computer (or the virtual board) could not be opened or failed.
    Device = 10,
    /// An output file could not be written.
    Output = 11,
    /// Another host-link holds the robot.
    Busy = 12,
    /// Tuning or calibration gave nothing to go by.
    Tuning = 13,
    /// Interrupted by Ctrl-C, SIGTERM or SIGHUP.
    Interrupted = 130,
}

impl Exit {
    /// Every code with its meaning, in order, for the help text and the documentation.
    pub const ALL: [(Self, &'static str); 15] = [
        (Self::Ok, "done"),
        (Self::Differs, "`eeprom diff` found differences"),
        (Self::Usage, "wrong command line"),
        (
            Self::BadFile,
            "an input file is missing, unreadable or wrong",
        ),
        (Self::Eeprom, "the EEPROM or its bus failed"),
        (Self::Rejected, "the configuration was rejected"),
        (Self::NotReady, "STM_READY did not rise in time"),
        (
            Self::Link,
            "no valid frame over the SPI link, or the STM runs another mode",
        ),
        (Self::NotReached, "the target was not reached in time"),
        (
            Self::Fault,
            "the robot reports a fault and refuses to drive",
        ),
        (Self::Device, "a device could not be opened or failed"),
        (Self::Output, "an output file could not be written"),
        (Self::Busy, "another host-link holds the robot"),
        (
            Self::Tuning,
            "tuning or calibration gave nothing to go by; nothing was changed",
        ),
        (Self::Interrupted, "interrupted (Ctrl-C, SIGTERM, SIGHUP)"),
    ];

    /// The number the process ends with.
    #[must_use]
    pub const fn code(self) -> u8 {
        self as u8
    }
}

/// Everything that ends a command early. The text says what, where, and what to do next.
#[derive(Clone, Debug, PartialEq)]
#[non_exhaustive]
pub enum Error {
    /// An argument has no meaning.
    Usage(String),
    /// A file could not be read.
    Unreadable {
        /// The file.
        path: PathBuf,
        /// The system's reason.
        cause: String,
    },
    /// A file's content is wrong.
    Content {
        /// The file.
        path: PathBuf,
        /// 1-based line, where one can be named.
        line: Option<usize>,
        /// What is wrong and what is accepted.
        what: String,
    },
    /// The EEPROM did not acknowledge, or its bus failed.
    Eeprom {
        /// What was being done.
        doing: &'static str,
        /// Address inside the EEPROM.
        address: u16,
        /// The bus driver's reason.
        cause: String,
    },
    /// The EEPROM does not hold what was written.
    Verify {
        /// First address that differs.
        address: u16,
        /// What was written there.
        written: u8,
        /// What was read back.
        read: u8,
    },
    /// A control line could not be driven or read.
    Pin {
        /// The net's name.
        net: &'static str,
        /// The driver's reason.
        cause: String,
    },
    /// After an EEPROM command a line could not be brought back to its place of rest.
    NotRestored {
        /// The step that failed.
        step: &'static str,
        /// The driver's reason.
        cause: String,
        /// What had gone wrong before, if anything.
        first: Option<Box<Error>>,
    },
    /// The configuration is not acceptable.
    Rejected {
        /// The address in the EEPROM, or the file with its line.
        place: String,
        /// Field, value and accepted range.
        what: String,
    },
    /// The mode in the EEPROM cannot do what was asked.
    WrongMode {
        /// The mode's name.
        mode: &'static str,
        /// What was asked.
        wanted: &'static str,
    },
    /// `STM_READY` stayed low.
    NotReady {
        /// How long it was awaited, milliseconds.
        waited_ms: u32,
    },
    /// The SPI device itself failed.
    Spi(String),
    /// Frames go out, nothing valid comes back.
    Silent {
        /// For how long, milliseconds.
        ms: u64,
        /// Frames sent since the last valid one.
        frames: u32,
        /// What was wrong with the last one.
        last: String,
    },
    /// Frames go out and come back, but the STM runs another chain or has other keys.
    Stranger {
        /// The mode this end runs.
        mode: &'static str,
        /// Frames it took to find out.
        frames: u64,
        /// What shows it.
        why: String,
    },
    /// The robot did not come to rest at the target in time.
    NotReached {
        /// Seconds it was given.
        seconds: f64,
        /// Distance left, millimetres.
        off_mm: f64,
        /// Rotation left, degrees, signed.
        off_deg: f64,
    },
    /// The robot stopped or faulted while it should drive.
    Fault {
        /// Its state's name.
        state: &'static str,
        /// Names of the latched faults.
        faults: String,
    },
    /// A device could not be opened.
    Device {
        /// Which.
        name: String,
        /// The system's reason.
        cause: String,
        /// What to do next.
        advice: String,
    },
    /// A file could not be written.
    Unwritable {
        /// The file.
        path: PathBuf,
        /// The system's reason.
        cause: String,
    },
    /// Another program holds the lock.
    Busy {
        /// The lock file.
        path: PathBuf,
    },
    /// The steps or the log gave nothing to tune by.
    Tuning(String),
    /// A run or its measurement gave nothing to calibrate by.
    Calibration(String),
    /// Ctrl-C, SIGTERM or SIGHUP.
    Interrupted,
}

impl Error {
    /// The exit code a command ends with when this is its error.
    #[must_use]
    pub fn exit(&self) -> Exit {
        match self {
            Self::Usage(_) => Exit::Usage,
            Self::Unreadable { .. } | Self::Content { .. } => Exit::BadFile,
            Self::Eeprom { .. } | Self::Verify { .. } | Self::NotRestored { .. } => Exit::Eeprom,
            Self::Rejected { .. } | Self::WrongMode { .. } => Exit::Rejected,
            Self::NotReady { .. } => Exit::NotReady,
            Self::Spi(_) | Self::Silent { .. } | Self::Stranger { .. } => Exit::Link,
            Self::NotReached { .. } => Exit::NotReached,
            Self::Fault { .. } => Exit::Fault,
            Self::Pin { .. } | Self::Device { .. } => Exit::Device,
            Self::Unwritable { .. } => Exit::Output,
            Self::Busy { .. } => Exit::Busy,
            Self::Tuning(_) | Self::Calibration(_) => Exit::Tuning,
            Self::Interrupted => Exit::Interrupted,
        }
    }

    /// The content of `path` is wrong at `line`.
    pub fn content(
        path: impl Into<PathBuf>,
        line: impl Into<Option<usize>>,
        what: impl Into<String>,
    ) -> Self {
        Self::Content {
            path: path.into(),
            line: line.into(),
            what: what.into(),
        }
    }

    /// `path` could not be read.
    pub fn unreadable(path: impl Into<PathBuf>, cause: &std::io::Error) -> Self {
        Self::Unreadable {
            path: path.into(),
            cause: cause.to_string(),
        }
    }

    /// `path` could not be written.
    pub fn unwritable(path: impl Into<PathBuf>, cause: &std::io::Error) -> Self {
        Self::Unwritable {
            path: path.into(),
            cause: cause.to_string(),
        }
    }
}

impl fmt::Display for Error {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        match self {
            Self::Usage(what) => write!(f, "{what}; see `host-link help`"),
            Self::Unreadable { path, cause } => {
                write!(f, "cannot read {}: {cause}; check the path and its permissions", path.display())
            }
            Self::Content { path, line, what } => {
                write!(f, "{}", path.display())?;
                if let Some(line) = line {
                    write!(f, ", line {line}")?;
                }
                write!(f, ": {what}")
            }
            Self::Eeprom { doing, address, cause } => write!(
                f,
                "the EEPROM failed while {doing} at 0x{address:04X} ({cause}); check that I2C is enabled, \
                 that it answers at 0x50, and repeat the command"
            ),
            Self::Verify { address, written, read } => write!(
                f,
                "the EEPROM reads 0x{read:02X} at 0x{address:04X} where 0x{written:02X} was written; repeat \
                 the command, and replace the part if it happens again"
            ),
            Self::Pin { net, cause } => write!(
                f,
                "the {net} line cannot be used ({cause}); check that no other program holds its GPIO"
            ),
            Self::NotRestored { step, cause, first } => {
                if let Some(first) = first {
                    write!(f, "{first}; then ")?;
                }
                write!(
                    f,
                    "{step} failed ({cause}), so the EEPROM may be unprotected or its bus still taken; run \
                     `host-link reset`, which repairs both"
                )
            }
            Self::Rejected { place, what } => write!(
                f,
                "configuration rejected {place}: {what}; correct it and run `host-link eeprom write`"
            ),
            Self::WrongMode { mode, wanted } => write!(
                f,
                "the EEPROM selects mode {mode}, which has no {wanted}; write a configuration whose mode has it"
            ),
            Self::NotReady { waited_ms } => write!(
                f,
                "STM_READY stayed low for {waited_ms} ms: the STM refuses its configuration or does not run; \
                 run `host-link eeprom check` and read the UART log"
            ),
            Self::Spi(cause) => {
                write!(f, "the SPI device failed ({cause}); check that SPI is enabled and --spi names it")
            }
            Self::Silent { ms, frames, last } => write!(
                f,
                "no valid frame from the STM for {ms} ms ({frames} sent; the last reply: {last}); check that \
                 STM_READY is high and that keys and mode in the EEPROM are those the STM booted with \
                 (`host-link reset` makes it read them again)"
            ),
            Self::Stranger { mode, frames, why } => write!(
                f,
                "the STM does not answer in mode {mode} ({frames} frames, {why}): it runs another mode or has \
                 other keys than the EEPROM holds now, or a wire of the SPI is off; run `host-link reset`, \
                 which makes it read the EEPROM again"
            ),
            Self::NotReached { seconds, off_mm, off_deg } => write!(
                f,
                "the robot did not come to rest at its target within {seconds:.1} s: {off_mm:.1} mm and \
                 {off_deg:.2} degrees are left; look for an obstacle or give --timeout a longer time"
            ),
            Self::Fault { state, faults } => write!(
                f,
                "the robot is {state} (faults: {faults}) and will not drive; remove the cause, then run \
                 `host-link reset`"
            ),
            Self::Device { name, cause, advice } => write!(f, "cannot use {name} ({cause}); {advice}"),
            Self::Unwritable { path, cause } => {
                write!(f, "cannot write {}: {cause}; check the folder and its space", path.display())
            }
            Self::Busy { path } => write!(
                f,
                "another host-link holds the robot (lock {}); wait for it or end it",
                path.display()
            ),
            Self::Tuning(what) => write!(
                f,
                "tuning gave nothing to go by: {what}; gains and dividers are as they were"
            ),
            Self::Calibration(what) => write!(
                f,
                "the calibration came to nothing: {what}; diameters and track are as they were"
            ),
            Self::Interrupted => write!(
                f,
                "interrupted; the robot stops, and the EEPROM is protected with its bus back at the STM"
            ),
        }
    }
}

impl std::error::Error for Error {}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn the_table_of_exit_codes_is_ascending_and_so_without_doubles() {
        assert!(Exit::ALL
            .windows(2)
            .all(|pair| pair[0].0.code() < pair[1].0.code()));
    }

    #[test]
    fn the_manual_lists_every_exit_code() {
        let manual = include_str!("../../docs/pilot.md");
        for (exit, _) in Exit::ALL {
            assert!(
                manual.contains(&format!("\n| {} | ", exit.code())),
                "{exit:?}"
            );
        }
    }
}

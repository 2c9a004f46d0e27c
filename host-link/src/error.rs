//! What can go wrong, as one sentence each, and the exit code a script can rely on.

use crate::file_fault::FileFault;
use std::fmt::Display;
use std::path::{Path, PathBuf};

macro_rules! exit_codes {
    ($($name:ident = $code:literal, $meaning:literal;)+) => {
        #[allow(clippy::doc_markdown)] // the meanings are help text, too
        /// Exit codes of the program `robot`. They are part of its interface and do not change.
        #[derive(Clone, Copy, Debug, PartialEq, Eq)]
        #[repr(u8)]
        pub enum Exit {
            $(#[doc = $meaning] $name = $code,)+
        }

        impl Exit {
            /// Every code with its meaning, ascending, for the help text and the manual.
            pub const ALL: &[(Self, &str)] = &[$((Self::$name, $meaning)),+];
        }
    };
}

exit_codes! {
    Ok = 0, "done";
    Differs = 1, "`eeprom diff` found differences";
    Usage = 2, "wrong command line";
    BadFile = 3, "an input file is missing, unreadable or wrong";
    Eeprom = 4, "the EEPROM or its bus failed";
    Rejected = 5, "the configuration was rejected";
    NotReady = 6, "STM_READY did not rise in time";
    Link = 7, "no valid frame over the SPI link, or the STM runs another mode";
    NotReached = 8, "the target was not reached in time";
    Fault = 9, "the robot reports a fault that prevents driving";
    Device = 10, "a device could not be opened or failed";
    Output = 11, "an output file could not be written";
    Busy = 12, "another `robot` process uses the robot";
    Tuning = 13, "tuning or calibration has no usable result; nothing was changed";
    Findings = 14, "`doctor` found something to be done";
    Interrupted = 130, "interrupted (Ctrl-C, SIGTERM, SIGHUP)";
}

impl Exit {
    /// The number the process ends with.
    #[must_use]
    pub const fn code(self) -> u8 {
        self as u8
    }
}

/// Where [`Error::Rejected`] found its configuration, unless in a file or in what would be written.
pub const IN_EEPROM: &str = "in the EEPROM";

/// Everything that ends a command early. The text says what, where, and what to do next.
#[derive(Clone, Debug, PartialEq, thiserror::Error)]
#[non_exhaustive]
pub enum Error {
    /// An argument has no meaning.
    #[error("{0}")]
    Usage(String),
    /// A file could not be read; the system's reason.
    #[error("cannot read {path}: {1}", path = .0.display())]
    Unreadable(PathBuf, String),
    /// A file's content is wrong.
    #[error("{}", describe(path, faults))]
    Content {
        /// The file.
        path: PathBuf,
        /// Everything that is wrong with it, as far as one run finds it.
        faults: Vec<FileFault>,
    },
    /// The EEPROM did not acknowledge, or its bus failed.
    #[error(
        "the EEPROM failed while {doing} at 0x{address:04X} ({cause}); check that I2C is enabled, that it \
         answers at 0x50, and repeat the command"
    )]
    Eeprom {
        /// What was being done.
        doing: &'static str,
        /// Address inside the EEPROM.
        address: u16,
        /// The bus driver's reason.
        cause: String,
    },
    /// The EEPROM does not hold what was written.
    #[error(
        "the EEPROM reads 0x{read:02X} at 0x{address:04X} where 0x{written:02X} was written; repeat the \
         command, and replace the part if it happens again"
    )]
    Verify {
        /// First address that differs.
        address: u16,
        /// What was written there.
        written: u8,
        /// What was read back.
        read: u8,
    },
    /// The control line of this net could not be driven or read; the driver's reason.
    #[error("the {0} line cannot be used ({1}); check that no other program holds its GPIO")]
    Pin(&'static str, String),
    /// After an EEPROM command a line could not be brought back to its idle level.
    #[error(
        "{}{step} failed ({cause}), so the EEPROM may be unprotected or its bus not with the STM; run \
         `robot reset`, which repairs both",
        first.as_ref().map(|first| format!("{first}; then ")).unwrap_or_default()
    )]
    NotRestored {
        /// The step that failed.
        step: &'static str,
        /// Its reason.
        cause: String,
        /// What had gone wrong before, if anything.
        first: Option<Box<Error>>,
    },
    /// An EEPROM's content is not acceptable: [`IN_EEPROM`] or where else; address, field, value and accepted range.
    #[error("configuration rejected {0}: {1}; correct it and run `robot eeprom write`")]
    Rejected(String, String),
    /// The mode of this name, which the EEPROM selects, lacks what the command needs.
    #[error(
        "the EEPROM selects mode {0}, which has no {1}; write a configuration whose mode has it"
    )]
    WrongMode(&'static str, &'static str),
    /// `STM_READY` stayed low for so many milliseconds.
    #[error(
        "STM_READY stayed low for {0} ms: the STM rejects its configuration or does not run; run \
         `robot eeprom check` and read the UART log"
    )]
    NotReady(u32),
    /// The SPI device itself failed.
    #[error("the SPI device failed ({0}); check that SPI is enabled and --spi names it")]
    Spi(String),
    /// Frames go out, nothing valid comes back.
    #[error(
        "no valid frame from the STM for {ms} ms ({frames} sent; the last reply: {last}); check that \
         STM_READY is high and that keys and mode in the EEPROM are those the STM booted with \
         (`robot reset` makes it read them again)"
    )]
    Silent {
        /// For how long, milliseconds.
        ms: u64,
        /// Frames sent since the last valid one.
        frames: u32,
        /// What was wrong with the last one.
        last: String,
    },
    /// Frames go out and come back, but the STM runs another chain or has other keys.
    #[error(
        "the STM does not answer in mode {mode} ({frames} frames, {reason}): it runs another mode or has \
         other keys than the EEPROM holds now, or an SPI wire is disconnected; run `robot reset`, which \
         makes it read the EEPROM again"
    )]
    ModeMismatch {
        /// The mode this end runs.
        mode: &'static str,
        /// Frames until the mismatch was detected.
        frames: u64,
        /// What shows it.
        reason: String,
    },
    /// The robot did not come to rest at the target in time.
    #[error(
        "the robot did not come to rest at its target within {seconds:.1} s: {off_mm:.1} mm and \
         {off_deg:.2} degrees are left; {}",
        if *obstacle { "an obstacle ahead holds it: clear the way" }
        else { "look for what holds it, or give it more time" }
    )]
    NotReached {
        /// Seconds it was given.
        seconds: f64,
        /// Distance left, millimetres.
        off_mm: f64,
        /// Rotation left, degrees, signed.
        off_deg: f64,
        /// Whether the obstacle stop limited the speed at the end.
        obstacle: bool,
    },
    /// A drive by a plan ended before it was complete.
    #[error("{what} after {seconds:.0} s: {reason}")]
    Incomplete {
        /// What is left undone.
        what: &'static str,
        /// Why, and what to do.
        reason: &'static str,
        /// Seconds it took.
        seconds: f64,
    },
    /// The robot stopped or faulted while it should drive.
    #[error(
        "the robot is {state} (faults: {faults}) and will not drive; remove the cause, then run \
         `robot reset`"
    )]
    Fault {
        /// Its state's name.
        state: &'static str,
        /// Names of the latched faults.
        faults: String,
    },
    /// A rangefinder does not answer, so that what it reports looks like nothing in reach.
    #[error(
        "the {0} rangefinder does not answer: check its plug and wires, then run `robot doctor --wheels-up`"
    )]
    SilentRangefinder(&'static str),
    /// The STM restarted during a drive, so that where the robot is in the drive's frame is unknown.
    #[error("the STM restarted, which ended the drive: the pose is zero again; its log says why")]
    Restarted,
    /// A device could not be opened.
    #[error("cannot use {name} ({cause}); {advice}")]
    Device {
        /// Which.
        name: String,
        /// The system's reason.
        cause: String,
        /// What to do next.
        advice: String,
    },
    /// A file could not be written; the system's reason.
    #[error("cannot write {path}: {1}", path = .0.display())]
    Unwritable(PathBuf, String),
    /// Another process holds the lock, this file; its number, where the kernel tells it.
    #[error(
        "another `robot` process uses the robot (lock {}); wait for it, or {}",
        .0.display(),
        .1.map_or("end it".into(), |process| format!("`robot stop` ends process {process}"))
    )]
    Busy(PathBuf, Option<i32>),
    /// What a server of the robot, or the connection to it, reports.
    #[error("{text}")]
    Server {
        /// The sentence.
        text: String,
        /// The exit code.
        exit: Exit,
    },
    /// The steps or the log give no model.
    #[error("tuning has no usable result: {0}; gains and dividers are unchanged")]
    Tuning(String),
    /// A run or its measurement gives no correction.
    #[error("calibration has no usable result: {0}; diameters and track are unchanged")]
    Calibration(String),
    /// Ctrl-C, SIGTERM or SIGHUP.
    #[error("interrupted")]
    Interrupted,
    /// The reader of standard output has closed it: an orderly end.
    #[error("standard output is closed")]
    PipeClosed,
}

/// Every fault with its line, below each other.
fn describe(path: &Path, faults: &[FileFault]) -> String {
    let faults: Vec<String> = faults.iter().map(|fault| fault.describe(path)).collect();
    faults.join("\n")
}

impl Error {
    /// The exit code a command ends with when this is its error.
    pub fn exit(&self) -> Exit {
        match self {
            Self::Usage(_) => Exit::Usage,
            Self::Unreadable { .. } | Self::Content { .. } => Exit::BadFile,
            Self::Eeprom { .. } | Self::Verify { .. } | Self::NotRestored { .. } => Exit::Eeprom,
            Self::Rejected { .. } | Self::WrongMode { .. } => Exit::Rejected,
            Self::NotReady { .. } => Exit::NotReady,
            Self::Spi(_) | Self::Silent { .. } | Self::ModeMismatch { .. } => Exit::Link,
            Self::NotReached { .. } | Self::Incomplete { .. } => Exit::NotReached,
            Self::Fault { .. } | Self::SilentRangefinder(_) | Self::Restarted => Exit::Fault,
            Self::Pin { .. } | Self::Device { .. } => Exit::Device,
            Self::Unwritable { .. } => Exit::Output,
            Self::Busy { .. } => Exit::Busy,
            Self::Server { exit, .. } => *exit,
            Self::Tuning(_) | Self::Calibration(_) => Exit::Tuning,
            Self::Interrupted => Exit::Interrupted,
            Self::PipeClosed => Exit::Ok,
        }
    }

    /// The content of `path` is wrong at `line`.
    pub fn content(
        path: impl Into<PathBuf>,
        line: impl Into<Option<usize>>,
        what: impl Into<String>,
    ) -> Self {
        let (path, line) = (path.into(), line.into());
        let faults = vec![FileFault {
            line,
            ..FileFault::whole(what)
        }];
        Self::Content { path, faults }
    }

    /// The same; the content that is rejected is of this image file, if any.
    #[must_use]
    pub fn of_image(self, file: Option<&Path>) -> Self {
        match (self, file) {
            (Self::Rejected(place, what), Some(file)) if place == IN_EEPROM => {
                Self::Rejected(format!("in {}", file.display()), what)
            }
            (error, _) => error,
        }
    }

    /// The device `name` could not be used; `advice` says what to do next.
    pub fn device(name: impl Display, cause: impl Display, advice: impl Into<String>) -> Self {
        Self::Device {
            name: name.to_string(),
            cause: cause.to_string(),
            advice: advice.into(),
        }
    }

    /// `path` could not be read.
    pub fn unreadable(path: impl Into<PathBuf>, cause: &std::io::Error) -> Self {
        Self::Unreadable(path.into(), cause.to_string())
    }

    /// `path` could not be written.
    pub fn unwritable(path: impl Into<PathBuf>, cause: &impl Display) -> Self {
        Self::Unwritable(path.into(), cause.to_string())
    }
}

#[test]
fn exit_codes_are_ascending() {
    let codes = Exit::ALL.iter().map(|(exit, _)| exit.code());
    assert!(codes.eq((0..=14).chain([130])));
}

#[test]
fn exit_codes_of_link_line_server_and_reader_are_theirs() {
    let server = |exit| Error::Server {
        text: String::new(),
        exit,
    };
    let incomplete = Error::Incomplete {
        what: "cells are left",
        reason: "no way",
        seconds: 9.0,
    };
    for (error, exit) in [
        (Error::Spi(String::new()), Exit::Link),
        (Error::Pin("SELECT", String::new()), Exit::Device),
        (Error::WrongMode("Normal", "duty"), Exit::Rejected),
        (incomplete, Exit::NotReached),
        (Error::Calibration(String::new()), Exit::Tuning),
        (server(Exit::Busy), Exit::Busy),
        (server(Exit::Fault), Exit::Fault),
        (Error::PipeClosed, Exit::Ok),
    ] {
        assert_eq!(error.exit(), exit, "{error:?}");
    }
}

#[test]
fn missed_target_advises_to_clear_the_way_before_obstacles_only() {
    for obstacle in [false, true] {
        let error = Error::NotReached {
            seconds: 9.0,
            off_mm: 12.0,
            off_deg: -3.0,
            obstacle,
        };
        let clears = error.to_string().contains("clear the way");
        assert_eq!(clears, obstacle);
    }
}

#[test]
fn wrong_content_is_shown_with_its_line() {
    let error = Error::content("a.yaml", 7, "no tour").to_string();
    assert_eq!(error, "a.yaml, line 7: no tour");
}

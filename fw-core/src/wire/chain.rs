//! The table: which strategies make up the frame of which mode (document, 5.2; ours from 0x10 on).
//!
//! One line of [`modes`] is the mode's number, name and chain; one word in [`strategies`] is a strategy.
//! Everything else follows from them: the chain as a value for whoever wants to look at it; reading,
//! as a loop that has each strategy's code once and no call through a pointer; writing, which is
//! shorter, as a straight piece of code for each mode.

#![allow(
    clippy::trivially_copy_pass_by_ref,
    reason = "the context is as large as the strategies need it to be"
)]

use super::all_data_used::AllDataUsed;
use super::battery::Battery;
use super::bearing::Bearing;
use super::crc::Crc;
use super::distance::{Front, Left, Right};
use super::double::Double;
use super::key::Key;
use super::position::Position;
use super::sequence::Sequence;
use super::status::Status;
use super::strategy::{Context, Duties, Fault, Input, Output, Strategy};
use super::{Command, FrameError, Report, MAX_FRAME};

// Requirement: DOC-5.2-1, WIRE-chain-3, WIRE-modes-1
macro_rules! modes {
    ($(
        $(#[$attribute:meta])*
        $mode:ident = $code:literal, $name:literal: [$($strategy:ident),* $(,)?];
    )*) => {
        /// Working mode: which chain both ends run. The discriminant is the mode's number in the
        /// EEPROM.
        #[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
        #[repr(u8)]
        pub enum Mode {
            $( $(#[$attribute])* $mode = $code, )*
        }

        impl Mode {
            /// Every mode, by number.
            pub const ALL: &'static [Self] = &[$(Self::$mode),*];

            /// The mode of a number in the EEPROM; nothing for a number without one.
            #[must_use]
            pub const fn from_code(code: u8) -> Option<Self> {
                match code {
                    $($code => Some(Self::$mode),)*
                    _ => None,
                }
            }

            /// Its name, as in the document.
            #[must_use]
            pub const fn name(self) -> &'static str {
                match self {
                    $(Self::$mode => $name,)*
                }
            }

            /// Whether its frames carry a sequence number, which tells a fresh one from a repeat.
            #[inline]
            #[must_use]
            pub const fn tells_fresh(self) -> bool {
                match self {
                    $(Self::$mode => false $(|| <$strategy as Duties>::TELLS_FRESH)*,)*
                }
            }
        }

        /// The strategies of a mode, in the order of their bytes.
        #[must_use]
        pub const fn chain(mode: Mode) -> &'static [&'static Strategy] {
            match mode {
                $(Mode::$mode => &[$(<$strategy as Duties>::STRATEGY),*],)*
            }
        }

        /// Bytes of a mode's frame.
        #[inline]
        #[must_use]
        pub const fn frame_len(mode: Mode) -> usize {
            match mode {
                $(Mode::$mode => 0 $(+ <$strategy as Duties>::BYTES)*,)*
            }
        }

        const _: () = {
            $(assert!(frame_len(Mode::$mode) <= MAX_FRAME, "raise MAX_FRAME");)*
        };

        /// A mode's chain as steps of the loops below.
        const fn parts(mode: Mode) -> &'static [Part] {
            match mode {
                $(Mode::$mode => &[$(Part::$strategy),*],)*
            }
        }

        /// On the STM: what [`parse_command`] says of a frame of exactly the mode's length, nothing
        /// where it has an error to name. The chain as a straight piece of code for each mode: with
        /// the length known, little of it is left but loads and comparisons.
        #[inline]
        #[must_use]
        pub fn parse_whole(mode: Mode, context: &Context, frame: &[u8]) -> Option<Command> {
            let mut command = Command::default();
            match mode {
                $(Mode::$mode => {
                    let frame: &[u8; frame_len(Mode::$mode)] = frame.try_into().ok()?;
                    let mut input = Input::new(frame, 0);
                    $($strategy::parse_command(&mut input, context, &mut command).ok()?;)*
                })*
            }
            Some(command)
        }

        /// On the Pi: a command as a frame; returns the frame's length.
        #[inline]
        pub fn write_command(
            mode: Mode,
            context: &Context,
            command: &Command,
            frame: &mut [u8; MAX_FRAME],
        ) -> usize {
            let mut output = Output::new(frame);
            match mode {
                $(Mode::$mode => {
                    $($strategy::write_command(&mut output, context, command);)*
                })*
            }
            frame_len(mode)
        }

        /// On the STM: a report as a frame; returns the frame's length.
        #[inline]
        pub fn write_report(
            mode: Mode,
            context: &Context,
            report: &Report,
            frame: &mut [u8; MAX_FRAME],
        ) -> usize {
            let mut output = Output::new(frame);
            match mode {
                $(Mode::$mode => {
                    $($strategy::write_report(&mut output, context, report);)*
                })*
            }
            frame_len(mode)
        }
    };
}

modes! {
    /// Drives to the expected pose with both PIDs.
    // Requirement: DOC-5.1.6-3, DOC-5.2-4, DOC-5.2.1-3, WIRE-distance-2
    #[default]
    Normal = 0, "Normal":
        [Key, Position, Battery, Front, Right, Left, AllDataUsed];
    /// Constant duty from the Pi, rotation measured.
    // Requirement: DOC-5.2.2-3
    TuneRotate = 1, "TuneRotatePID":
        [Key, Double, Battery, AllDataUsed];
    /// Constant duty from the Pi with the rotation PID holding the angle, displacement measured.
    // Requirement: DOC-5.2.3-2
    TuneMove = 2, "TuneMovePID":
        [Key, Double, Battery, AllDataUsed];
    /// [`Mode::Normal`] with sequence, status and CRC.
    // Requirement: WIRE-modes-5
    GuardedNormal = 0x10, "Guarded Normal":
        [Key, Sequence, Status, Position, Battery, Front, Right, Left, Crc, AllDataUsed];
    /// [`Mode::TuneRotate`] with sequence, status and CRC.
    GuardedTuneRotate = 0x11, "Guarded TuneRotate":
        [Key, Sequence, Status, Double, Battery, Crc, AllDataUsed];
    /// [`Mode::TuneMove`] with sequence, status and CRC.
    GuardedTuneMove = 0x12, "Guarded TuneMove":
        [Key, Sequence, Status, Double, Battery, Crc, AllDataUsed];
    /// One rangefinder on a servo, each reading with its bearing.
    // Requirement: WIRE-modes-6
    GuardedSweep = 0x20, "Guarded Sweep":
        [Key, Sequence, Status, Position, Battery, Front, Bearing, Crc, AllDataUsed];
}

impl Mode {
    /// Its number in the EEPROM.
    #[must_use]
    pub const fn code(self) -> u8 {
        self as u8
    }
}

// Requirement: WIRE-chain-3
macro_rules! strategies {
    ($($strategy:ident),* $(,)?) => {
        /// A strategy as a step of a chain.
        #[derive(Clone, Copy)]
        enum Part {
            $($strategy,)*
        }

        /// On the STM: what a frame of the Pi says. `beyond` is the number of bytes that were
        /// clocked after those of `frame`.
        ///
        /// # Errors
        /// The first strategy that failed, and why.
        // Requirement: DOC-5.1-2, DOC-5.1-3
        #[inline]
        pub fn parse_command(
            mode: Mode,
            context: &Context,
            frame: &[u8],
            beyond: usize,
        ) -> Result<Command, FrameError> {
            let mut input = Input::new(frame, beyond);
            let mut command = Command::default();
            for part in parts(mode) {
                match part {
                    $(Part::$strategy => $strategy::parse_command(&mut input, context, &mut command)
                        .map_err(|fault| name($strategy::NAME, fault))?,)*
                }
            }
            Ok(command)
        }

        /// On the Pi: what a frame of the STM says. `beyond` is the number of bytes that were
        /// clocked after those of `frame`.
        ///
        /// # Errors
        /// The first strategy that failed, and why.
        #[inline]
        pub fn parse_report(
            mode: Mode,
            context: &Context,
            frame: &[u8],
            beyond: usize,
        ) -> Result<Report, FrameError> {
            let mut input = Input::new(frame, beyond);
            let mut report = Report::default();
            for part in parts(mode) {
                match part {
                    $(Part::$strategy => $strategy::parse_report(&mut input, context, &mut report)
                        .map_err(|fault| name($strategy::NAME, fault))?,)*
                }
            }
            Ok(report)
        }
    };
}

strategies! {
    Key, Sequence, Status, Position, Double, Battery, Front, Right, Left, Bearing, Crc, AllDataUsed
}

// Requirement: WIRE-rejected-2
#[cold]
fn name(strategy: &'static str, fault: Fault) -> FrameError {
    FrameError {
        strategy,
        offset: fault.offset,
        reason: fault.reason,
    }
}

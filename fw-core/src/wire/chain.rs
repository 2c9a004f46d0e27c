//! The two tables: which strategies there are, and which of them make up the frame of which mode
//! (document, 5.2; ours from 0x10 on).
//!
//! Everything else follows from them: the chain as a list of [`Field`]s, reading and writing as
//! straight-line code for each mode.

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
use super::gyro::Gyro;
use super::key::Key;
use super::position::Position;
use super::sequence::Sequence;
use super::status::Status;
use super::strategy::{Context, FrameReader, FrameWriter, Strategy};
use super::velocity::Velocity;
use super::{Command, FrameError, MAX_FRAME, Report};

// Requirement: WIRE-chain-3
macro_rules! strategies {
    ($($strategy:ident),* $(,)?) => {
        /// A strategy as a value: what a mode's frame carries.
        #[derive(Clone, Copy, Debug, PartialEq, Eq)]
        pub enum Field {
            $(
                #[doc = concat!("The strategy [`", stringify!($strategy), "`].")]
                $strategy,
            )*
        }

        impl Field {
            /// Every strategy.
            pub const ALL: &'static [Self] = &[$(Self::$strategy),*];

            /// Its name in errors and documents.
            #[must_use]
            pub const fn name(self) -> &'static str {
                match self {
                    $(Self::$strategy => <$strategy as Strategy>::NAME,)*
                }
            }

            /// Bytes it takes from a frame.
            #[must_use]
            pub const fn byte_len(self) -> usize {
                match self {
                    $(Self::$strategy => <$strategy as Strategy>::LEN,)*
                }
            }
        }
    };
}

strategies! {
    Key, Sequence, Status, Position, Double, Battery, Front, Right, Left, Bearing, Velocity, Gyro,
    Crc, AllDataUsed
}

// Requirement: DOC-5.2-1, WIRE-chain-3, WIRE-modes-1
macro_rules! modes {
    ($(
        $(
            $(#[$attribute:meta])*
            $mode:ident = $code:literal, $name:literal
        )|+: [$($strategy:ident),* $(,)?];
    )*) => {
        /// Working mode: which chain both ends run. The discriminant is the mode's number in the
        /// EEPROM.
        #[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
        #[repr(u8)]
        pub enum Mode {
            $($( $(#[$attribute])* $mode = $code, )+)*
        }

        impl Mode {
            /// Every mode, by number.
            pub const ALL: &'static [Self] = &[$($(Self::$mode,)+)*];

            /// The mode of a number in the EEPROM; nothing for a number without one.
            pub const fn from_code(code: u8) -> Option<Self> {
                match code {
                    $($($code => Some(Self::$mode),)+)*
                    _ => None,
                }
            }

            /// Its number in the EEPROM.
            #[must_use]
            pub const fn code(self) -> u8 {
                self as u8
            }

            /// Its name, as in the document.
            #[must_use]
            pub const fn name(self) -> &'static str {
                match self {
                    $($(Self::$mode => $name,)+)*
                }
            }

            /// Whether its frames carry a field.
            #[allow(clippy::inline_always, reason = "of a field that is a constant it is a bit of a mask")]
            #[inline(always)]
            #[must_use]
            pub const fn has(self, field: Field) -> bool {
                match self {
                    $($(Self::$mode)|+ => matches!(field, $(Field::$strategy)|*),)*
                }
            }
        }

        /// The strategies of a mode, in the order of their bytes.
        pub const fn chain(mode: Mode) -> &'static [Field] {
            match mode {
                $($(Mode::$mode)|+ => &[$(Field::$strategy),*],)*
            }
        }

        /// Bytes of a mode's frame.
        pub const fn frame_len(mode: Mode) -> usize {
            match mode {
                $($(Mode::$mode)|+ => 0 $(+ <$strategy as Strategy>::LEN)*,)*
            }
        }

        const _: () = {
            $($(assert!(frame_len(Mode::$mode) <= MAX_FRAME, "raise MAX_FRAME");)+)*
        };

        /// On the STM: the command in a frame of the Pi. `overflow_len` bytes were clocked after
        /// those of `frame`.
        ///
        /// # Errors
        /// The first strategy that failed, and why.
        // Requirement: DOC-5.1-2, DOC-5.1-3, WIRE-rejected-2
        #[inline(never)]
        pub fn parse_command(
            mode: Mode,
            context: &Context,
            frame: &[u8],
            overflow_len: usize,
        ) -> Result<Command, FrameError> {
            let mut reader = FrameReader::new(frame, overflow_len);
            let mut command = Command::default();
            // One exit for every error of every chain.
            let (error, field) = 'failed: {
                match mode {
                    $($(Mode::$mode)|+ => {
                        $(if let Err(error) =
                            $strategy::parse_command(&mut reader, context, &mut command)
                        {
                            break 'failed (error, Field::$strategy);
                        })*
                    })*
                }
                return Ok(command);
            };
            Err(error.of(field, frame.len(), overflow_len))
        }

        /// On the Pi: the report in a frame of the STM. `overflow_len` bytes were clocked after
        /// those of `frame`.
        ///
        /// # Errors
        /// The first strategy that failed, and why.
        pub fn parse_report(
            mode: Mode,
            context: &Context,
            frame: &[u8],
            overflow_len: usize,
        ) -> Result<Report, FrameError> {
            let mut reader = FrameReader::new(frame, overflow_len);
            let mut report = Report::default();
            match mode {
                $($(Mode::$mode)|+ => {
                    $($strategy::parse_report(&mut reader, context, &mut report)
                        .map_err(|error| error.of(Field::$strategy, frame.len(), overflow_len))?;)*
                })*
            }
            Ok(report)
        }

        /// On the Pi: a command as a frame; returns the frame's length.
        pub fn write_command(
            mode: Mode,
            context: &Context,
            command: &Command,
            frame: &mut [u8; MAX_FRAME],
        ) -> usize {
            let mut writer = FrameWriter::new(frame);
            match mode {
                $($(Mode::$mode)|+ => {
                    $($strategy::write_command(&mut writer, context, command);)*
                    0 $(+ <$strategy as Strategy>::LEN)*
                })*
            }
        }

        /// On the STM: a report as a frame; returns the frame's length.
        pub fn write_report(
            mode: Mode,
            context: &Context,
            report: &Report,
            frame: &mut [u8; MAX_FRAME],
        ) -> usize {
            let mut writer = FrameWriter::new(frame);
            match mode {
                $($(Mode::$mode)|+ => {
                    $($strategy::write_report(&mut writer, context, report);)*
                    0 $(+ <$strategy as Strategy>::LEN)*
                })*
            }
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
    TuneRotate = 1, "TuneRotatePID" |
    /// Constant duty from the Pi with the rotation PID holding the angle, displacement measured.
    // Requirement: DOC-5.2.3-2
    TuneMove = 2, "TuneMovePID":
        [Key, Double, Battery, AllDataUsed];
    /// [`Mode::Normal`] with sequence, status and CRC.
    // Requirement: WIRE-modes-5
    GuardedNormal = 0x10, "Guarded Normal":
        [Key, Sequence, Status, Position, Battery, Front, Right, Left, Crc, AllDataUsed];
    /// [`Mode::TuneRotate`] with sequence, status and CRC.
    GuardedTuneRotate = 0x11, "Guarded TuneRotate" |
    /// [`Mode::TuneMove`] with sequence, status and CRC.
    GuardedTuneMove = 0x12, "Guarded TuneMove":
        [Key, Sequence, Status, Double, Battery, Crc, AllDataUsed];
    /// One rangefinder on a servo, each reading with its bearing.
    // Requirement: WIRE-modes-6
    GuardedSweep = 0x20, "Guarded Sweep":
        [Key, Sequence, Status, Position, Battery, Front, Bearing, Crc, AllDataUsed];
    /// Drives by forward speed and yaw rate; the gyroscope's angle, every rangefinder, the front one swept.
    // Requirement: WIRE-modes-7
    GuardedVelocity = 0x30, "Guarded Velocity":
        [Key, Sequence, Status, Velocity, Gyro, Battery, Front, Bearing, Right, Left, Crc, AllDataUsed];
}

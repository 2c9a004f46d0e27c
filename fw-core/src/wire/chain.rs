//! The table: which strategies make up the frame of which mode (document, 5.2; ours from 0x10 on).
//!
//! One line of [`modes`] is the mode's number, name and chain. Everything else follows from it: the
//! chain as a value, and for each mode a straight piece of code without a loop, a call or a check
//! of a length already known.

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
use super::{Command, FrameError, Reason, Report, MAX_FRAME};

macro_rules! modes {
    ($(
        $(#[$attribute:meta])*
        $mode:ident = $code:literal, $name:literal: [$($strategy:ty),* $(,)?];
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

        /// Names and bytes of a mode's strategies.
        const fn layout(mode: Mode) -> &'static [(&'static str, usize)] {
            match mode {
                $(Mode::$mode => &[$((<$strategy as Duties>::NAME, <$strategy as Duties>::BYTES)),*],)*
            }
        }

        /// On the STM: what a frame of the Pi says. `beyond` is the number of bytes that were
        /// clocked after those of `frame`.
        ///
        /// # Errors
        /// The first strategy that failed, and why.
        #[inline]
        pub fn parse_command(
            mode: Mode,
            context: &Context,
            frame: &[u8],
            beyond: usize,
        ) -> Result<Command, FrameError> {
            let odd;
            let (frame, verdict) = if frame.len() == frame_len(mode) && beyond == 0 {
                (frame, None)
            } else {
                odd = Odd::new(layout(mode), frame, beyond);
                (&odd.bytes[..], Some(&odd.verdict))
            };
            let parsed = match mode {
                $(Mode::$mode => match frame.first_chunk::<{ frame_len(Mode::$mode) }>() {
                    Some(whole) => (|| {
                        let mut input = Input::new(whole, 0);
                        let mut command = Command::default();
                        $(<$strategy>::parse_command(&mut input, context, &mut command)
                            .map_err(|fault| name(<$strategy>::NAME, fault))?;)*
                        Ok(command)
                    })(),
                    None => Err(NO_FRAME),
                },)*
            };
            match verdict {
                None => parsed,
                Some(&verdict) => Err(first_of(parsed.err(), verdict)),
            }
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
            let odd;
            let (frame, verdict) = if frame.len() == frame_len(mode) && beyond == 0 {
                (frame, None)
            } else {
                odd = Odd::new(layout(mode), frame, beyond);
                (&odd.bytes[..], Some(&odd.verdict))
            };
            let parsed = match mode {
                $(Mode::$mode => match frame.first_chunk::<{ frame_len(Mode::$mode) }>() {
                    Some(whole) => (|| {
                        let mut input = Input::new(whole, 0);
                        let mut report = Report::default();
                        $(<$strategy>::parse_report(&mut input, context, &mut report)
                            .map_err(|fault| name(<$strategy>::NAME, fault))?;)*
                        Ok(report)
                    })(),
                    None => Err(NO_FRAME),
                },)*
            };
            match verdict {
                None => parsed,
                Some(&verdict) => Err(first_of(parsed.err(), verdict)),
            }
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
                    $(<$strategy>::write_command(&mut output, context, command);)*
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
                    $(<$strategy>::write_report(&mut output, context, report);)*
                })*
            }
            frame_len(mode)
        }
    };
}

modes! {
    /// Drives to the expected pose with both PIDs.
    #[default]
    Normal = 0, "Normal":
        [Key, Position, Battery, Front, Right, Left, AllDataUsed];
    /// Constant duty from the Pi, rotation measured.
    TuneRotate = 1, "TuneRotatePID":
        [Key, Double, Battery, AllDataUsed];
    /// Constant duty from the Pi with the rotation PID holding the angle, displacement measured.
    TuneMove = 2, "TuneMovePID":
        [Key, Double, Battery, AllDataUsed];
    /// [`Mode::Normal`] with sequence, status and CRC.
    GuardedNormal = 0x10, "Guarded Normal":
        [Key, Sequence, Status, Position, Battery, Front, Right, Left, Crc, AllDataUsed];
    /// [`Mode::TuneRotate`] with sequence, status and CRC.
    GuardedTuneRotate = 0x11, "Guarded TuneRotate":
        [Key, Sequence, Status, Double, Battery, Crc, AllDataUsed];
    /// [`Mode::TuneMove`] with sequence, status and CRC.
    GuardedTuneMove = 0x12, "Guarded TuneMove":
        [Key, Sequence, Status, Double, Battery, Crc, AllDataUsed];
    /// One rangefinder on a servo, each reading with its bearing.
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

#[cold]
fn name(strategy: &'static str, fault: Fault) -> FrameError {
    FrameError {
        strategy,
        offset: fault.offset,
        reason: fault.reason,
    }
}

/// What no mode's length lets happen: a frame of no bytes at all.
const NO_FRAME: FrameError = FrameError {
    strategy: Key::NAME,
    offset: 0,
    reason: Reason::Short {
        needed: Key::BYTES,
        left: 0,
    },
};

/// A frame that is too short or too long, made to fit: cut, or filled up with zeros. Whatever its
/// bytes say, some strategy rejects it; `verdict` is the one that finds its length wrong, and an
/// earlier one may find something else first.
struct Odd {
    bytes: [u8; MAX_FRAME],
    verdict: FrameError,
}

impl Odd {
    #[cold]
    #[inline(never)]
    fn new(layout: &[(&'static str, usize)], frame: &[u8], beyond: usize) -> Self {
        let mut bytes = [0; MAX_FRAME];
        for (slot, &byte) in bytes.iter_mut().zip(frame) {
            *slot = byte;
        }
        let mut verdict = NO_FRAME;
        for &(strategy, needed) in layout {
            let offset = verdict.offset;
            let left = frame.len().saturating_sub(offset);
            if left < needed {
                let reason = Reason::Short { needed, left };
                verdict = FrameError {
                    strategy,
                    offset,
                    reason,
                };
                return Self { bytes, verdict };
            }
            // The last strategy is the one that finds bytes left.
            verdict = FrameError {
                strategy,
                offset: offset.saturating_add(needed),
                reason: Reason::Long {
                    left: left.saturating_sub(needed).saturating_add(beyond),
                },
            };
        }
        Self { bytes, verdict }
    }
}

/// The error that stands first in the frame.
#[cold]
fn first_of(found: Option<FrameError>, verdict: FrameError) -> FrameError {
    match found {
        Some(found) if found.offset < verdict.offset => found,
        _ => verdict,
    }
}

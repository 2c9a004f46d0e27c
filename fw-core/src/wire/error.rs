//! Why a frame was rejected: the strategy's name, the byte, the reason.

use super::Field;
use super::strategy::saturating;
use crate::log::Line;

/// A rejected frame: which strategy stopped the chain, at which byte, and why.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct FrameError {
    /// The strategy.
    pub field: Field,
    /// Byte of the frame at which the offending value starts, from 0.
    pub offset: u16,
    /// What is wrong with it.
    pub reason: Reason,
}

/// A strategy's error: a [`FrameError`] before the chain adds which strategy it is. Its parts are numbers,
/// so that every exit of a chain sets registers; `of` makes the reason of them, in one place.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct FieldError {
    offset: u16,
    kind: Kind,
    /// The reason's numbers, in their order.
    numbers: (u16, u16),
}

/// The variants of [`Reason`].
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
enum Kind {
    Short,
    Long,
    Key,
    NotFinite,
    PercentOutOfRange,
    Cell,
    Stale,
    UnknownState,
    UnknownOrder,
    Reserved,
    Crc,
}

impl FieldError {
    /// Bytes left need not be right: [`Self::of`] counts them.
    #[inline]
    pub(super) const fn new(offset: usize, reason: Reason) -> Self {
        let (kind, numbers) = match reason {
            Reason::Short { needed, .. } => (Kind::Short, (needed, 0)),
            Reason::Long { .. } => (Kind::Long, (0, 0)),
            Reason::Key { expected, found } => (Kind::Key, (expected as u16, found as u16)),
            Reason::NotFinite => (Kind::NotFinite, (0, 0)),
            Reason::PercentOutOfRange => (Kind::PercentOutOfRange, (0, 0)),
            Reason::Cell { cells, found } => (Kind::Cell, (cells as u16, found as u16)),
            Reason::Stale { last, found } => (Kind::Stale, (last as u16, found as u16)),
            Reason::UnknownState(found) => (Kind::UnknownState, (found as u16, 0)),
            Reason::UnknownOrder(found) => (Kind::UnknownOrder, (found as u16, 0)),
            Reason::Reserved(found) => (Kind::Reserved, (found, 0)),
            Reason::Crc { expected, found } => (Kind::Crc, (expected, found)),
        };
        Self {
            offset: saturating(offset),
            kind,
            numbers,
        }
    }

    /// Of a frame with `len` bytes in its buffer and `overflow_len` beyond: they say how many were left.
    #[cold]
    #[inline(never)]
    #[allow(
        clippy::cast_possible_truncation,
        reason = "as wide as the number it was made of"
    )]
    pub(super) const fn of(self, field: Field, len: usize, overflow_len: usize) -> FrameError {
        let (first, second) = self.numbers;
        let left = len.saturating_sub(self.offset as usize);
        let (expected, found) = (first as u8, second as u8);
        FrameError {
            field,
            offset: self.offset,
            reason: match self.kind {
                Kind::Short => Reason::Short {
                    needed: first,
                    left: saturating(left),
                },
                Kind::Long => Reason::Long {
                    left: saturating(left.saturating_add(overflow_len)),
                },
                Kind::Key => Reason::Key { expected, found },
                Kind::NotFinite => Reason::NotFinite,
                Kind::PercentOutOfRange => Reason::PercentOutOfRange,
                Kind::Cell => Reason::Cell {
                    cells: expected,
                    found,
                },
                Kind::Stale => Reason::Stale {
                    last: expected,
                    found,
                },
                Kind::UnknownState => Reason::UnknownState(expected),
                Kind::UnknownOrder => Reason::UnknownOrder(expected),
                Kind::Reserved => Reason::Reserved(first),
                Kind::Crc => Reason::Crc {
                    expected: first,
                    found: second,
                },
            },
        }
    }
}

/// What is wrong with a field of a frame.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Reason {
    /// The frame ends inside the strategy's bytes.
    Short {
        /// Bytes the strategy needs.
        needed: u16,
        /// Bytes that were left.
        left: u16,
    },
    /// Bytes are left at the end of the chain.
    Long {
        /// How many, at most 65 535.
        left: u16,
    },
    /// Not the key of the other end.
    Key {
        /// The key configured.
        expected: u8,
        /// The key received.
        found: u8,
    },
    /// The double is NaN or infinite.
    NotFinite,
    /// The percentage is below −100 or above 100.
    PercentOutOfRange,
    /// A battery cell that the configuration does not have.
    Cell {
        /// Cells configured.
        cells: u8,
        /// Index received, from 0.
        found: u8,
    },
    /// A sequence number that is not newer than the last one accepted.
    Stale {
        /// The last number accepted.
        last: u8,
        /// The number received.
        found: u8,
    },
    /// A state of the robot that does not exist.
    UnknownState(u8),
    /// An order that does not exist.
    UnknownOrder(u8),
    /// Bytes of the velocity that must be 0 are not.
    Reserved(u16),
    /// The checksum does not match the bytes before it.
    Crc {
        /// What those bytes give.
        expected: u16,
        /// What the frame says.
        found: u16,
    },
}

/// The kinds of [`Reason`], as they are counted.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Cause {
    /// Too few bytes.
    Short,
    /// Too many bytes.
    Long,
    /// Wrong key.
    Key,
    /// A double that is not finite, or a percentage out of its range.
    Double,
    /// A cell that is not configured.
    Cell,
    /// A stale or repeated sequence number.
    Stale,
    /// An unknown state or order.
    Status,
    /// A wrong checksum.
    Crc,
    /// A velocity whose reserved bytes are not 0.
    Velocity,
}

impl Cause {
    /// Every cause, in the order of their counters.
    pub const ALL: [Self; 9] = [
        Self::Short,
        Self::Long,
        Self::Key,
        Self::Double,
        Self::Cell,
        Self::Stale,
        Self::Status,
        Self::Crc,
        Self::Velocity,
    ];

    /// One lower-case word, as in the log, on the screen and in JSON.
    #[must_use]
    pub const fn name(self) -> &'static str {
        match self {
            Self::Short => "short",
            Self::Long => "long",
            Self::Key => "key",
            Self::Double => "double",
            Self::Cell => "cell",
            Self::Stale => "stale",
            Self::Status => "status",
            Self::Crc => "crc",
            Self::Velocity => "velocity",
        }
    }
}

impl Reason {
    /// How it is counted.
    pub const fn cause(&self) -> Cause {
        match self {
            Self::Short { .. } => Cause::Short,
            Self::Long { .. } => Cause::Long,
            Self::Key { .. } => Cause::Key,
            Self::NotFinite | Self::PercentOutOfRange => Cause::Double,
            Self::Cell { .. } => Cause::Cell,
            Self::Stale { .. } => Cause::Stale,
            Self::UnknownState(_) | Self::UnknownOrder(_) => Cause::Status,
            Self::Crc { .. } => Cause::Crc,
            Self::Reserved(_) => Cause::Velocity,
        }
    }

    #[inline(never)]
    // Requirement: WIRE-chain-2
    fn log(self, line: &mut Line) {
        match self {
            Self::Short { needed, left } => {
                line.text("frame too short, needs ")
                    .int(needed.into())
                    .text(" bytes, has ")
                    .int(left.into());
            }
            Self::Long { left } => {
                line.text("frame too long by ").int(left.into());
            }
            Self::Key { expected, found } => {
                line.text("key 0x")
                    .hex(found.into(), 2)
                    .text(", expected 0x")
                    .hex(expected.into(), 2);
            }
            Self::NotFinite => {
                line.text("not a finite number");
            }
            Self::PercentOutOfRange => {
                line.text("percentage beyond -100 to 100");
            }
            Self::Cell { cells, found } => {
                line.text("cell index ")
                    .int(found.into())
                    .text(" of ")
                    .int(cells.into())
                    .text(" cells");
            }
            Self::Stale { last, found } => {
                line.text("stale, number ")
                    .int(found.into())
                    .text(" after ")
                    .int(last.into());
            }
            Self::UnknownState(found) => {
                line.text("unknown state ").int(found.into());
            }
            Self::UnknownOrder(found) => {
                line.text("unknown order ").int(found.into());
            }
            Self::Reserved(found) => {
                line.text("reserved bytes 0x").hex(found.into(), 4);
            }
            Self::Crc { expected, found } => {
                line.text("checksum 0x")
                    .hex(found.into(), 4)
                    .text(", expected 0x")
                    .hex(expected.into(), 4);
            }
        }
    }
}

impl FrameError {
    /// The error as text: `<strategy> at byte <offset>: <reason>`.
    #[inline(never)]
    pub fn log(&self, line: &mut Line) {
        line.text(self.field.name())
            .text(" at byte ")
            .int(self.offset.into())
            .text(": ");
        self.reason.log(line);
    }
}

impl core::fmt::Display for FrameError {
    fn fmt(&self, f: &mut core::fmt::Formatter<'_>) -> core::fmt::Result {
        let mut line = Line::new();
        self.log(&mut line);
        f.write_str(line.as_str())
    }
}

impl core::error::Error for FrameError {}

//! The UART log: `<I|W|E><count>: <text>\n` with a five-digit counter, in a queue that never blocks.
//!
//! The counter numbers every line, dropped ones included, and wraps from 99999 to 00000: a gap in
//! the numbers is what was lost. A line is ASCII and at most [`MAX_LINE`] bytes long.

#![allow(
    clippy::cast_possible_truncation,
    reason = "digits are cut to their width on purpose"
)]

use crate::divide::div_rem;
use core::num::NonZeroU32;
use fixed::types::I32F32;

/// How much a line matters.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Level {
    /// `I`: for information.
    Info,
    /// `W`: the robot goes on.
    Warn,
    /// `E`: the robot stopped or refuses to start.
    Error,
}

impl Level {
    const fn letter(self) -> u8 {
        match self {
            Self::Info => b'I',
            Self::Warn => b'W',
            Self::Error => b'E',
        }
    }
}

/// The longest line, newline included, in bytes. A longer text loses its end and ends in `~`.
// Requirement: WIRE-log-6
pub const MAX_LINE: usize = 160;

/// A line being written: printable ASCII, anything else becomes `?`.
#[derive(Clone, Debug)]
pub struct Line {
    bytes: [u8; MAX_LINE],
    len: usize,
}

impl Default for Line {
    fn default() -> Self {
        Self::new()
    }
}

impl Line {
    /// Room for text: everything but the newline.
    const ROOM: usize = MAX_LINE - 1;

    /// An empty line.
    pub const fn new() -> Self {
        Self {
            bytes: [0; MAX_LINE],
            len: 0,
        }
    }

    /// The text so far.
    pub fn as_bytes(&self) -> &[u8] {
        self.bytes.get(..self.len).unwrap_or_default()
    }

    /// The text so far.
    pub fn as_str(&self) -> &str {
        core::str::from_utf8(self.as_bytes()).unwrap_or_default()
    }

    #[inline(never)]
    fn byte(&mut self, byte: u8) {
        self.append(&[byte]);
    }

    fn newline(&mut self) {
        if let Some(slot) = self.bytes.get_mut(self.len) {
            *slot = b'\n';
            self.len = self.len.wrapping_add(1);
        }
    }

    /// A text; what is not printable ASCII becomes `?`.
    pub fn text(&mut self, text: &str) -> &mut Self {
        self.append(text.as_bytes())
    }

    #[inline(never)]
    fn append(&mut self, text: &[u8]) -> &mut Self {
        let room = self.bytes.get_mut(self.len..Self::ROOM).unwrap_or_default();
        for (slot, &byte) in room.iter_mut().zip(text) {
            *slot = if matches!(byte, b' '..=b'~') {
                byte
            } else {
                b'?'
            };
        }
        let fits = text.len().min(room.len());
        if fits < text.len() {
            if let Some(last) = self.bytes.get_mut(Self::ROOM - 1) {
                *last = b'~';
            }
        }
        self.len = self.len.wrapping_add(fits);
        self
    }

    /// A decimal number of at least `digits` digits (at most 20), zeros in front.
    #[inline(never)]
    fn digits(&mut self, mut value: u64, digits: usize) {
        let mut buffer = [b'0'; 20];
        let mut used = 0_usize;
        for slot in buffer.iter_mut().rev() {
            if value == 0 && used >= digits {
                break;
            }
            // A 32-bit division is one instruction, a 64-bit one a loop.
            let digit = if let Ok(small) = u32::try_from(value) {
                value = (small / 10).into();
                small % 10
            } else {
                let (rest, digit) = div_rem(value, 10);
                value = rest;
                digit as u32
            };
            *slot = b'0'.wrapping_add(digit as u8);
            used = used.wrapping_add(1);
        }
        let unused = buffer.len().wrapping_sub(used);
        self.append(buffer.get(unused..).unwrap_or_default());
    }

    /// A decimal integer.
    pub fn int(&mut self, value: i64) -> &mut Self {
        self.decimal(value, 0)
    }

    /// A decimal number of things.
    pub fn count(&mut self, value: usize) -> &mut Self {
        self.digits(value as u64, 1);
        self
    }

    /// `value` / 10^`decimals`, with that many decimals (at most 9): `decimal(-1234, 3)` is
    /// `-1.234`. What micrometres need to be read as millimetres.
    #[inline(never)]
    pub fn decimal(&mut self, value: i64, decimals: u8) -> &mut Self {
        if value < 0 {
            self.byte(b'-');
        }
        let (unit, decimals) = power_of_ten(decimals);
        let magnitude = value.unsigned_abs();
        let (whole, part) = if let Ok(small) = u32::try_from(magnitude) {
            (u64::from(small / unit), u64::from(small % unit))
        } else {
            div_rem(magnitude, unit.get().into())
        };
        self.digits(whole, 1);
        if decimals > 0 {
            self.byte(b'.');
            self.digits(part, decimals.into());
        }
        self
    }

    /// A fixed-point number rounded to `decimals` decimals (at most 9), half away from zero.
    #[inline(never)]
    pub fn fixed(&mut self, value: I32F32, decimals: u8) -> &mut Self {
        let (unit, decimals) = power_of_ten(decimals);
        let unit = u64::from(unit.get());
        let magnitude = value.to_bits().unsigned_abs();
        // The fraction's 32 bits times 10⁹ fit into 64; a carry goes to the whole part.
        let part = (magnitude & 0xFFFF_FFFF)
            .wrapping_mul(unit)
            .wrapping_add(1 << 31)
            >> 32;
        let whole = (magnitude >> 32).wrapping_add(u64::from(part == unit));
        let part = if part == unit { 0 } else { part };
        if value < 0 && (whole != 0 || part != 0) {
            self.byte(b'-');
        }
        self.digits(whole, 1);
        if decimals > 0 {
            self.byte(b'.');
            self.digits(part, decimals.into());
        }
        self
    }

    /// A hexadecimal number of exactly `digits` digits (at most 8): the lowest ones.
    #[inline(never)]
    pub fn hex(&mut self, value: u32, digits: u8) -> &mut Self {
        for place in (0..u32::from(digits.min(8))).rev() {
            let nibble = (value >> place.wrapping_mul(4) & 0xF) as u8;
            self.byte(match nibble {
                0..=9 => b'0'.wrapping_add(nibble),
                _ => b'A'.wrapping_add(nibble).wrapping_sub(10),
            });
        }
        self
    }

    // Requirement: WIRE-log-1
    fn header(&mut self, level: Level, number: u32) {
        self.byte(level.letter());
        self.digits(number.into(), 5);
        self.text(": ");
    }
}

/// 10 to the power of `decimals` and `decimals`, both for at most 9.
fn power_of_ten(decimals: u8) -> (NonZeroU32, u8) {
    const TEN: NonZeroU32 = NonZeroU32::MIN.saturating_add(9);
    let decimals = decimals.min(9);
    let mut power = NonZeroU32::MIN;
    for _ in 0..decimals {
        power = power.saturating_mul(TEN);
    }
    (power, decimals)
}

/// The queue of bytes between the robot and the UART: `N` bytes, of which the transmitter owns
/// those of [`Self::pending`] until [`Self::sent`].
///
/// A line enters whole or not at all; when there is no room the newest is dropped, and how many
/// were is logged in a line of its own as soon as there is room.
#[derive(Clone, Debug)]
pub struct Log<const N: usize = 1024> {
    bytes: [u8; N],
    /// Where the oldest byte stands; below `N`.
    start: usize,
    /// Bytes queued, at most `N`.
    len: usize,
    /// The number of the next line, below 100 000.
    number: u32,
    /// Lines dropped since the last line about it.
    unreported: u32,
    /// Lines dropped since the start.
    dropped: u32,
}

impl<const N: usize> Default for Log<N> {
    fn default() -> Self {
        Self::new()
    }
}

impl<const N: usize> Log<N> {
    /// An empty queue.
    pub const fn new() -> Self {
        Self {
            bytes: [0; N],
            start: 0,
            len: 0,
            number: 0,
            unreported: 0,
            dropped: 0,
        }
    }

    /// Queues one line, or drops it where there is no room; never waits.
    ///
    /// What all lines share stays out of line: it would be repeated at every place that says one.
    #[inline]
    pub fn line(&mut self, level: Level, write: impl FnOnce(&mut Line)) {
        let mut line = self.begin(level);
        write(&mut line);
        self.end(&mut line);
    }

    /// One line of text, without the code that [`Self::line`] repeats at every call.
    #[inline(never)]
    pub fn text(&mut self, level: Level, text: &str) {
        self.line(level, |line| {
            line.text(text);
        });
    }

    #[inline(never)]
    fn begin(&mut self, level: Level) -> Line {
        let mut line = Line::new();
        line.header(level, self.take_number());
        line
    }

    // Requirement: WIRE-log-2
    #[inline(never)]
    fn end(&mut self, line: &mut Line) {
        line.newline();
        // Behind a report that found no room, order matters more than a short line that would fit.
        if self.unreported != 0 || !self.push(line.as_bytes()) {
            self.unreported = self.unreported.saturating_add(1);
            self.dropped = self.dropped.saturating_add(1);
        }
    }

    /// The bytes to transmit next: contiguous, and neither moved nor overwritten until
    /// [`Self::sent`] says that they have left. Empty when there is nothing to say.
    pub fn pending(&self) -> &[u8] {
        let rest = self.bytes.get(self.start..).unwrap_or_default();
        rest.get(..self.len).unwrap_or(rest)
    }

    /// The first `count` bytes of [`Self::pending`] have left; more than that counts as all.
    pub fn sent(&mut self, count: usize) {
        let count = count.min(self.pending().len());
        let start = self.start.wrapping_add(count);
        self.start = if start < N { start } else { 0 };
        self.len = self.len.wrapping_sub(count);
        self.report_dropped();
    }

    /// Lines dropped since the start.
    pub const fn dropped(&self) -> u32 {
        self.dropped
    }

    // Requirement: WIRE-log-5
    fn take_number(&mut self) -> u32 {
        let number = self.number;
        self.number = if number < 99_999 {
            number.wrapping_add(1)
        } else {
            0
        };
        number
    }

    #[inline(never)]
    fn report_dropped(&mut self) {
        if self.unreported == 0 {
            return;
        }
        let mut line = Line::new();
        line.header(Level::Warn, self.number);
        line.digits(self.unreported.into(), 1);
        line.text(" lines dropped");
        line.newline();
        if self.push(line.as_bytes()) {
            self.take_number();
            self.unreported = 0;
        }
    }

    /// Appends all of `bytes`, or nothing where they do not fit.
    // Requirement: WIRE-log-2
    #[inline(never)]
    fn push(&mut self, bytes: &[u8]) -> bool {
        if bytes.len() > N.saturating_sub(self.len) {
            return false;
        }
        // Two stretches of free room: behind the queued bytes to the buffer's end, then from its
        // beginning.
        let mut end = self.start.wrapping_add(self.len);
        if end >= N {
            end = end.wrapping_sub(N);
        }
        let (front, back) = self.bytes.split_at_mut_checked(end).unwrap_or_default();
        let (first, rest) = bytes
            .split_at_checked(back.len().min(bytes.len()))
            .unwrap_or_default();
        copy(back, first);
        copy(front, rest);
        self.len = self.len.wrapping_add(bytes.len());
        true
    }
}

/// As many bytes as both have.
fn copy(to: &mut [u8], from: &[u8]) {
    let len = to.len().min(from.len());
    if let (Some(to), Some(from)) = (to.get_mut(..len), from.get(..len)) {
        to.copy_from_slice(from);
    }
}

#[cfg(test)]
pub(crate) mod tests;

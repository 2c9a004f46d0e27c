//! What every strategy implements, and the frame's bytes as it sees them (document, 5.1).

use super::error::{FieldError, Reason};
use super::{Command, MAX_FRAME, Report};

/// What a strategy knows beside the frame: the configuration and the end's sequence numbers.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct Context {
    /// The key the STM expects from the Pi.
    pub key_from_pi: u8,
    /// The key the Pi expects from the STM.
    pub key_from_stm: u8,
    /// Battery cells configured, 1 ..= 8.
    pub cells: u8,
    /// The counter that goes out with the frame being written.
    pub own: u8,
    /// The last counter accepted from the other end; nothing before the first.
    pub last: Option<u8>,
}

/// Whether a strategy accepts its bytes.
pub type Parsed = Result<(), FieldError>;

/// The document's strategy interface: name, bytes needed, and a codec for each direction. A command
/// goes from the Pi to the STM, a report from the STM to the Pi; both ends run the same code.
// Requirement: DOC-5.1-1, DOC-5-1
pub trait Strategy {
    /// Its name in errors and documents.
    const NAME: &'static str;
    /// Bytes it takes from a frame.
    const LEN: usize;

    /// On the STM: takes its bytes and stores their values.
    ///
    /// # Errors
    /// Bytes missing, or content this strategy does not accept.
    fn parse_command(
        reader: &mut FrameReader<'_>,
        context: &Context,
        command: &mut Command,
    ) -> Parsed;

    /// On the Pi: puts its bytes.
    fn write_command(writer: &mut FrameWriter<'_>, context: &Context, command: &Command);

    /// On the Pi: takes its bytes and stores their values.
    ///
    /// # Errors
    /// Bytes missing, or content this strategy does not accept.
    fn parse_report(reader: &mut FrameReader<'_>, context: &Context, report: &mut Report)
    -> Parsed;

    /// On the STM: puts its bytes.
    fn write_report(writer: &mut FrameWriter<'_>, context: &Context, report: &Report);
}

/// A received frame and how far it has been read.
#[derive(Clone, Copy, Debug)]
pub struct FrameReader<'a> {
    frame: &'a [u8],
    offset: usize,
    overflow_len: usize,
}

impl<'a> FrameReader<'a> {
    /// A frame of which `overflow_len` more bytes were clocked than `frame` holds.
    pub const fn new(frame: &'a [u8], overflow_len: usize) -> Self {
        Self {
            frame,
            offset: 0,
            overflow_len,
        }
    }

    /// Offset of the next byte.
    pub const fn offset(&self) -> usize {
        self.offset
    }

    /// Bytes not taken yet, those beyond the buffer included.
    pub const fn remaining(&self) -> usize {
        self.frame
            .len()
            .saturating_sub(self.offset)
            .saturating_add(self.overflow_len)
    }

    /// The bytes taken so far.
    pub fn taken(&self) -> &'a [u8] {
        self.frame.get(..self.offset).unwrap_or_default()
    }

    /// Whether `len` more bytes are there: for a strategy of several values, before the first.
    ///
    /// # Errors
    /// [`Reason::Short`]: the frame ends before.
    pub fn require(&self, len: usize) -> Result<(), FieldError> {
        match self.frame.get(self.offset..self.offset.wrapping_add(len)) {
            Some(_) => Ok(()),
            None => Err(self.short(len)),
        }
    }

    /// Takes the next `N` bytes.
    ///
    /// # Errors
    /// [`Reason::Short`]: the frame ends before; then nothing is taken.
    // Requirement: WIRE-rejected-3
    pub fn take<const N: usize>(&mut self) -> Result<[u8; N], FieldError> {
        let end = self.offset.wrapping_add(N);
        let bytes = self.frame.get(self.offset..end);
        match bytes.and_then(|bytes| bytes.first_chunk()) {
            Some(bytes) => {
                self.offset = end;
                Ok(*bytes)
            }
            None => Err(self.short(N)),
        }
    }

    /// Error of the field whose `len` bytes end before the next one to be taken.
    #[inline]
    pub const fn error(&self, len: usize, reason: Reason) -> FieldError {
        FieldError::new(self.offset.wrapping_sub(len), reason)
    }

    const fn short(&self, needed: usize) -> FieldError {
        let needed = saturating(needed);
        FieldError::new(self.offset, Reason::Short { needed, left: 0 })
    }
}

/// The largest `u16` where `len` is larger.
#[allow(clippy::cast_possible_truncation, reason = "compared before")]
pub(super) const fn saturating(len: usize) -> u16 {
    if len > u16::MAX as usize {
        u16::MAX
    } else {
        len as u16
    }
}

/// A frame being written. What does not fit is dropped; no chain is longer than [`MAX_FRAME`].
#[derive(Debug)]
pub struct FrameWriter<'a> {
    frame: &'a mut [u8; MAX_FRAME],
    offset: usize,
}

impl<'a> FrameWriter<'a> {
    /// An empty frame.
    pub fn new(frame: &'a mut [u8; MAX_FRAME]) -> Self {
        Self { frame, offset: 0 }
    }

    /// The bytes put so far.
    pub fn written(&self) -> &[u8] {
        self.frame.get(..self.offset).unwrap_or_default()
    }

    /// Puts `N` bytes.
    pub fn put<const N: usize>(&mut self, bytes: [u8; N]) {
        let rest = self.frame.get_mut(self.offset..).unwrap_or_default();
        if let Some(slot) = rest.first_chunk_mut::<N>() {
            *slot = bytes;
            self.offset = self.offset.wrapping_add(N);
        }
    }
}

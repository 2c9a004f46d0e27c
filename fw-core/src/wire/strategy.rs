//! What every strategy can do, and the frame's bytes as it sees them (document, 5.1).

use super::error::Reason;
use super::{Command, Report, MAX_FRAME};

/// What a strategy may know beside the frame: the configuration and the end's sequence numbers.
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

/// The four duties of the document's strategy interface: parse incoming, write outgoing, bytes
/// needed, name. The first two exist once per direction: a command goes from the Pi to the STM,
/// a report from the STM to the Pi, and both ends run the same code.
// Requirement: DOC-5.1-1
pub trait Duties {
    /// Its name in errors and documents.
    const NAME: &'static str;
    /// Bytes it takes from a frame.
    const BYTES: usize;
    /// Whether its presence lets an end tell a fresh frame from a repeated one.
    const TELLS_FRESH: bool = false;

    /// On the STM: takes its bytes and stores what they say.
    ///
    /// # Errors
    /// Bytes missing, or content this strategy does not accept.
    fn parse_command(
        input: &mut Input<'_>,
        context: &Context,
        command: &mut Command,
    ) -> Result<(), Fault>;

    /// On the Pi: puts its bytes.
    fn write_command(output: &mut Output<'_>, context: &Context, command: &Command);

    /// On the Pi: takes its bytes and stores what they say.
    ///
    /// # Errors
    /// Bytes missing, or content this strategy does not accept.
    fn parse_report(
        input: &mut Input<'_>,
        context: &Context,
        report: &mut Report,
    ) -> Result<(), Fault>;

    /// On the STM: puts its bytes.
    fn write_report(output: &mut Output<'_>, context: &Context, report: &Report);

    /// The strategy as an entry of a chain.
    const STRATEGY: &'static Strategy = &Strategy {
        name: Self::NAME,
        bytes: Self::BYTES,
        parse_command: Self::parse_command,
        write_command: Self::write_command,
        parse_report: Self::parse_report,
        write_report: Self::write_report,
    };
}

/// A strategy as an entry of a chain: [`Duties`] as a value.
// Requirement: DOC-5-1
#[derive(Debug)]
pub struct Strategy {
    /// [`Duties::NAME`].
    pub name: &'static str,
    /// [`Duties::BYTES`].
    pub bytes: usize,
    /// [`Duties::parse_command`].
    pub parse_command: fn(&mut Input<'_>, &Context, &mut Command) -> Result<(), Fault>,
    /// [`Duties::write_command`].
    pub write_command: fn(&mut Output<'_>, &Context, &Command),
    /// [`Duties::parse_report`].
    pub parse_report: fn(&mut Input<'_>, &Context, &mut Report) -> Result<(), Fault>,
    /// [`Duties::write_report`].
    pub write_report: fn(&mut Output<'_>, &Context, &Report),
}

/// Why a strategy failed, and at which byte of the frame; the chain adds the strategy's name.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct Fault {
    /// Byte of the frame at which the offending field starts.
    pub offset: usize,
    /// What is wrong with it.
    pub reason: Reason,
}

/// A received frame: what was taken, what is left, and how many bytes were clocked beyond it.
#[derive(Clone, Copy, Debug)]
pub struct Input<'a> {
    frame: &'a [u8],
    at: usize,
    beyond: usize,
}

impl<'a> Input<'a> {
    /// A frame of which `beyond` more bytes were clocked than `frame` holds.
    #[inline]
    #[must_use]
    pub const fn new(frame: &'a [u8], beyond: usize) -> Self {
        Self {
            frame,
            at: 0,
            beyond,
        }
    }

    /// Bytes taken so far: the offset of the next one.
    #[inline]
    #[must_use]
    pub const fn offset(&self) -> usize {
        self.at
    }

    /// Bytes not taken yet.
    #[inline]
    #[must_use]
    pub const fn left(&self) -> usize {
        self.frame
            .len()
            .saturating_sub(self.at)
            .saturating_add(self.beyond)
    }

    /// The bytes taken so far.
    #[inline]
    #[must_use]
    pub fn taken(&self) -> &'a [u8] {
        self.frame.get(..self.at).unwrap_or_default()
    }

    /// The next `N` bytes, without taking them.
    ///
    /// # Errors
    /// [`Reason::Short`]: the frame ends before.
    // Requirement: WIRE-rejected-3
    #[inline]
    pub fn peek<const N: usize>(&self) -> Result<[u8; N], Fault> {
        let rest = self.frame.get(self.at..).unwrap_or_default();
        match rest.first_chunk() {
            Some(bytes) => Ok(*bytes),
            None => Err(self.fault(Reason::Short {
                needed: N,
                left: rest.len(),
            })),
        }
    }

    /// Takes the next `N` bytes.
    ///
    /// # Errors
    /// As [`Self::peek`]; then nothing is taken.
    #[inline]
    pub fn take<const N: usize>(&mut self) -> Result<[u8; N], Fault> {
        let bytes = self.peek()?;
        self.at = self.at.wrapping_add(N);
        Ok(bytes)
    }

    /// Takes the next `N` bytes as an input of their own, which keeps count of its offset in the
    /// frame: for fields that are worth naming one by one.
    ///
    /// # Errors
    /// As [`Self::take`].
    #[inline]
    pub fn part<const N: usize>(&mut self) -> Result<Self, Fault> {
        let mut part = *self;
        self.take::<N>()?;
        part.frame = part.frame.get(..self.at).unwrap_or_default();
        part.beyond = 0;
        Ok(part)
    }

    /// A fault of the field about to be taken.
    #[inline]
    #[must_use]
    pub const fn fault(&self, reason: Reason) -> Fault {
        Fault {
            offset: self.at,
            reason,
        }
    }
}

/// A frame being written. What does not fit is dropped; no chain is longer than [`MAX_FRAME`].
#[derive(Debug)]
pub struct Output<'a> {
    frame: &'a mut [u8; MAX_FRAME],
    at: usize,
}

impl<'a> Output<'a> {
    /// An empty frame.
    #[inline]
    #[must_use]
    pub fn new(frame: &'a mut [u8; MAX_FRAME]) -> Self {
        Self { frame, at: 0 }
    }

    /// Bytes put so far.
    #[inline]
    #[must_use]
    pub fn written(&self) -> &[u8] {
        self.frame.get(..self.at).unwrap_or_default()
    }

    /// Puts `N` bytes.
    #[inline]
    pub fn put<const N: usize>(&mut self, bytes: [u8; N]) {
        let rest = self.frame.get_mut(self.at..).unwrap_or_default();
        if let Some(slot) = rest.first_chunk_mut::<N>() {
            *slot = bytes;
            self.at = self.at.wrapping_add(N);
        }
    }
}

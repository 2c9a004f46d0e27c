//! Status: faults and what the robot does one way, faults to clear and an order the other.
//!
//! | byte | Pi → STM | STM → Pi |
//! |---|---|---|
//! | 1–2 | fault bits to clear, big-endian | latched fault bits, big-endian |
//! | 3 | order: 0 none, 1 stop, 2 resume | bits 0–2: state, 0 booting … 4 faulted; bit 6: the obstacle stop limits the speed; bit 7: a command was clipped |
//!
//! An order or state that does not exist and a 1 in bits 3–5 are rejected; fault bits are taken as they
//! come.

use super::error::{FieldError, Reason};
use super::strategy::{Context, FrameReader, FrameWriter, Parsed, Strategy};
use super::{Command, Order, Report, State};
use crate::types::Faults;

/// Sends faults and state one way, clearing and orders the other.
#[derive(Debug)]
pub struct Status;

/// The obstacle stop limits the speed.
const OBSTACLE: u8 = 1 << 6;
/// A command was clipped.
const CLIPPED: u8 = 1 << 7;

/// The fault bits and the code after them.
// Requirement: WIRE-status-2
#[inline(always)]
fn parse(reader: &mut FrameReader<'_>) -> Result<(Faults, u8), FieldError> {
    reader.require(3)?;
    let faults = Faults::from_bits(u16::from_be_bytes(reader.take()?));
    let [code] = reader.take()?;
    Ok((faults, code))
}

// Requirement: WIRE-status-4
#[inline(always)]
fn write(writer: &mut FrameWriter<'_>, bits: Faults, code: u8) {
    writer.put(bits.bits().to_be_bytes());
    writer.put([code]);
}

impl Strategy for Status {
    const NAME: &'static str = "status";
    const LEN: usize = 3;

    #[inline(always)]
    fn parse_command(reader: &mut FrameReader<'_>, _: &Context, command: &mut Command) -> Parsed {
        let (bits, code) = parse(reader)?;
        command.order =
            Order::from_code(code).ok_or_else(|| reader.error(1, Reason::UnknownOrder(code)))?;
        command.clear_faults = bits;
        Ok(())
    }

    #[inline(always)]
    fn write_command(writer: &mut FrameWriter<'_>, _context: &Context, command: &Command) {
        write(writer, command.clear_faults, command.order as u8);
    }

    #[inline(always)]
    fn parse_report(reader: &mut FrameReader<'_>, _: &Context, report: &mut Report) -> Parsed {
        let (bits, code) = parse(reader)?;
        report.state = State::from_code(code & !(OBSTACLE | CLIPPED))
            .ok_or_else(|| reader.error(1, Reason::UnknownState(code)))?;
        report.obstacle_limited = code & OBSTACLE != 0;
        report.clipped = code & CLIPPED != 0;
        report.faults = bits;
        Ok(())
    }

    #[inline(always)]
    fn write_report(writer: &mut FrameWriter<'_>, _context: &Context, report: &Report) {
        // Requirement: WIRE-status-7
        let obstacle = u8::from(report.obstacle_limited) * OBSTACLE;
        let clipped = u8::from(report.clipped) * CLIPPED;
        write(
            writer,
            report.faults,
            report.state as u8 | obstacle | clipped,
        );
    }
}

impl Order {
    /// The order of a code; nothing for a code without one.
    pub const fn from_code(code: u8) -> Option<Self> {
        match code {
            0 => Some(Self::None),
            1 => Some(Self::Stop),
            2 => Some(Self::Resume),
            _ => None,
        }
    }
}

impl State {
    /// The state of a code; nothing for a code without one.
    pub const fn from_code(code: u8) -> Option<Self> {
        match code {
            0 => Some(Self::Booting),
            1 => Some(Self::Ready),
            2 => Some(Self::Moving),
            3 => Some(Self::Stopped),
            4 => Some(Self::Faulted),
            _ => None,
        }
    }

    /// One lower-case word, as in the log, on the screen and in JSON.
    #[must_use]
    pub const fn name(self) -> &'static str {
        match self {
            Self::Booting => "booting",
            Self::Ready => "ready",
            Self::Moving => "moving",
            Self::Stopped => "stopped",
            Self::Faulted => "faulted",
        }
    }
}

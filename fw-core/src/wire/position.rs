//! Position: x, y and rotation, big-endian, and the bit that says whether to drive there
//! (document, 5.1.1).
//!
//! | byte | Pi → STM | STM → Pi |
//! |---|---|---|
//! | 1–4 | expected x, mm × 1000, two's complement | actual x |
//! | 5–8 | expected y | actual y |
//! | 9 | bit 7: apply; bits 6–0: expected rotation, bits 14–8 | bit 7: not used; actual rotation |
//! | 10 | expected rotation, bits 7–0 | actual rotation |
//!
//! The document calls x and y unsigned; a robot that goes backwards needs their sign.

use super::error::FieldError;
use super::strategy::{Context, FrameReader, FrameWriter, Parsed, Strategy};
use super::{Command, PoseCode, Report};

/// Sends the expected pose one way and the actual one the other.
#[derive(Debug)]
pub struct Position;

const APPLY: u16 = 0x8000;

/// The pose, and bit 7 of byte 9.
// Requirement: DOC-5.1.1-1, DOC-5.1.1-4
#[inline(always)]
fn parse(reader: &mut FrameReader<'_>) -> Result<(PoseCode, bool), FieldError> {
    reader.require(10)?;
    let x = i32::from_be_bytes(reader.take()?);
    let y = i32::from_be_bytes(reader.take()?);
    let rotation = u16::from_be_bytes(reader.take()?);
    let pose = PoseCode {
        x,
        y,
        rotation: rotation & !APPLY,
    };
    Ok((pose, rotation & APPLY != 0))
}

// Requirement: DOC-5.1.1-5
#[inline(always)]
fn write(writer: &mut FrameWriter<'_>, pose: &PoseCode, apply: bool) {
    let apply = if apply { APPLY } else { 0 };
    writer.put(pose.x.to_be_bytes());
    writer.put(pose.y.to_be_bytes());
    writer.put((pose.rotation & !APPLY | apply).to_be_bytes());
}

impl Strategy for Position {
    const NAME: &'static str = "position";
    const LEN: usize = 10;

    #[inline(always)]
    fn parse_command(reader: &mut FrameReader<'_>, _: &Context, command: &mut Command) -> Parsed {
        (command.expected, command.apply) = parse(reader)?;
        Ok(())
    }

    #[inline(always)]
    fn write_command(writer: &mut FrameWriter<'_>, _context: &Context, command: &Command) {
        write(writer, &command.expected, command.apply);
    }

    #[inline(always)]
    fn parse_report(reader: &mut FrameReader<'_>, _: &Context, report: &mut Report) -> Parsed {
        // "NU - not used": whatever the original STM leaves there.
        (report.pose, _) = parse(reader)?;
        Ok(())
    }

    #[inline(always)]
    fn write_report(writer: &mut FrameWriter<'_>, _context: &Context, report: &Report) {
        write(writer, &report.pose, false);
    }
}

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

use super::strategy::{Context, Duties, Fault, Input, Output};
use super::{Command, PoseCode, Report};

/// Sends the expected pose one way and the actual one the other.
#[derive(Debug)]
pub struct Position;

const APPLY: u16 = 0x8000;

/// The pose, and bit 7 of byte 9.
// Requirement: DOC-5.1.1-1
#[inline]
fn parse(input: &mut Input<'_>) -> Result<(PoseCode, bool), Fault> {
    let mut part = input.part::<10>()?;
    let x = i32::from_be_bytes(part.take()?);
    let y = i32::from_be_bytes(part.take()?);
    let rotation = u16::from_be_bytes(part.take()?);
    let pose = PoseCode {
        x,
        y,
        rotation: rotation & !APPLY,
    };
    Ok((pose, rotation & APPLY != 0))
}

// Requirement: DOC-5.1.1-5
#[inline]
fn write(output: &mut Output<'_>, pose: &PoseCode, apply: bool) {
    let apply = if apply { APPLY } else { 0 };
    output.put(pose.x.to_be_bytes());
    output.put(pose.y.to_be_bytes());
    output.put((pose.rotation & !APPLY | apply).to_be_bytes());
}

impl Duties for Position {
    const NAME: &'static str = "position";
    const BYTES: usize = 10;

    #[inline]
    fn parse_command(
        input: &mut Input<'_>,
        _context: &Context,
        command: &mut Command,
    ) -> Result<(), Fault> {
        (command.expected, command.apply) = parse(input)?;
        Ok(())
    }

    #[inline]
    fn write_command(output: &mut Output<'_>, _context: &Context, command: &Command) {
        write(output, &command.expected, command.apply);
    }

    #[inline]
    fn parse_report(
        input: &mut Input<'_>,
        _context: &Context,
        report: &mut Report,
    ) -> Result<(), Fault> {
        // "NU - not used": whatever the original STM leaves there.
        (report.pose, _) = parse(input)?;
        Ok(())
    }

    #[inline]
    fn write_report(output: &mut Output<'_>, _context: &Context, report: &Report) {
        write(output, &report.pose, false);
    }
}

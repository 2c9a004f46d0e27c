//! Velocity: the commanded speeds one way, the actual pose the other.
//!
//! | byte | Pi → STM | STM → Pi |
//! |---|---|---|
//! | 1–4 | forward speed, µm/s, two's complement, big-endian | actual x, as in position |
//! | 5–8 | yaw rate, turn/s × 2³², counter-clockwise positive, the same | actual y |
//! | 9–10 | 0; anything else is rejected | actual rotation |

use super::error::Reason;
use super::position::Position;
use super::strategy::{Context, FrameReader, FrameWriter, Parsed, Strategy};
use super::{Command, Report};
use crate::types;

/// Sends the commanded velocity one way and the actual pose the other.
#[derive(Debug)]
pub struct Velocity;

impl Strategy for Velocity {
    const NAME: &'static str = "velocity";
    const LEN: usize = 10;

    // Requirement: WIRE-velocity-1, WIRE-velocity-2
    #[inline(always)]
    fn parse_command(reader: &mut FrameReader<'_>, _: &Context, command: &mut Command) -> Parsed {
        reader.require(Self::LEN)?;
        command.velocity = types::Velocity {
            forward: i32::from_be_bytes(reader.take()?),
            yaw_rate: i32::from_be_bytes(reader.take()?),
        };
        match u16::from_be_bytes(reader.take()?) {
            0 => Ok(()),
            reserved => Err(reader.error(2, Reason::Reserved(reserved))),
        }
    }

    #[inline(always)]
    fn write_command(writer: &mut FrameWriter<'_>, _context: &Context, command: &Command) {
        writer.put(command.velocity.forward.to_be_bytes());
        writer.put(command.velocity.yaw_rate.to_be_bytes());
        writer.put([0, 0]);
    }

    #[inline(always)]
    fn parse_report(
        reader: &mut FrameReader<'_>,
        context: &Context,
        report: &mut Report,
    ) -> Parsed {
        Position::parse_report(reader, context, report)
    }

    #[inline(always)]
    fn write_report(writer: &mut FrameWriter<'_>, context: &Context, report: &Report) {
        Position::write_report(writer, context, report);
    }
}

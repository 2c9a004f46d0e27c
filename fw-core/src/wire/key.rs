//! Transmission key: one byte that each end knows of the other (document, 5.1.6).
//!
//! First in every chain, so that a frame of anything else is not read any further.

use super::error::{FieldError, Reason};
use super::strategy::{Context, FrameReader, FrameWriter, Parsed, Strategy};
use super::{Command, Report};

/// Sends the own key, accepts only the other end's.
#[derive(Debug)]
pub struct Key;

// Requirement: DOC-5.1.6-1
#[inline]
fn parse(reader: &mut FrameReader<'_>, expected: u8) -> Result<(), FieldError> {
    let [found] = reader.take()?;
    if found == expected {
        Ok(())
    } else {
        Err(reader.error(1, Reason::Key { expected, found }))
    }
}

impl Strategy for Key {
    const NAME: &'static str = "transmission key";
    const LEN: usize = 1;

    #[inline]
    fn parse_command(
        reader: &mut FrameReader<'_>,
        context: &Context,
        _command: &mut Command,
    ) -> Parsed {
        parse(reader, context.key_from_pi)
    }

    fn write_command(writer: &mut FrameWriter<'_>, context: &Context, _command: &Command) {
        writer.put([context.key_from_pi]);
    }

    fn parse_report(
        reader: &mut FrameReader<'_>,
        context: &Context,
        _report: &mut Report,
    ) -> Parsed {
        parse(reader, context.key_from_stm)
    }

    fn write_report(writer: &mut FrameWriter<'_>, context: &Context, _report: &Report) {
        writer.put([context.key_from_stm]);
    }
}

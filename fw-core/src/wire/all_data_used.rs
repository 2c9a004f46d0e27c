//! All data used: takes nothing and fails if anything is left (document, 5.1.5). Last in every
//! chain.

use super::error::{FieldError, Reason};
use super::strategy::{Context, FrameReader, FrameWriter, Parsed, Strategy};
use super::{Command, Report};

/// Accepts only the end of the frame.
#[derive(Debug)]
pub struct AllDataUsed;

// Requirement: DOC-5.1.5-1
fn parse(reader: &FrameReader<'_>) -> Result<(), FieldError> {
    if reader.remaining() == 0 {
        return Ok(());
    }
    // The chain counts what is left.
    Err(reader.error(0, Reason::Long { left: 0 }))
}

impl Strategy for AllDataUsed {
    const NAME: &'static str = "all data used";
    const LEN: usize = 0;

    fn parse_command(reader: &mut FrameReader<'_>, _: &Context, _command: &mut Command) -> Parsed {
        parse(reader)
    }

    fn write_command(_writer: &mut FrameWriter<'_>, _context: &Context, _command: &Command) {}

    fn parse_report(reader: &mut FrameReader<'_>, _: &Context, _report: &mut Report) -> Parsed {
        parse(reader)
    }

    fn write_report(_writer: &mut FrameWriter<'_>, _context: &Context, _report: &Report) {}
}

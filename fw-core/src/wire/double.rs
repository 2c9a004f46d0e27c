//! Double: IEEE-754 binary64 in the byte order of a little-endian union (document, 5.1.2).
//!
//! From the Pi: percent to set on the engines, −100 ..= 100 (both included). From the STM: the
//! measured rotation (°) or displacement (mm), any finite number.

use super::error::{FieldError, Reason};
use super::strategy::{Context, FrameReader, FrameWriter, Parsed, Strategy};
use super::{Command, Report};
use crate::binary64::Binary64;

/// Sends a percentage one way and a measurement the other.
#[derive(Debug)]
pub struct Double;

/// The bits of 100.0: exponent 6, mantissa 100 / 64. Magnitudes order like their bits.
const HUNDRED: u64 = 0x4059_0000_0000_0000;

// Requirement: DOC-5.1.2-1, WIRE-double-2
#[inline]
fn parse(reader: &mut FrameReader<'_>) -> Result<Binary64, FieldError> {
    let value = Binary64(u64::from_le_bytes(reader.take()?));
    if value.is_finite() {
        Ok(value)
    } else {
        Err(reader.error(8, Reason::NotFinite))
    }
}

impl Strategy for Double {
    const NAME: &'static str = "double";
    const LEN: usize = 8;

    #[inline]
    fn parse_command(reader: &mut FrameReader<'_>, _: &Context, command: &mut Command) -> Parsed {
        let percent = parse(reader)?;
        // Requirement: WIRE-double-1
        if percent.magnitude() > HUNDRED {
            return Err(reader.error(8, Reason::PercentOutOfRange));
        }
        command.percent = percent;
        Ok(())
    }

    fn write_command(writer: &mut FrameWriter<'_>, _context: &Context, command: &Command) {
        writer.put(command.percent.0.to_le_bytes());
    }

    fn parse_report(reader: &mut FrameReader<'_>, _: &Context, report: &mut Report) -> Parsed {
        report.measurement = parse(reader)?;
        Ok(())
    }

    fn write_report(writer: &mut FrameWriter<'_>, _context: &Context, report: &Report) {
        writer.put(report.measurement.0.to_le_bytes());
    }
}

//! Bearing: where the servo pointed when the reading of this frame was taken.
//!
//! STM → Pi: turn × 0x10000, big-endian. From the Pi the two bytes are dummies: sent as 0, ignored.

use super::error::FieldError;
use super::strategy::{Context, FrameReader, FrameWriter, Strategy};
use super::{Command, Report};

/// Sends the bearing of the swept rangefinder's reading.
#[derive(Debug)]
pub struct Bearing;

impl Strategy for Bearing {
    const NAME: &'static str = "bearing";
    const LEN: usize = 2;

    #[inline]
    fn parse_command(
        reader: &mut FrameReader<'_>,
        _context: &Context,
        _command: &mut Command,
    ) -> Result<(), FieldError> {
        let [_, _] = reader.take()?;
        Ok(())
    }

    #[inline]
    fn write_command(writer: &mut FrameWriter<'_>, _context: &Context, _command: &Command) {
        writer.put([0, 0]);
    }

    #[inline]
    fn parse_report(
        reader: &mut FrameReader<'_>,
        _context: &Context,
        report: &mut Report,
    ) -> Result<(), FieldError> {
        report.bearing = u16::from_be_bytes(reader.take()?);
        Ok(())
    }

    #[inline]
    fn write_report(writer: &mut FrameWriter<'_>, _context: &Context, report: &Report) {
        writer.put(report.bearing.to_be_bytes());
    }
}

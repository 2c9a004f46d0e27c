//! Bearing: where the servo pointed when the reading of this frame was taken; the sweep's width.
//!
//! Both ways turn × 0x10000, big-endian. Pi → STM: half the width of the sweep around straight ahead, in
//! [`Mode::GuardedVelocity`](super::Mode::GuardedVelocity); 0 and ignored in the sweep mode.

use super::strategy::{Context, FrameReader, FrameWriter, Parsed, Strategy};
use super::{Command, Report};

/// Sends the bearing of the swept rangefinder's reading one way and the sweep's width the other.
#[derive(Debug)]
pub struct Bearing;

impl Strategy for Bearing {
    const NAME: &'static str = "bearing";
    const LEN: usize = 2;

    #[inline(always)]
    fn parse_command(reader: &mut FrameReader<'_>, _: &Context, command: &mut Command) -> Parsed {
        command.sweep = u16::from_be_bytes(reader.take()?);
        Ok(())
    }

    #[inline(always)]
    fn write_command(writer: &mut FrameWriter<'_>, _context: &Context, command: &Command) {
        writer.put(command.sweep.to_be_bytes());
    }

    #[inline(always)]
    fn parse_report(reader: &mut FrameReader<'_>, _: &Context, report: &mut Report) -> Parsed {
        report.bearing = u16::from_be_bytes(reader.take()?);
        Ok(())
    }

    #[inline(always)]
    fn write_report(writer: &mut FrameWriter<'_>, _context: &Context, report: &Report) {
        writer.put(report.bearing.to_be_bytes());
    }
}

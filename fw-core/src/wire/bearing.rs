//! Bearing: where the servo pointed when the reading of this frame was taken.
//!
//! STM → Pi: turn × 0x10000, big-endian. From the Pi the two bytes are dummies: sent as 0, ignored.

use super::strategy::{Context, Duties, Fault, Input, Output};
use super::{Command, Report};

/// Sends the bearing of the swept rangefinder's reading.
#[derive(Debug)]
pub struct Bearing;

impl Duties for Bearing {
    const NAME: &'static str = "bearing";
    const BYTES: usize = 2;

    #[inline]
    fn parse_command(
        input: &mut Input<'_>,
        _context: &Context,
        _command: &mut Command,
    ) -> Result<(), Fault> {
        let [_, _] = input.take()?;
        Ok(())
    }

    #[inline]
    fn write_command(output: &mut Output<'_>, _context: &Context, _command: &Command) {
        output.put([0, 0]);
    }

    #[inline]
    fn parse_report(
        input: &mut Input<'_>,
        _context: &Context,
        report: &mut Report,
    ) -> Result<(), Fault> {
        report.bearing = u16::from_be_bytes(input.take()?);
        Ok(())
    }

    #[inline]
    fn write_report(output: &mut Output<'_>, _context: &Context, report: &Report) {
        output.put(report.bearing.to_be_bytes());
    }
}

//! Distance measure: one rangefinder's reading, big-endian (document, 5.1.4).
//!
//! From the Pi the two bytes are dummies: sent as 0, ignored.

use super::strategy::{Context, FrameReader, FrameWriter, Parsed, Strategy};
use super::{Command, DistanceCode, Report};

/// The reading at place `WHICH` of [`Report::ranges`].
#[derive(Debug)]
pub struct Distance<const WHICH: usize>;

/// The front rangefinder; the swept one where there is a servo.
pub type Front = Distance<0>;
/// The right rangefinder.
pub type Right = Distance<1>;
/// The left rangefinder.
pub type Left = Distance<2>;

impl<const WHICH: usize> Strategy for Distance<WHICH> {
    const NAME: &'static str = match WHICH {
        0 => "distance front",
        1 => "distance right",
        _ => "distance left",
    };
    const LEN: usize = 2;

    #[inline(always)]
    fn parse_command(reader: &mut FrameReader<'_>, _: &Context, _command: &mut Command) -> Parsed {
        // Requirement: DOC-5.1.4-3
        let [_, _] = reader.take()?;
        Ok(())
    }

    #[inline(always)]
    fn write_command(writer: &mut FrameWriter<'_>, _context: &Context, _command: &Command) {
        writer.put([0, 0]);
    }

    #[inline(always)]
    fn parse_report(reader: &mut FrameReader<'_>, _: &Context, report: &mut Report) -> Parsed {
        let code = DistanceCode(u16::from_be_bytes(reader.take()?));
        if let Some(range) = report.ranges.get_mut(WHICH) {
            *range = code;
        }
        Ok(())
    }

    #[inline(always)]
    fn write_report(writer: &mut FrameWriter<'_>, _context: &Context, report: &Report) {
        let code = report.ranges.get(WHICH).copied().unwrap_or_default();
        writer.put(code.0.to_be_bytes());
    }
}

//! Gyro: the gyroscope's own angle since reset.
//!
//! STM → Pi: turns × 2²⁴, counter-clockwise positive, 32-bit two's complement, big-endian, wrapping;
//! `0x8000_0000` = none. From the Pi the four bytes are dummies: sent as 0, ignored.

use super::strategy::{Context, FrameReader, FrameWriter, Parsed, Strategy};
use super::{Command, GyroCode, Report};

/// Sends the gyroscope's angle.
#[derive(Debug)]
pub struct Gyro;

impl Strategy for Gyro {
    const NAME: &'static str = "gyro";
    const LEN: usize = 4;

    #[inline(always)]
    fn parse_command(reader: &mut FrameReader<'_>, _: &Context, _command: &mut Command) -> Parsed {
        let [_, _, _, _] = reader.take()?;
        Ok(())
    }

    #[inline(always)]
    fn write_command(writer: &mut FrameWriter<'_>, _context: &Context, _command: &Command) {
        writer.put([0; Self::LEN]);
    }

    // Requirement: WIRE-gyro-1
    #[inline(always)]
    fn parse_report(reader: &mut FrameReader<'_>, _: &Context, report: &mut Report) -> Parsed {
        report.gyro = GyroCode(i32::from_be_bytes(reader.take()?));
        Ok(())
    }

    #[inline(always)]
    fn write_report(writer: &mut FrameWriter<'_>, _context: &Context, report: &Report) {
        writer.put(report.gyro.0.to_be_bytes());
    }
}

//! Double: IEEE-754 binary64 in the byte order of a little-endian union (document, 5.1.2).
//!
//! From the Pi: percent to set on the engines, −100 ..= 100 (both included). From the STM: the
//! measured rotation (°) or displacement (mm), any finite number.

use super::error::Reason;
use super::strategy::{Context, Duties, Fault, Input, Output};
use super::{Command, Report};
use crate::binary64::Binary64;

/// Sends a percentage one way and a measurement the other.
#[derive(Debug)]
pub struct Double;

/// The bits of 100.0: exponent 6, mantissa 100 / 64. Magnitudes order like their bits.
const HUNDRED: u64 = 0x4059_0000_0000_0000;

// Requirement: DOC-5.1.2-1, WIRE-double-2
#[inline]
fn parse(input: &mut Input<'_>) -> Result<Binary64, Fault> {
    let before = *input;
    let value = Binary64(u64::from_le_bytes(input.take()?));
    if value.is_finite() {
        Ok(value)
    } else {
        Err(before.fault(Reason::NotFinite))
    }
}

impl Duties for Double {
    const NAME: &'static str = "double";
    const BYTES: usize = 8;

    #[inline]
    fn parse_command(
        input: &mut Input<'_>,
        _context: &Context,
        command: &mut Command,
    ) -> Result<(), Fault> {
        let before = *input;
        let percent = parse(input)?;
        // Requirement: WIRE-double-1
        if percent.magnitude() > HUNDRED {
            return Err(before.fault(Reason::PercentOutOfRange));
        }
        command.percent = percent;
        Ok(())
    }

    #[inline]
    fn write_command(output: &mut Output<'_>, _context: &Context, command: &Command) {
        output.put(command.percent.0.to_le_bytes());
    }

    #[inline]
    fn parse_report(
        input: &mut Input<'_>,
        _context: &Context,
        report: &mut Report,
    ) -> Result<(), Fault> {
        report.measurement = parse(input)?;
        Ok(())
    }

    #[inline]
    fn write_report(output: &mut Output<'_>, _context: &Context, report: &Report) {
        output.put(report.measurement.0.to_le_bytes());
    }
}

//! Battery: one cell a frame, 3 bits of index and 13 bits of voltage (document, 5.1.3).
//!
//! | byte | Pi → STM | STM → Pi |
//! |---|---|---|
//! | 1 | bits 7–5: cell index; bits 4–0: tune voltage, bits 12–8 | the same, measured voltage |
//! | 2 | tune voltage, bits 7–0 | measured voltage, bits 7–0 |
//!
//! A cell that the configuration does not have is rejected at both ends.

use super::error::Reason;
use super::strategy::{Context, Duties, Fault, Input, Output};
use super::{CellCode, Command, Report};

/// Sends a tune voltage one way and a measured one the other.
#[derive(Debug)]
pub struct Battery;

// Requirement: DOC-5.1.3-1, WIRE-battery-3
#[inline]
fn parse(input: &mut Input<'_>, cells: u8) -> Result<CellCode, Fault> {
    let before = *input;
    let [high, low] = input.take()?;
    let cell = high >> 5;
    // Requirement: DOC-5.1.3-5
    if cell >= cells {
        return Err(before.fault(Reason::Cell { cells, found: cell }));
    }
    let voltage = u16::from_be_bytes([high, low]) & CellCode::MAX_VOLTAGE;
    Ok(CellCode { cell, voltage })
}

#[inline]
fn write(output: &mut Output<'_>, cell: CellCode) {
    let voltage = if cell.voltage > CellCode::MAX_VOLTAGE {
        CellCode::MAX_VOLTAGE
    } else {
        cell.voltage
    };
    output.put((u16::from(cell.cell & 7) << 13 | voltage).to_be_bytes());
}

impl Duties for Battery {
    const NAME: &'static str = "battery";
    const BYTES: usize = 2;

    #[inline]
    fn parse_command(
        input: &mut Input<'_>,
        context: &Context,
        command: &mut Command,
    ) -> Result<(), Fault> {
        command.tune = parse(input, context.cells)?;
        Ok(())
    }

    #[inline]
    fn write_command(output: &mut Output<'_>, _context: &Context, command: &Command) {
        write(output, command.tune);
    }

    #[inline]
    fn parse_report(
        input: &mut Input<'_>,
        context: &Context,
        report: &mut Report,
    ) -> Result<(), Fault> {
        report.cell = parse(input, context.cells)?;
        Ok(())
    }

    #[inline]
    fn write_report(output: &mut Output<'_>, _context: &Context, report: &Report) {
        write(output, report.cell);
    }
}

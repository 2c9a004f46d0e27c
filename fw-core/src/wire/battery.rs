//! Battery: one cell a frame, 3 bits of index and 13 bits of voltage (document, 5.1.3).
//!
//! | byte | Pi → STM | STM → Pi |
//! |---|---|---|
//! | 1 | bits 7–5: cell index; bits 4–0: tune voltage, bits 12–8 | the same, measured voltage |
//! | 2 | tune voltage, bits 7–0 | measured voltage, bits 7–0 |
//!
//! A cell that the configuration does not have is rejected at both ends.

use super::error::{FieldError, Reason};
use super::strategy::{Context, FrameReader, FrameWriter, Parsed, Strategy};
use super::{CellCode, Command, Report};

/// Sends a tune voltage one way and a measured one the other.
#[derive(Debug)]
pub struct Battery;

// Requirement: DOC-5.1.3-1, WIRE-battery-3
#[inline(always)]
fn parse(reader: &mut FrameReader<'_>, cells: u8) -> Result<CellCode, FieldError> {
    let [high, low] = reader.take()?;
    let cell = high >> 5;
    // Requirement: DOC-5.1.3-5
    if cell >= cells {
        return Err(reader.error(2, Reason::Cell { cells, found: cell }));
    }
    let voltage = u16::from_be_bytes([high, low]) & CellCode::MAX_VOLTAGE;
    Ok(CellCode { cell, voltage })
}

#[inline(always)]
fn write(writer: &mut FrameWriter<'_>, cell: CellCode) {
    let voltage = if cell.voltage > CellCode::MAX_VOLTAGE {
        CellCode::MAX_VOLTAGE
    } else {
        cell.voltage
    };
    writer.put((u16::from(cell.cell & 7) << 13 | voltage).to_be_bytes());
}

impl Strategy for Battery {
    const NAME: &'static str = "battery";
    const LEN: usize = 2;

    #[inline(always)]
    fn parse_command(
        reader: &mut FrameReader<'_>,
        context: &Context,
        command: &mut Command,
    ) -> Parsed {
        command.tune = parse(reader, context.cells)?;
        Ok(())
    }

    #[inline(always)]
    fn write_command(writer: &mut FrameWriter<'_>, _context: &Context, command: &Command) {
        write(writer, command.tune);
    }

    #[inline(always)]
    fn parse_report(
        reader: &mut FrameReader<'_>,
        context: &Context,
        report: &mut Report,
    ) -> Parsed {
        report.cell = parse(reader, context.cells)?;
        Ok(())
    }

    #[inline(always)]
    fn write_report(writer: &mut FrameWriter<'_>, _context: &Context, report: &Report) {
        write(writer, report.cell);
    }
}

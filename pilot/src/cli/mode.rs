//! `mode`: another mode on both ends.

use super::connection::{Connection, Context};
use super::monitor;
use fw_core::wire::Mode;
use host_link::error::Error;
use serde_json::json;

/// Runs the command.
pub fn run(mode: Mode, context: Context<'_>) -> Result<(), Error> {
    let output = context.output;
    context.with_board(|Connection { io, journal, .. }| {
        let changed = pilot::mode::change(
            io,
            mode,
            context.board.rate,
            context.board.ready_timeout,
            Some(journal),
            |step| output.progress(step),
        );
        output.live("");
        let (before, programmed, session) = changed?;
        let (before, report) = (before.name(), session.snapshot());
        let (bytes, ready_ms) = (programmed.bytes, programmed.ready_ms);
        let done = json!({
            "before": before, "bytes": bytes, "ready_ms": ready_ms, "report": report,
        });
        output.result(&done, || {
            format!(
                "mode {before} -> {}: {bytes} bytes written and read back; STM ready {ready_ms} ms after its \
                 reset; both ends use it\n{}",
                mode.name(),
                monitor::line(report)
            )
        })
    })
}

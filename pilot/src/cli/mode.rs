//! `mode`: another mode on both ends.

use super::connection::{Connection, Context};
use super::monitor;
use fw_core::wire::Mode;
use host_link::error::Error;
use host_link::snapshot::Snapshot;
use serde::Serialize;

#[derive(Serialize)]
struct Done<'a> {
    before: &'static str,
    bytes: usize,
    ready_ms: u32,
    report: &'a Snapshot,
}

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
        let changed = changed?;
        let done = Done {
            before: changed.before.name(),
            bytes: changed.programmed.bytes,
            ready_ms: changed.programmed.ready_ms,
            report: changed.session.snapshot(),
        };
        output.result(&done, || {
            format!(
                "mode {} -> {}: {} bytes written and read back; STM ready {} ms after its reset; both ends \
                 use it\n{}",
                done.before,
                mode.name(),
                done.bytes,
                done.ready_ms,
                monitor::line(done.report)
            )
        })
    })
}

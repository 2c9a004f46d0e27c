//! `mode`: another mode on both ends.

use super::args::Robot;
use super::connection::Job;
use super::output::Output;
use fw_core::wire::Mode;
use host_link::board_io::{Machine, Wires};
use host_link::eeprom::journal::Journal;
use host_link::eeprom::Step;
use host_link::error::{Error, Exit};
use host_link::snapshot::Snapshot;
use pilot::mode;
use serde::Serialize;

/// The command.
pub struct Change<'a> {
    pub mode: Mode,
    pub robot: &'a Robot,
    pub output: Output,
}

#[derive(Serialize)]
struct Done<'a> {
    before: &'static str,
    bytes: usize,
    ready_ms: u32,
    report: &'a Snapshot,
}

impl Job for Change<'_> {
    type Result = Exit;

    fn run<W: Wires>(self, machine: &mut Machine<W>, journal: &Journal) -> Result<Exit, Error> {
        let Robot {
            rate,
            ready_timeout,
            ..
        } = *self.robot;
        let output = self.output;
        let watch = |step: Step<'_>| {
            if let Step::Written { done, of } = step {
                output.live(&format!("{done} of {of} bytes"));
            }
        };
        let changed = mode::change(
            machine,
            self.mode,
            rate,
            ready_timeout,
            Some(journal),
            watch,
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
                 speak it\n{}",
                done.before,
                self.mode.name(),
                done.bytes,
                done.ready_ms,
                super::monitor::line(done.report)
            )
        });
        Ok(Exit::Ok)
    }
}

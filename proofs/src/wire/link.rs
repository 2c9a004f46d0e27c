//! T1 and T2: what one end sends the other understands, and a rejected frame changes nothing.

use fw_core::wire::{CellCode, Command, MAX_FRAME, Mode, PiLink, Report, Setup, StmLink};

use super::parsing::LONGER;
use super::table::{Frame, table, word};
use crate::property::Seen;

/// Whether both cells of a configuration and of a frame can exist.
pub fn cell_exists(cell: CellCode, setup: Setup) -> bool {
    setup.cells <= 8 && cell.cell < setup.cells && cell.voltage <= CellCode::MAX_VOLTAGE
}

/// What `command` is after a frame that carries only some of it.
fn carried_of_command(mode: Mode, command: &Command, received: &Command) -> Command {
    let table = table(mode);
    let mut carried = Command {
        tune: command.tune,
        ..Command::default()
    };
    if table.bearing.is_some() {
        carried.sweep = command.sweep;
    }
    if table.gyro.is_some() {
        carried.velocity = command.velocity;
    } else if table.double.is_some() {
        carried.percent = command.percent;
    } else {
        carried.expected = command.expected;
        carried.apply = command.apply;
    }
    if table.guarded {
        // The link numbers its frames itself.
        carried.sequence = received.sequence;
        carried.clear_faults = command.clear_faults;
        carried.order = command.order;
    }
    carried
}

/// What `report` is after a frame that carries only some of it.
fn carried_of_report(mode: Mode, report: &Report, received: &Report) -> Report {
    let table = table(mode);
    let mut carried = Report {
        cell: report.cell,
        ..Report::default()
    };
    if table.double.is_some() {
        carried.measurement = report.measurement;
    } else {
        carried.pose = report.pose;
    }
    let (_, count) = table.ranges;
    if count > 0 {
        carried.ranges[0] = report.ranges[0];
    }
    if count > 1 {
        carried.ranges = report.ranges;
    }
    if table.bearing.is_some() {
        carried.bearing = report.bearing;
    }
    if table.gyro.is_some() {
        carried.gyro = report.gyro;
    }
    if table.guarded {
        carried.sequence = received.sequence;
        carried.faults = report.faults;
        carried.state = report.state;
        carried.obstacle_limited = report.obstacle_limited;
        carried.clipped = report.clipped;
    }
    carried
}

/// The bits of 100.0.
pub const HUNDRED: u64 = 100.0_f64.to_bits();

/// What the Pi sends the STM understands, field by field; frame after frame.
// Requirement: DOC-5-2
pub fn command_survives_the_wire(setup: Setup, command: Command, earlier: u8) -> Seen {
    given!(cell_exists(command.tune, setup) && command.percent.magnitude() <= HUNDRED);
    given!(command.expected.rotation <= 0x7FFF);
    let (mut pi, mut stm) = (PiLink::new(setup), StmLink::new(setup));
    let mut frame = [0; MAX_FRAME];
    let later = earlier & 1 == 1;
    if later {
        let len = pi.send(&Command::default(), &mut frame);
        assert!(stm.receive(&frame[..len], 0, 1).is_ok());
    }
    let len = pi.send(&command, &mut frame);
    assert!(len == table(setup.mode).len);
    let received = stm.receive(&frame[..len], 0, 1);
    assert!(received.is_ok());
    if let Ok(received) = received {
        assert!(received == carried_of_command(setup.mode, &command, &received));
    }
    Seen::NOTHING.case(0, !later).case(1, later)
}

/// What the STM sends the Pi understands, field by field; written again with fresher data it has the
/// same number, and the fresher data is what arrives.
// Requirement: DOC-5-2
pub fn report_survives_the_wire(setup: Setup, report: Report, reply: u32, staler: bool) -> Seen {
    given!(cell_exists(report.cell, setup) && report.measurement.is_finite());
    given!(report.pose.rotation <= 0x7FFF);
    let (mut pi, stm) = (PiLink::new(setup), StmLink::new(setup));
    let mut frame = [0; MAX_FRAME];
    let first = if staler { &Report::default() } else { &report };
    let len = stm.encode_reply(reply, first, &mut frame);
    assert!(len == table(setup.mode).len);
    let number = frame[1];
    if staler {
        assert!(stm.encode_reply(reply, &report, &mut frame) == len);
        assert!(!table(setup.mode).guarded || frame[1] == number);
    }
    let received = pi.receive(&frame[..len]);
    assert!(received.is_ok());
    if let Ok(received) = received {
        assert!(received == carried_of_report(setup.mode, &report, &received));
    }
    Seen::NOTHING.case(0, staler).case(1, !staler)
}

/// Whatever the STM received before, a frame it rejects changes a counter by one and nothing else:
/// the reply that stands keeps its numbers, and nothing is accepted, missed or acknowledged by it.
// Requirement: WIRE-chain-1
pub fn rejection_changes_one_counter(
    setup: Setup,
    first: Frame,
    second: [u8; LONGER],
    clocked: u8,
) -> Seen {
    let mut link = StmLink::new(setup);
    let len = table(setup.mode).len;
    let primed = link.receive(&first[..len], 0, 1).is_ok();
    let report = Report::default();
    let (mut before, mut after) = ([0; MAX_FRAME], [0; MAX_FRAME]);
    let _ = link.encode_reply(2, &report, &mut before);
    let counted = *link.counters();
    let clocked = usize::from(clocked);
    let received = second.get(..clocked).unwrap_or(&second);
    let overflow_len = clocked.saturating_sub(second.len());
    let refused = link.receive(received, overflow_len, 2).is_err();
    let counters = link.counters();
    if refused {
        let _ = link.encode_reply(2, &report, &mut after);
        assert!(before[0] == after[0]);
        assert!(!table(setup.mode).guarded || word(&before, 1) == word(&after, 1));
        assert!(counters.accepted == counted.accepted);
        assert!(counters.missed == counted.missed);
        assert!(counters.unacknowledged == counted.unacknowledged);
        assert!(counters.rejected_total() == counted.rejected_total() + 1);
    } else {
        assert!(counters.accepted == counted.accepted + 1);
        assert!(counters.rejected_total() == counted.rejected_total());
    }
    assert!(counters.overrun == 0);
    seen!(primed && refused, !primed && refused)
}

/// A setup with one mode, everything else arbitrary.
#[cfg(kani)]
fn any_setup(mode: Mode) -> Setup {
    Setup {
        mode,
        ..crate::input::any()
    }
}

crate::properties! {
    property T2 command_survives_the_wire(setup: Setup, command: Command, earlier: u8) {
        cases ["the first frame", "a later frame"];
        kani normal [unwind(12)] = (any_setup(Mode::Normal), any(), any());
        kani tune_rotate [unwind(12)] = (any_setup(Mode::TuneRotate), any(), any());
        kani tune_move [unwind(12)] = (any_setup(Mode::TuneMove), any(), any());
        sampled 300_000;
    }
    property T2 report_survives_the_wire(setup: Setup, report: Report, reply: u32, staler: bool) {
        cases ["written again", "as first written"];
        kani normal [unwind(12)] = (any_setup(Mode::Normal), any(), any(), any());
        kani tune_rotate [unwind(12)] = (any_setup(Mode::TuneRotate), any(), any(), any());
        kani tune_move [unwind(12)] = (any_setup(Mode::TuneMove), any(), any(), any());
        sampled 300_000;
    }
    property T1 rejection_changes_one_counter(
        setup: Setup, first: Frame, second: [u8; LONGER], clocked: u8
    ) {
        cases ["after a frame was taken", "before any was taken"];
        kani normal [unwind(12), solver(minisat)] = (any_setup(Mode::Normal), any(), any(), any());
        kani tune_rotate [unwind(12), solver(minisat)] = (any_setup(Mode::TuneRotate), any(), any(), any());
        kani tune_move [unwind(12), solver(minisat)] = (any_setup(Mode::TuneMove), any(), any(), any());
        kani guarded_tune_rotate [unwind(12)] =
            (any_setup(Mode::GuardedTuneRotate), any(), any(), 18);
        sampled 300_000;
    }
}

//! T1 and T2: what one end sends the other understands, and a rejected frame changes nothing.

use fw_core::wire::{CellCode, Command, Mode, PiLink, Report, Setup, StmLink, MAX_FRAME};

use super::table::{table, word, Frame};
use crate::theorem::Seen;

/// Whether both cells of a configuration and of a frame can exist.
fn cell_exists(cell: CellCode, setup: Setup) -> bool {
    setup.cells <= 8 && cell.cell < setup.cells && cell.voltage <= CellCode::MAX_VOLTAGE
}

/// What `command` is after a frame that carries only some of it.
fn carried_of_command(mode: Mode, command: &Command, received: &Command) -> Command {
    let table = table(mode);
    let mut carried = Command {
        tune: command.tune,
        ..Command::default()
    };
    if table.double.is_some() {
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
    if table.guarded {
        carried.sequence = received.sequence;
        carried.faults = report.faults;
        carried.state = report.state;
    }
    carried
}

/// The bits of 100.0.
const HUNDRED: u64 = 100.0_f64.to_bits();

/// What the Pi sends the STM understands, field by field; frame after frame.
pub fn command_survives_the_wire(setup: Setup, command: Command, earlier: u8) -> Seen {
    let possible = cell_exists(command.tune, setup)
        && command.expected.rotation <= 0x7FFF
        && command.percent.magnitude() <= HUNDRED;
    if !possible {
        return Seen::NOTHING;
    }
    let (mut pi, mut stm) = (PiLink::new(setup), StmLink::new(setup));
    let mut frame = [0; MAX_FRAME];
    for _ in 0..earlier & 1 {
        let len = pi.send(&Command::default(), &mut frame);
        assert!(stm.receive(&frame[..len]).is_ok());
    }
    let len = pi.send(&command, &mut frame);
    assert!(len == table(setup.mode).len);
    let received = stm.receive(&frame[..len]);
    assert!(received.is_ok());
    if let Ok(received) = received {
        assert!(received == carried_of_command(setup.mode, &command, &received));
    }
    Seen::NOTHING
        .case(0, earlier & 1 == 0)
        .case(1, earlier & 1 == 1)
}

/// What the STM sends the Pi understands, field by field; written anew with fresher data it has the
/// same number, and the fresher data is what arrives.
pub fn report_survives_the_wire(setup: Setup, report: Report, staler: bool) -> Seen {
    let possible = cell_exists(report.cell, setup)
        && report.pose.rotation <= 0x7FFF
        && report.measurement.is_finite();
    if !possible {
        return Seen::NOTHING;
    }
    let (mut pi, mut stm) = (PiLink::new(setup), StmLink::new(setup));
    let mut frame = [0; MAX_FRAME];
    let first = if staler { &Report::default() } else { &report };
    let len = stm.send(first, &mut frame);
    assert!(len == table(setup.mode).len);
    let number = frame[1];
    if staler {
        assert!(stm.resend(&report, &mut frame) == len);
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
pub fn rejection_changes_one_counter(
    setup: Setup,
    first: Frame,
    second: [u8; 28],
    clocked: u8,
) -> Seen {
    let mut link = StmLink::new(setup);
    let len = table(setup.mode).len;
    let primed = link.receive(&first[..len]).is_ok();
    let report = Report::default();
    let (mut before, mut after) = ([0; MAX_FRAME], [0; MAX_FRAME]);
    let _ = link.send(&report, &mut before);
    let counted = *link.counters();
    let refused = link.receive_clocked(&second, usize::from(clocked)).is_err();
    let counters = link.counters();
    if refused {
        let _ = link.resend(&report, &mut after);
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
    Seen::NOTHING
        .case(0, primed && refused)
        .case(1, !primed && refused)
}

/// A frame that the STM once took is never taken a second time in a guarded mode, whatever came in
/// between as long as the numbers have not gone half way around.
pub fn repeated_frame_is_stale(setup: Setup, command: Command, between: u8) -> Seen {
    let possible = table(setup.mode).guarded
        && cell_exists(command.tune, setup)
        && command.percent.magnitude() <= HUNDRED
        && between < 128;
    if !possible {
        return Seen::NOTHING;
    }
    let (mut pi, mut stm) = (PiLink::new(setup), StmLink::new(setup));
    let (mut frame, mut newer) = ([0; MAX_FRAME], [0; MAX_FRAME]);
    let len = pi.send(&command, &mut frame);
    assert!(stm.receive(&frame[..len]).is_ok());
    for _ in 0..between {
        let _ = pi.send(&command, &mut newer);
        assert!(stm.receive(&newer[..len]).is_ok());
    }
    assert!(stm.receive(&frame[..len]).is_err());
    assert!(stm.counters().accepted == u32::from(between) + 1);
    Seen::NOTHING.case(0, between == 0).case(1, between == 127)
}

/// However the two ends stand to each other (one restarted, both, or any number of frames lost), after
/// four undisturbed exchanges each takes the other's frames.
pub fn ends_find_each_other(
    mode: Mode,
    pi_sent: u8,
    stm_heard: u8,
    stm_sent: u8,
    pi_heard: u8,
) -> Seen {
    if !table(mode).guarded {
        return Seen::NOTHING;
    }
    let setup = Setup {
        mode,
        key_from_pi: 0x96,
        key_from_stm: 0x5A,
        cells: 2,
    };
    let (command, report) = (Command::default(), Report::default());
    let mut frame = [0; MAX_FRAME];
    let len = table(mode).len;
    let (mut pi, mut stm) = (PiLink::new(setup), StmLink::new(setup));
    // 0 = heard nothing yet: the other end of this one was another.
    let mut stranger = PiLink::new(setup);
    for _ in 0..stm_heard {
        let _ = stranger.send(&command, &mut frame);
    }
    assert!(stm_heard == 0 || stm.receive(&frame[..len]).is_ok());
    let mut stranger = StmLink::new(setup);
    for _ in 0..pi_heard {
        let _ = stranger.send(&report, &mut frame);
    }
    assert!(pi_heard == 0 || pi.receive(&frame[..len]).is_ok());
    for _ in 0..pi_sent {
        let _ = pi.send(&command, &mut frame);
    }
    for _ in 0..stm_sent {
        let _ = stm.send(&report, &mut frame);
    }
    let mut taken = (false, false);
    let mut at_once = false;
    for exchange in 0..EXCHANGES {
        let mut reply = [0; MAX_FRAME];
        let _ = stm.send(&report, &mut reply);
        let _ = pi.send(&command, &mut frame);
        taken.0 = stm.receive(&frame[..len]).is_ok();
        taken.1 = pi.receive(&reply[..len]).is_ok();
        at_once |= exchange == 0 && taken == (true, true);
    }
    assert!(taken == (true, true));
    Seen::NOTHING.case(0, at_once).case(1, !at_once)
}

/// Undisturbed exchanges after which the ends understand each other.
pub const EXCHANGES: u32 = 4;

/// Every number of one end against every number that the other heard last.
#[cfg(test)]
fn encounters() -> impl Iterator<Item = (Mode, u8, u8, u8, u8)> {
    let edges = [0, 1, 128, 255];
    (0..=255).flat_map(move |sent| {
        (0..=255).flat_map(move |heard| {
            edges.into_iter().flat_map(move |other| {
                [
                    (Mode::GuardedTuneRotate, sent, heard, other, 0),
                    (Mode::GuardedTuneRotate, sent, heard, other, other),
                    (Mode::GuardedTuneRotate, other, 0, sent, heard),
                ]
            })
        })
    })
}

#[cfg(test)]
fn repeats() -> impl Iterator<Item = (Setup, Command, u8)> {
    Mode::ALL.iter().flat_map(|&mode| {
        (0..128).map(move |between| {
            let setup = Setup {
                mode,
                key_from_pi: 0x96,
                key_from_stm: 0x5A,
                cells: 2,
            };
            (setup, Command::default(), between)
        })
    })
}

/// A setup with one mode, everything else arbitrary.
#[cfg(kani)]
fn any_setup(mode: Mode) -> Setup {
    Setup {
        mode,
        ..crate::input::any()
    }
}

crate::theorems! {
    T2 command_survives_the_wire(setup: Setup, command: Command, earlier: u8) {
        cases ["the first frame", "a later frame"];
        kani normal [unwind(12)] = (any_setup(Mode::Normal), any(), any());
        kani tune_rotate [unwind(12)] = (any_setup(Mode::TuneRotate), any(), any());
        kani tune_move [unwind(12)] = (any_setup(Mode::TuneMove), any(), any());
        sampled 300_000;
    }
    T2 report_survives_the_wire(setup: Setup, report: Report, staler: bool) {
        cases ["written anew", "as first written"];
        kani normal [unwind(12)] = (any_setup(Mode::Normal), any(), any());
        kani tune_rotate [unwind(12)] = (any_setup(Mode::TuneRotate), any(), any());
        kani tune_move [unwind(12)] = (any_setup(Mode::TuneMove), any(), any());
        sampled 300_000;
    }
    T1 rejection_changes_one_counter(
        setup: Setup, first: Frame, second: [u8; 28], clocked: u8
    ) {
        cases ["after a frame was taken", "before any was taken"];
        kani normal [unwind(12)] = (any_setup(Mode::Normal), any(), any(), any());
        kani tune_rotate [unwind(12)] = (any_setup(Mode::TuneRotate), any(), any(), any());
        kani guarded_tune_rotate [unwind(12)] =
            (any_setup(Mode::GuardedTuneRotate), any(), any(), 18);
        sampled 300_000;
    }
    T8 ends_find_each_other(
        mode: Mode, pi_sent: u8, stm_heard: u8, stm_sent: u8, pi_heard: u8
    ) {
        cases ["at once", "after some frames"];
        exhaustive encounters();
    }
    T8 repeated_frame_is_stale(setup: Setup, command: Command, between: u8) {
        cases ["at once", "as late as the numbers allow"];
        exhaustive repeats();
    }
}

//! T1 and T2: what one end sends the other understands, and a rejected frame changes nothing.

use fw_core::wire::strategy::Context;
use fw_core::wire::{
    write_command, write_report, CellCode, Command, Mode, PiLink, Report, Setup, StmLink, MAX_FRAME,
};

use super::parsing::LONGER;
use super::table::{is_fresh, table, word, Frame};
use crate::property::Seen;

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
const HUNDRED: u64 = 100.0_f64.to_bits();

/// What the Pi sends the STM understands, field by field; frame after frame.
// Requirement: DOC-5-2
pub fn command_survives_the_wire(setup: Setup, command: Command, earlier: u8) -> Seen {
    let possible = cell_exists(command.tune, setup)
        && command.expected.rotation <= 0x7FFF
        && command.percent.magnitude() <= HUNDRED;
    if !possible {
        return Seen::NOTHING;
    }
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
    let possible = cell_exists(report.cell, setup)
        && report.pose.rotation <= 0x7FFF
        && report.measurement.is_finite();
    if !possible {
        return Seen::NOTHING;
    }
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
    Seen::NOTHING
        .case(0, primed && refused)
        .case(1, !primed && refused)
}

/// A frame that the STM once took is never taken a second time in a guarded mode, whatever came in
/// between as long as the numbers have not gone half way around.
// Requirement: WIRE-sequence-1, WIRE-sequence-6
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
    assert!(stm.receive(&frame[..len], 0, 1).is_ok());
    for _ in 0..between {
        let _ = pi.send(&command, &mut newer);
        assert!(stm.receive(&newer[..len], 0, 1).is_ok());
    }
    assert!(stm.receive(&frame[..len], 0, 1).is_err());
    assert!(stm.counters().accepted == u32::from(between) + 1);
    Seen::NOTHING.case(0, between == 0).case(1, between == 127)
}

/// The setup of the properties of sequence numbers.
const fn plain(mode: Mode) -> Setup {
    Setup {
        mode,
        key_from_pi: 0x96,
        key_from_stm: 0x5A,
        cells: 2,
    }
}

/// A quiet frame of each end with this number.
fn numbered(setup: Setup, own: u8) -> ([u8; MAX_FRAME], [u8; MAX_FRAME]) {
    let context = Context {
        key_from_pi: setup.key_from_pi,
        key_from_stm: setup.key_from_stm,
        cells: setup.cells,
        own,
        last: None,
    };
    let (mut there, mut back) = ([0; MAX_FRAME], [0; MAX_FRAME]);
    let _ = write_command(setup.mode, &context, &Command::default(), &mut there);
    let _ = write_report(setup.mode, &context, &Report::default(), &mut back);
    (there, back)
}

/// Frames of up to three old numbers, in turn as often as one likes, never count: not the same one
/// again and again, not two in turn, not three. So none of them feeds the stop deadline.
// Requirement: WIRE-sequence-3
pub fn old_frames_never_count(mode: Mode, accepted: u8, old: [u8; 3]) -> Seen {
    let stale = |number| !is_fresh(Some(accepted), number);
    if !table(mode).guarded || !old.into_iter().all(stale) {
        return Seen::NOTHING;
    }
    let len = table(mode).len;
    let setup = plain(mode);
    let (mut pi, mut stm) = (PiLink::new(setup), StmLink::new(setup));
    let (there, back) = numbered(setup, accepted);
    assert!(stm.receive(&there[..len], 0, 1).is_ok());
    assert!(pi.receive(&back[..len]).is_ok());
    let old = old.map(|number| (number, numbered(setup, number)));
    for _ in 0..4 {
        for (_, (there, back)) in &old {
            assert!(stm.receive(&there[..len], 0, 1).is_err());
            assert!(pi.receive(&back[..len]).is_err());
        }
    }
    assert!(stm.counters().accepted == 1 && pi.counters().accepted == 1);
    let [(first, _), (second, _), (third, _)] = old;
    let upwards = |number: u8, next: u8| next == number.wrapping_add(1);
    Seen::NOTHING
        .case(0, first == second && second == third)
        .case(1, upwards(first, second) && first == third)
        .case(2, upwards(first, second) && upwards(second, third))
}

/// A frame with a wrong bit restarts no sequence: of four old frames that count upwards, one
/// of them disturbed, none is taken.
// Requirement: WIRE-sequence-3
pub fn disturbed_frame_never_counts(
    mode: Mode,
    accepted: u8,
    behind: u8,
    which: u8,
    bit: u8,
) -> Seen {
    let first = accepted.wrapping_sub(behind);
    let stale = |place| !is_fresh(Some(accepted), first.wrapping_add(place));
    if !table(mode).guarded || which >= 4 || !(0..4).all(stale) {
        return Seen::NOTHING;
    }
    let len = table(mode).len;
    if usize::from(bit) >= 8 * len {
        return Seen::NOTHING;
    }
    let setup = plain(mode);
    let (mut pi, mut stm) = (PiLink::new(setup), StmLink::new(setup));
    let (there, back) = numbered(setup, accepted);
    assert!(stm.receive(&there[..len], 0, 1).is_ok());
    assert!(pi.receive(&back[..len]).is_ok());
    for place in 0..4 {
        let (mut there, mut back) = numbered(setup, first.wrapping_add(place));
        if place == which {
            there[usize::from(bit / 8)] ^= 1 << (bit % 8);
            back[usize::from(bit / 8)] ^= 1 << (bit % 8);
        }
        assert!(stm.receive(&there[..len], 0, 1).is_err());
        assert!(pi.receive(&back[..len]).is_err());
    }
    Seen::NOTHING
        .case(0, usize::from(bit) >= 8 * (len - 2))
        .case(1, bit / 8 == 1)
}

/// However the two ends stand to each other (one restarted, both, or any number of frames lost), after
/// five undisturbed exchanges each takes the other's frames.
// Requirement: WIRE-sequence-3, WIRE-sequence-7
pub fn ends_find_each_other(
    mode: Mode,
    pi_sent: u8,
    stm_accepted: u8,
    stm_sent: u8,
    pi_accepted: u8,
) -> Seen {
    if !table(mode).guarded {
        return Seen::NOTHING;
    }
    let setup = plain(mode);
    let (command, report) = (Command::default(), Report::default());
    let mut frame = [0; MAX_FRAME];
    let len = table(mode).len;
    let (mut pi, mut stm) = (PiLink::new(setup), StmLink::new(setup));
    // 0 = accepted nothing yet.
    let (there, _) = numbered(setup, stm_accepted);
    assert!(stm_accepted == 0 || stm.receive(&there[..len], 0, 1).is_ok());
    let (_, back) = numbered(setup, pi_accepted);
    assert!(pi_accepted == 0 || pi.receive(&back[..len]).is_ok());
    for _ in 0..pi_sent {
        let _ = pi.send(&command, &mut frame);
    }
    let mut taken = (false, false);
    let mut at_once = false;
    let mut late = false;
    for exchange in 0..EXCHANGES {
        let mut reply = [0; MAX_FRAME];
        let number = u32::from(stm_sent) + exchange + 1;
        let _ = stm.encode_reply(number, &report, &mut reply);
        let _ = pi.send(&command, &mut frame);
        taken.0 = stm.receive(&frame[..len], 0, 1).is_ok();
        taken.1 = pi.receive(&reply[..len]).is_ok();
        at_once |= exchange == 0 && taken == (true, true);
        late |= exchange == 2 && taken == (false, false);
    }
    assert!(taken == (true, true));
    Seen::NOTHING.case(0, at_once).case(1, late)
}

/// Undisturbed exchanges after which the ends understand each other.
pub const EXCHANGES: u32 = 5;

/// Every number of one end against every number that the other accepted last, in both directions, while
/// the way back is at rest, has carried nothing yet, wraps, was cut off for long, or comes to the last
/// number accepted within the row. What an end accepts depends on nothing that it sends, so no more
/// combinations matter.
#[cfg(test)]
fn encounters() -> impl Iterator<Item = (Mode, u8, u8, u8, u8)> {
    let ways_back = [
        (7, 7),
        (0, 0),
        (255, 0),
        (0, 255),
        (93, 218),
        (45, 81),
        (10, 14),
    ];
    let mode = Mode::GuardedTuneRotate;
    (0..=255).flat_map(move |sent| {
        (0..=255).flat_map(move |accepted| {
            ways_back
                .into_iter()
                .flat_map(move |(other, other_accepted)| {
                    [
                        (mode, sent, accepted, other, other_accepted),
                        (mode, other, other_accepted, sent, accepted),
                    ]
                })
        })
    })
}

/// Every old number after every number accepted, with every neighbour as the second and the third.
#[cfg(test)]
fn old_frames() -> impl Iterator<Item = (Mode, u8, [u8; 3])> {
    let near = [0, 1, 2, 255];
    (0..=255_u8).flat_map(move |accepted| {
        (0..=128_u8).flat_map(move |behind| {
            near.into_iter().flat_map(move |second| {
                near.into_iter().map(move |third| {
                    let old = accepted.wrapping_sub(behind);
                    let old = [old, old.wrapping_add(second), old.wrapping_add(third)];
                    (Mode::GuardedTuneRotate, accepted, old)
                })
            })
        })
    })
}

/// Every bit of every frame of a row, at both ends of what is old.
#[cfg(test)]
fn disturbed_rows() -> impl Iterator<Item = (Mode, u8, u8, u8, u8)> {
    let guarded = |mode: &Mode| table(*mode).guarded;
    Mode::ALL.iter().copied().filter(guarded).flat_map(|mode| {
        [0, 1, 200].into_iter().flat_map(move |accepted| {
            [4, 64, 128].into_iter().flat_map(move |behind| {
                (0..4).flat_map(move |which| {
                    (0..=255).map(move |bit| (mode, accepted, behind, which, bit))
                })
            })
        })
    })
}

#[cfg(test)]
fn repeats() -> impl Iterator<Item = (Setup, Command, u8)> {
    Mode::ALL
        .iter()
        .flat_map(|&mode| (0..128).map(move |between| (plain(mode), Command::default(), between)))
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
        kani normal [unwind(12)] = (any_setup(Mode::Normal), any(), any(), any());
        kani tune_rotate [unwind(12)] = (any_setup(Mode::TuneRotate), any(), any(), any());
        kani guarded_tune_rotate [unwind(12)] =
            (any_setup(Mode::GuardedTuneRotate), any(), any(), 18);
        sampled 300_000;
    }
    theorem T8 ends_find_each_other(
        mode: Mode, pi_sent: u8, stm_accepted: u8, stm_sent: u8, pi_accepted: u8
    ) {
        cases ["at once", "after three stale frames each"];
        exhaustive encounters();
    }
    theorem T8 old_frames_never_count(mode: Mode, accepted: u8, old: [u8; 3]) {
        cases ["the same again and again", "two in turn", "three that count upwards"];
        exhaustive old_frames();
    }
    theorem T8 disturbed_frame_never_counts(mode: Mode, accepted: u8, behind: u8, which: u8, bit: u8) {
        cases ["in the checksum", "in the number"];
        exhaustive disturbed_rows();
    }
    property T8 repeated_frame_is_stale(setup: Setup, command: Command, between: u8) {
        cases ["at once", "as late as the numbers allow"];
        stepped repeats();
    }
}

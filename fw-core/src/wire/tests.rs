//! What the vectors of `tests/vectors` and the properties of `proofs/` do not already check: exact
//! errors, counters, sequence numbers.

use super::strategy::{Context, FrameReader};
use super::*;
use crate::types::{Faults, Volts};
use std::format;
use std::vec::Vec;

const CONTEXT: Context = Context {
    own: 1,
    ..Setup::first_board(Mode::Normal).context()
};

fn ends(mode: Mode) -> (PiLink, StmLink) {
    let setup = Setup::first_board(mode);
    (PiLink::new(setup), StmLink::new(setup))
}

fn error(field: Field, offset: u16, reason: Reason) -> FrameError {
    FrameError {
        field,
        offset,
        reason,
    }
}

fn guarded() -> impl Iterator<Item = Mode> {
    let all = Mode::ALL.iter().copied();
    all.filter(|mode| mode.has(Field::Sequence))
}

fn command_frame(mode: Mode, command: &Command) -> Vec<u8> {
    let mut frame = [0; MAX_FRAME];
    let len = write_command(mode, &CONTEXT, command, &mut frame);
    frame[..len].to_vec()
}

/// The Pi's frame at rest with this number.
fn numbered_frame(mode: Mode, own: u8) -> Vec<u8> {
    let mut frame = [0; MAX_FRAME];
    let context = Context { own, ..CONTEXT };
    let len = write_command(mode, &context, &Command::default(), &mut frame);
    frame[..len].to_vec()
}

fn report_frame(mode: Mode, report: &Report) -> Vec<u8> {
    let mut frame = [0; MAX_FRAME];
    let len = write_report(mode, &CONTEXT, report, &mut frame);
    frame[..len].to_vec()
}

/// Errors of both ends for a frame of the Pi and one of the STM.
fn errors(mode: Mode, command: &[u8], report: &[u8]) -> [Option<FrameError>; 2] {
    [
        parse_command(mode, &CONTEXT, command, 0).err(),
        parse_report(mode, &CONTEXT, report, 0).err(),
    ]
}

// Requirement: DOC-5.1.5-1, WIRE-crc-2
#[test]
fn long_frame_names_all_data_used_and_excess() {
    for &mode in Mode::ALL {
        let command = command_frame(mode, &Command::default());
        let report = report_frame(mode, &Report::default());
        for excess in [1, 2, 64, 70_000] {
            let left = u16::try_from(excess).unwrap_or(u16::MAX);
            let offset = u16::try_from(frame_len(mode)).unwrap();
            let expected = error(Field::AllDataUsed, offset, Reason::Long { left });
            let tail = std::vec![0xA5; excess];
            let [long, back] = [&command, &report].map(|frame| [&frame[..], &tail].concat());
            assert_eq!(errors(mode, &long, &back), [Some(expected); 2]);
            let beyond = parse_command(mode, &CONTEXT, &command, excess);
            assert_eq!(beyond, Err(expected));
            let both = parse_command(mode, &CONTEXT, &long, 4);
            let left = left.saturating_add(4);
            let expected = error(Field::AllDataUsed, offset, Reason::Long { left });
            assert_eq!(both, Err(expected));
        }
    }
}

#[test]
fn frame_reader_counts_offset_and_overflow() {
    let mut reader = FrameReader::new(&[1, 2, 3], 5);
    assert_eq!((reader.remaining(), reader.offset()), (8, 0));
    assert_eq!(reader.take(), Ok([1_u8]));
    assert_eq!((reader.remaining(), reader.offset()), (7, 1));
    assert_eq!(reader.taken(), [1]);
    assert!(reader.require(2).is_ok() && reader.require(3).is_err());
    assert!(reader.take::<3>().is_err());
    assert_eq!(reader.take(), Ok([2_u8, 3]));
}

#[test]
fn codes_too_large_for_their_bits_are_cut() {
    let mut command = Command::default();
    (command.tune.cell, command.tune.voltage) = (0xFA, 0x2001);
    command.expected.rotation = 0xFFFF;
    let frame = command_frame(Mode::Normal, &command);
    assert_eq!(frame[9..13], [0x7F, 0xFF, 0x5F, 0xFF]);
    assert_eq!(CellCode::from_volts(0xFA, Volts::default()).cell, 2);
}

// Requirement: WIRE-double-1, WIRE-double-2
#[test]
fn percentage_beyond_100_and_nonfinite_doubles_are_rejected() {
    let (beyond, not) = (Some(Reason::PercentOutOfRange), Some(Reason::NotFinite));
    for (value, as_percent, as_measurement) in [
        (-100.0, None, None),
        (100.000_000_000_000_02, beyond, None),
        (f64::NAN, not, not),
        (f64::NEG_INFINITY, not, not),
    ] {
        let value = Binary64(value.to_bits());
        let (mut command, mut report) = (Command::default(), Report::default());
        (command.percent, report.measurement) = (value, value);
        let modes = Mode::ALL.iter().filter(|mode| mode.has(Field::Double));
        for &mode in modes {
            let (there, back) = (command_frame(mode, &command), report_frame(mode, &report));
            let found = errors(mode, &there, &back);
            let found = found.map(|error| error.map(|error| error.reason));
            assert_eq!(found, [as_percent, as_measurement], "{value:?}");
        }
    }
}

// Requirement: WIRE-status-2, WIRE-status-4
#[test]
fn unknown_order_and_state_are_rejected_at_their_byte() {
    for mode in guarded() {
        for code in 0..=255 {
            let with_code = |mut frame: Vec<u8>| {
                frame[5] = code;
                let end = frame.len() - 2;
                let crc = crc::crc16(&frame[..end]).to_be_bytes();
                frame[end..].copy_from_slice(&crc);
                frame
            };
            let command = with_code(command_frame(mode, &Command::default()));
            let report = with_code(report_frame(mode, &Report::default()));
            let error = |reason| error(Field::Status, 5, reason);
            let expected = [
                (code > 2).then(|| error(Reason::UnknownOrder(code))),
                (code & 0x3F > 4).then(|| error(Reason::UnknownState(code))),
            ];
            assert_eq!(errors(mode, &command, &report), expected);
        }
    }
}

// Requirement: WIRE-chain-2
#[test]
fn every_reason_reads_as_one_sentence() {
    let key = |expected, found| Reason::Key { expected, found };
    let crc = |expected, found| Reason::Crc { expected, found };
    let stale = |last, found| Reason::Stale { last, found };
    let short = "frame too short, needs 2 bytes, has 1";
    let checksum = "checksum 0xF00D, expected 0x01AB";
    let (left, cells, found) = (1, 2, 7);
    let texts = [
        (Reason::Short { needed: 2, left }, short),
        (Reason::Long { left: 3 }, "frame too long by 3"),
        (key(0x0A, 0xB0), "key 0xB0, expected 0x0A"),
        (Reason::NotFinite, "not a finite number"),
        (Reason::PercentOutOfRange, "percentage beyond -100 to 100"),
        (Reason::Cell { cells, found }, "cell index 7 of 2 cells"),
        (stale(255, 128), "stale, number 128 after 255"),
        (Reason::UnknownState(5), "unknown state 5"),
        (Reason::UnknownOrder(255), "unknown order 255"),
        (crc(0x01AB, 0xF00D), checksum),
    ];
    for (reason, text) in texts {
        let error = error(Field::Battery, 12, reason);
        assert_eq!(format!("{error}"), format!("battery at byte 12: {text}"));
    }
}

// Requirement: WIRE-rejected-1
#[test]
fn every_cause_has_its_own_counter_and_name() {
    let mut names: Vec<_> = Cause::ALL.map(Cause::name).to_vec();
    for (place, cause) in Cause::ALL.into_iter().enumerate() {
        assert_eq!(cause as usize, place);
        let mut counters = LinkCounters::default();
        counters.reject(cause);
        assert_eq!(counters.rejected(cause), 1);
        assert_eq!(counters.rejected_total(), 1);
    }
    names.sort_unstable();
    names.dedup();
    assert_eq!(names.len(), Cause::ALL.len());
}

// Requirement: WIRE-sequence-2, WIRE-sequence-4
#[test]
fn thousand_exchanges_wrap_counters_without_loss() {
    for &mode in Mode::ALL {
        let (mut pi, mut stm) = ends(mode);
        for n in 0..1000_u32 {
            let (mut there, mut back) = ([0; MAX_FRAME], [0; MAX_FRAME]);
            let len = pi.send(&Command::default(), &mut there);
            assert_eq!(stm.encode_reply(n + 1, &Report::default(), &mut back), len);
            let command = stm.receive(&there[..len], 0, n + 2).unwrap();
            let report = pi.receive(&back[..len]).unwrap();
            if mode.has(Field::Sequence) {
                assert_eq!(u32::from(command.sequence.own), (n + 1) % 256);
                // This reply was encoded before the command arrived.
                assert_eq!(u32::from(report.sequence.seen), n % 256);
                assert_eq!(pi.counters().unacknowledged, 1);
                assert_eq!(stm.counters().unacknowledged, 2);
            }
        }
        for counters in [stm.counters(), pi.counters()] {
            assert_eq!((counters.accepted, counters.missed), (1000, 0));
            assert_eq!(counters.frames(), 1000);
        }
    }
}

/// Whether the STM, having accepted number `last`, accepts frames of these numbers.
fn accepted(mode: Mode, last: u8, numbers: &[u8]) -> (Vec<bool>, LinkCounters) {
    let (_, mut stm) = ends(mode);
    let mut receive = |own| stm.receive(&numbered_frame(mode, own), 0, 1).is_ok();
    assert!(receive(last));
    let accepted = numbers.iter().map(|&own| receive(own)).collect();
    (accepted, *stm.counters())
}

#[test]
fn lost_frames_count_as_missed() {
    for mode in guarded() {
        for lost in 0..=126_u8 {
            let (accepted, counters) = accepted(mode, 200, &[201_u8.wrapping_add(lost)]);
            assert_eq!(accepted, [true]);
            assert_eq!(counters.missed, u32::from(lost));
        }
    }
}

// Requirement: WIRE-sequence-3, WIRE-sequence-7
#[test]
fn four_ascending_stale_frames_restart_sequence() {
    for mode in guarded() {
        let restarts = |numbers: &[u8]| accepted(mode, 100, numbers).0;
        let (taken, counters) = accepted(mode, 100, &[254, 255, 0, 1, 2, 1]);
        assert_eq!(taken, [false, false, false, true, true, false]);
        assert_eq!((counters.accepted, counters.missed), (3, 0));
        assert_eq!(counters.rejected_total(), 4);
        // A gap, a number twice, a fresh frame and the last number each break the run.
        for run in [
            [1, 2, 3, 5, 6, 7],
            [1, 2, 3, 3, 4, 5],
            [98, 99, 100, 97, 98, 99],
            [97, 98, 99, 100, 99, 100],
            [99, 100, 99, 100, 99, 100],
        ] {
            assert_eq!(restarts(&run), [false; 6], "{run:?}");
        }
        let taken = restarts(&[1, 2, 3, 101, 4, 5, 6, 7]);
        let expected = [false, false, false, true, false, false, false, true];
        assert_eq!(taken, expected);
    }
}

// Requirement: WIRE-sequence-3
#[test]
fn frame_wrong_in_anything_else_leaves_the_row_of_stale_ones() {
    for mode in guarded() {
        let (_, mut stm) = ends(mode);
        let mut accepted = |own: u8, crc: u8| {
            let mut frame = numbered_frame(mode, own);
            *frame.last_mut().unwrap() ^= crc;
            stm.receive(&frame, 0, 1).is_ok()
        };
        assert!(accepted(100, 0));
        for own in 1..=4 {
            assert!(!accepted(50, 1) && !accepted(101, 1));
            assert_eq!(accepted(own, 0), own == 4);
        }
    }
}

/// 7 is acknowledged where the STM is at reply 9, and where the Pi has sent its fifth.
// Requirement: WIRE-sequence-7
#[test]
fn restart_counts_what_the_other_end_has_not_acknowledged() {
    for mode in guarded() {
        let (mut pi, mut stm) = ends(mode);
        for own in [100, 1, 2, 3, 4] {
            let mut frame = [0; MAX_FRAME];
            let last = Some(7);
            let context = Context {
                own,
                last,
                ..CONTEXT
            };
            let len = write_command(mode, &context, &Command::default(), &mut frame);
            let _ = stm.receive(&frame[..len], 0, 9);
            let _ = pi.send(&Command::default(), &mut [0; MAX_FRAME]);
            let len = write_report(mode, &context, &Report::default(), &mut frame);
            let _ = pi.receive(&frame[..len]);
        }
        let counted = |counters: &LinkCounters| (counters.accepted, counters.unacknowledged);
        assert_eq!(counted(stm.counters()), (2, 2));
        assert_eq!(counted(pi.counters()), (2, 254));
    }
}

// Requirement: WIRE-velocity-2
#[test]
fn velocity_reserved_bytes_reject_the_frame() {
    let mode = Mode::GuardedVelocity;
    for reserved in [1, 0x8000, u16::MAX] {
        let mut frame = command_frame(mode, &Command::default());
        frame[14..16].copy_from_slice(&u16::to_be_bytes(reserved));
        let error = parse_command(mode, &CONTEXT, &frame, 0).unwrap_err();
        assert_eq!(error.reason, Reason::Reserved(reserved));
        let text = format!("velocity at byte 14: reserved bytes 0x{reserved:04X}");
        assert_eq!(format!("{error}"), text);
        assert_eq!(error.reason.cause(), Cause::Velocity);
    }
}

// Requirement: WIRE-sequence-5
#[test]
fn reply_encoded_again_keeps_its_number() {
    for mode in guarded() {
        let (mut pi, stm) = ends(mode);
        let encoded = |number, faults| {
            let (faults, rest) = (Faults::from_bits(faults), Report::default());
            let report = Report { faults, ..rest };
            let mut out = [0; MAX_FRAME];
            let len = stm.encode_reply(number, &report, &mut out);
            out[..len].to_vec()
        };
        let (first, fresher, next) = (encoded(1, 0), encoded(1, 5), encoded(2, 5));
        assert_eq!((first[1], fresher[1], next[1]), (1, 1, 2));
        assert_eq!(pi.receive(&fresher).unwrap().faults.bits(), 5);
        assert!(pi.receive(&first).is_err());
        assert!(pi.receive(&next).is_ok());
    }
}

//! What a frame that is not right gets.

use super::{setup, Mode, CONTEXT, GUARDED};
use crate::binary64::Binary64;
use crate::types::Faults;
use crate::wire::crc::crc16;
use crate::wire::strategy::{Context, Input};
use crate::wire::{
    chain, frame_len, parse_command, parse_report, parse_whole, write_command, write_report,
    CellCode, Command, FrameError, Order, PiLink, Reason, Report, State, StmLink, MAX_FRAME,
};
use proptest::prelude::*;
use std::vec::Vec;

fn command_frame(mode: Mode, command: &Command) -> Vec<u8> {
    let mut frame = [0; MAX_FRAME];
    let len = write_command(mode, &CONTEXT, command, &mut frame);
    frame[..len].to_vec()
}

fn report_frame(mode: Mode, report: &Report) -> Vec<u8> {
    let mut frame = [0; MAX_FRAME];
    let len = write_report(mode, &CONTEXT, report, &mut frame);
    frame[..len].to_vec()
}

/// With a checksum that is right again.
fn sealed(mut frame: Vec<u8>) -> Vec<u8> {
    let end = frame.len() - 2;
    let crc = crc16(&frame[..end]).to_be_bytes();
    frame[end..].copy_from_slice(&crc);
    frame
}

/// The strategy whose bytes a frame of `len` cuts through or ends before, and where it starts.
fn short_strategy(mode: Mode, len: usize) -> (&'static str, usize) {
    let mut at = 0;
    for strategy in chain(mode) {
        if at + strategy.bytes > len {
            return (strategy.name, at);
        }
        at += strategy.bytes;
    }
    panic!("not short");
}

// Requirement: DOC-5.1-1, WIRE-rejected-3
#[test]
fn a_short_frame_names_the_strategy_that_lacks_bytes() {
    for &mode in Mode::ALL {
        let frames = [
            command_frame(mode, &Command::default()),
            report_frame(mode, &Report::default()),
        ];
        for len in 0..frame_len(mode) {
            let (name, offset) = short_strategy(mode, len);
            let errors = [
                parse_command(mode, &CONTEXT, &frames[0][..len], 0).unwrap_err(),
                parse_report(mode, &CONTEXT, &frames[1][..len], 0).unwrap_err(),
            ];
            for error in errors {
                assert_eq!(
                    (error.strategy, error.offset),
                    (name, offset),
                    "{mode:?} {len}"
                );
                assert!(matches!(error.reason, Reason::Short { left, .. } if left == len - offset));
            }
        }
    }
}

// Requirement: DOC-5.1.5-1
#[test]
fn a_long_frame_names_all_data_used_and_how_much_is_left() {
    for &mode in Mode::ALL {
        let len = frame_len(mode);
        let command = command_frame(mode, &Command::default());
        let report = report_frame(mode, &Report::default());
        let expected = |left| FrameError {
            strategy: "all data used",
            offset: len,
            reason: Reason::Long { left },
        };
        for left in 1..=64 {
            let tail = std::vec![0xA5; left];
            let long = [command.clone(), tail.clone()].concat();
            assert_eq!(parse_command(mode, &CONTEXT, &long, 0), Err(expected(left)));
            let long = [report.clone(), tail].concat();
            assert_eq!(parse_report(mode, &CONTEXT, &long, 0), Err(expected(left)));
            // The same where the buffer ended with the frame.
            let clocked = len + left;
            let mut stm = StmLink::new(setup(mode));
            assert_eq!(stm.receive_clocked(&command, clocked), Err(expected(left)));
        }
    }
}

#[test]
fn a_buffer_longer_than_the_frame_is_cut_to_what_was_clocked() {
    for &mode in Mode::ALL {
        let mut buffer = command_frame(mode, &Command::default());
        let clocked = buffer.len();
        buffer.extend([0xEE; 9]);
        assert!(StmLink::new(setup(mode))
            .receive_clocked(&buffer, clocked)
            .is_ok());
        let short = StmLink::new(setup(mode)).receive_clocked(&buffer, clocked - 1);
        assert!(matches!(short.unwrap_err().reason, Reason::Short { .. }));
    }
}

#[test]
fn bytes_clocked_beyond_the_buffer_are_left() {
    let mut input = Input::new(&[1, 2], 3);
    assert_eq!(input.left(), 5);
    assert_eq!(input.take(), Ok([1_u8]));
    assert_eq!(
        (input.left(), input.offset(), input.taken()),
        (4, 1, &[1_u8][..])
    );
    // A part of it is as long as asked for, and keeps count from the frame's beginning.
    let mut input = Input::new(&[1, 2, 3, 4], 5);
    let mut part = input.part::<3>().unwrap();
    assert_eq!((part.left(), input.offset()), (3, 3));
    assert_eq!(part.take(), Ok([1_u8, 2, 3]));
    assert_eq!(part.take::<1>().unwrap_err().offset, 3);
    assert_eq!(input.part::<2>().unwrap_err().offset, 3);
}

#[test]
fn codes_too_large_for_their_bits_do_not_spill_into_others() {
    let mut command = Command {
        tune: CellCode {
            cell: 0xFA,
            voltage: 0xFFFF,
        },
        ..Command::default()
    };
    command.expected.rotation = 0xFFFF;
    let frame = command_frame(Mode::Normal, &command);
    assert_eq!(frame[9..13], [0x7F, 0xFF, 0x5F, 0xFF]);
    let cell = CellCode::from_volts(0xFA, crate::types::Volts::default());
    assert_eq!(cell.cell, 2);
}

// Requirement: DOC-5.1.6-1, DOC-5.1-3, DOC-5.1.6-3
#[test]
fn every_wrong_key_is_rejected_before_anything_else() {
    for &mode in Mode::ALL {
        for found in 0..=255 {
            let mut frame = command_frame(mode, &Command::default());
            frame[0] = found;
            let parsed = parse_command(mode, &CONTEXT, &frame[..1], 0).unwrap_err();
            assert_eq!(parsed.offset, usize::from(found == 0x96));
            if found != 0x96 {
                let reason = Reason::Key {
                    expected: 0x96,
                    found,
                };
                assert_eq!(
                    (parsed.strategy, parsed.reason),
                    ("transmission key", reason)
                );
            }
            let mut frame = report_frame(mode, &Report::default());
            frame[0] = found;
            let parsed = parse_report(mode, &CONTEXT, &frame, 0);
            if found != 0x5A {
                let reason = Reason::Key {
                    expected: 0x5A,
                    found,
                };
                assert_eq!(parsed.unwrap_err().reason, reason);
            }
        }
    }
}

// Requirement: DOC-5.1.3-5, WIRE-battery-3
#[test]
fn a_cell_that_is_not_configured_is_rejected_at_both_ends() {
    for &mode in Mode::ALL {
        for cells in 1..=8 {
            let mut context = CONTEXT;
            context.cells = cells;
            for cell in 0..8 {
                let cell_code = CellCode { cell, voltage: 840 };
                let command = Command {
                    tune: cell_code,
                    ..Command::default()
                };
                let report = Report {
                    cell: cell_code,
                    ..Report::default()
                };
                let sent = parse_command(mode, &context, &command_frame(mode, &command), 0);
                let back = parse_report(mode, &context, &report_frame(mode, &report), 0);
                assert_eq!(sent.is_ok(), cell < cells);
                assert_eq!(back.is_ok(), cell < cells);
                for error in [sent.err(), back.err()].into_iter().flatten() {
                    let reason = Reason::Cell { cells, found: cell };
                    assert_eq!((error.strategy, error.reason), ("battery", reason));
                    assert_eq!(error.offset, short_strategy_offset(mode, "battery"));
                }
            }
        }
    }
}

fn short_strategy_offset(mode: Mode, name: &str) -> usize {
    chain(mode)
        .iter()
        .take_while(|strategy| strategy.name != name)
        .map(|strategy| strategy.bytes)
        .sum()
}

// Requirement: WIRE-double-1
#[test]
fn a_percentage_must_be_finite_and_within_a_hundred() {
    let accepted = [0.0, -0.0, 1e-310, 100.0, -100.0, 37.5];
    let out = [100.000_000_000_000_02, -100.000_000_000_000_02, 1e300, -1e9];
    let not = [f64::NAN, -f64::NAN, f64::INFINITY, f64::NEG_INFINITY];
    for mode in Mode::ALL.iter().copied() {
        if short_strategy_offset(mode, "double") == frame_len(mode) {
            continue;
        }
        let parse = |value: f64| {
            let command = Command {
                percent: Binary64(value.to_bits()),
                ..Command::default()
            };
            parse_command(mode, &CONTEXT, &command_frame(mode, &command), 0)
                .map(|command| command.percent)
                .map_err(|error| error.reason)
        };
        for value in accepted {
            assert_eq!(parse(value), Ok(Binary64(value.to_bits())));
        }
        for value in out {
            assert_eq!(parse(value), Err(Reason::PercentOutOfRange));
        }
        for value in not {
            assert_eq!(parse(value), Err(Reason::NotFinite));
        }
        // A measurement only has to be finite.
        for value in [accepted[4], out[2], not[0], not[2]] {
            let report = Report {
                measurement: Binary64(value.to_bits()),
                ..Report::default()
            };
            let parsed = parse_report(mode, &CONTEXT, &report_frame(mode, &report), 0);
            assert_eq!(parsed.is_ok(), value.is_finite());
        }
    }
}

// Requirement: WIRE-status-2
#[test]
fn orders_and_states_that_do_not_exist_are_rejected_at_their_byte() {
    for mode in GUARDED {
        for code in 0..=255 {
            let mut frame = command_frame(mode, &Command::default());
            frame[5] = code;
            match parse_command(mode, &CONTEXT, &sealed(frame), 0) {
                Ok(command) => assert_eq!(command.order as u8, code),
                Err(error) => {
                    assert!(code > 2);
                    let expected = ("status", 5, Reason::UnknownOrder(code));
                    assert_eq!((error.strategy, error.offset, error.reason), expected);
                }
            }
            let mut frame = report_frame(mode, &Report::default());
            frame[5] = code;
            match parse_report(mode, &CONTEXT, &sealed(frame), 0) {
                Ok(report) => assert_eq!(report.state as u8, code),
                Err(error) => {
                    assert!(code > 4);
                    let expected = ("status", 5, Reason::UnknownState(code));
                    assert_eq!((error.strategy, error.offset, error.reason), expected);
                }
            }
        }
        assert_eq!(Order::from_code(3), None);
        assert_eq!(State::from_code(5), None);
    }
}

/// A guarded frame in which every field is neither all zeros nor all ones.
fn busy_frames(mode: Mode) -> (Vec<u8>, Vec<u8>) {
    let command = Command {
        clear_faults: Faults::from_bits(0x1234),
        order: Order::Stop,
        apply: true,
        percent: Binary64(12.5_f64.to_bits()),
        tune: CellCode {
            cell: 1,
            voltage: 801,
        },
        ..Command::default()
    };
    let report = Report {
        faults: Faults::from_bits(0x4321),
        state: State::Stopped,
        bearing: 0x8421,
        measurement: Binary64(12.5_f64.to_bits()),
        ..Report::default()
    };
    (command_frame(mode, &command), report_frame(mode, &report))
}

fn both_reject(mode: Mode, command: &[u8], report: &[u8]) -> bool {
    parse_command(mode, &CONTEXT, command, 0).is_err()
        && parse_report(mode, &CONTEXT, report, 0).is_err()
}

// Requirement: WIRE-crc-2
#[test]
fn every_one_two_or_three_bit_error_in_a_guarded_frame_is_rejected() {
    for mode in GUARDED {
        let (command, report) = busy_frames(mode);
        let bits = command.len() * 8;
        let mut mutants = [command, report];
        let flip = |mutants: &mut [Vec<u8>; 2], bit: usize| {
            for frame in mutants {
                frame[bit / 8] ^= 0x80 >> (bit % 8);
            }
        };
        for a in 0..bits {
            flip(&mut mutants, a);
            assert!(both_reject(mode, &mutants[0], &mutants[1]), "{mode:?} {a}");
            for b in 0..a {
                flip(&mut mutants, b);
                assert!(
                    both_reject(mode, &mutants[0], &mutants[1]),
                    "{mode:?} {a} {b}"
                );
                for c in 0..b {
                    flip(&mut mutants, c);
                    assert!(both_reject(mode, &mutants[0], &mutants[1]));
                    flip(&mut mutants, c);
                }
                flip(&mut mutants, b);
            }
            flip(&mut mutants, a);
        }
        assert!(!both_reject(mode, &mutants[0], &mutants[1]));
    }
}

#[test]
fn every_burst_of_up_to_sixteen_bits_in_a_guarded_frame_is_rejected() {
    for mode in GUARDED {
        let (command, report) = busy_frames(mode);
        let bits = command.len() * 8;
        for start in 0..bits {
            let patterns: Vec<u32> = if start % 16 == 3 {
                (1..0x1_0000).step_by(2).collect()
            } else {
                (0..16).map(|width| (1 << width) | 1).collect()
            };
            for pattern in patterns {
                let mut mutants = [command.clone(), report.clone()];
                for bit in (0..16).filter(|bit| pattern >> bit & 1 == 1) {
                    let at = start + bit;
                    for frame in &mut mutants {
                        if let Some(byte) = frame.get_mut(at / 8) {
                            *byte ^= 0x80 >> (at % 8);
                        }
                    }
                }
                assert!(both_reject(mode, &mutants[0], &mutants[1]));
            }
        }
    }
}

/// The chain as the document describes it: one strategy after the other, along the table.
fn along_the_table(
    mode: Mode,
    frame: &[u8],
) -> (Result<Command, FrameError>, Result<Report, FrameError>) {
    let mut input = Input::new(frame, 0);
    let mut command = Command::default();
    let mut first = Ok(());
    for strategy in chain(mode) {
        first = first.and_then(|()| {
            (strategy.parse_command)(&mut input, &CONTEXT, &mut command).map_err(|fault| {
                FrameError {
                    strategy: strategy.name,
                    offset: fault.offset,
                    reason: fault.reason,
                }
            })
        });
    }
    let commanded = first.map(|()| command);
    let mut input = Input::new(frame, 0);
    let mut report = Report::default();
    let mut first = Ok(());
    for strategy in chain(mode) {
        first = first.and_then(|()| {
            (strategy.parse_report)(&mut input, &CONTEXT, &mut report).map_err(|fault| FrameError {
                strategy: strategy.name,
                offset: fault.offset,
                reason: fault.reason,
            })
        });
    }
    (commanded, first.map(|()| report))
}

fn mode() -> impl Strategy<Value = Mode> {
    prop::sample::select(Mode::ALL)
}

/// Bytes of any kind, often with the right key and the right length, sometimes with the right
/// checksum.
fn frame() -> impl Strategy<Value = (Mode, Vec<u8>)> {
    let key = prop::sample::select(&[0x96_u8, 0x5A][..]);
    let noise = (mode(), prop::collection::vec(any::<u8>(), 0..=64));
    let right_length = (mode(), key, any::<[u8; 64]>()).prop_map(|(mode, key, bytes)| {
        let mut frame = bytes[..frame_len(mode)].to_vec();
        frame[0] = key;
        (mode, frame)
    });
    let right_sum = (mode(), any::<bool>(), any::<[u8; 64]>()).prop_map(|(mode, to_stm, bytes)| {
        let mut frame = bytes[..frame_len(mode)].to_vec();
        frame[0] = if to_stm { 0x96 } else { 0x5A };
        frame[5] %= 3;
        (mode, sealed(frame))
    });
    prop_oneof![noise, right_length, right_sum]
}

proptest! {
    #![proptest_config(ProptestConfig::with_cases(20_000))]

    // Requirement: DOC-5.1-2
    #[test]
    fn the_straight_code_of_a_mode_is_its_table((mode, frame) in frame()) {
        let (command, report) = along_the_table(mode, &frame);
        prop_assert_eq!(parse_command(mode, &CONTEXT, &frame, 0), command);
        prop_assert_eq!(parse_report(mode, &CONTEXT, &frame, 0), report);
    }

    #[test]
    fn what_is_accepted_is_what_would_have_been_sent((mode, frame) in frame()) {
        // But for the bytes and bits that carry nothing: once more through the other end.
        let mut again = [0; MAX_FRAME];
        if let Ok(command) = parse_command(mode, &CONTEXT, &frame, 0) {
            prop_assert_eq!(frame.len(), frame_len(mode));
            prop_assert_eq!(frame[0], 0x96);
            let mut context = CONTEXT;
            (context.own, context.last) = (command.sequence.own, Some(command.sequence.seen));
            let len = write_command(mode, &context, &command, &mut again);
            let back = parse_command(mode, &CONTEXT, &again[..len], 0);
            prop_assert_eq!(back, Ok(command));
        }
        if let Ok(report) = parse_report(mode, &CONTEXT, &frame, 0) {
            prop_assert_eq!(frame[0], 0x5A);
            let mut context = CONTEXT;
            (context.own, context.last) = (report.sequence.own, Some(report.sequence.seen));
            let len = write_report(mode, &context, &report, &mut again);
            prop_assert_eq!(parse_report(mode, &CONTEXT, &again[..len], 0), Ok(report));
        }
    }

    // Requirement: WIRE-chain-1
    #[test]
    fn a_rejected_frame_changes_one_counter_and_nothing_else((mode, frame) in frame()) {
        let mut stm = StmLink::new(setup(mode));
        let mut pi = PiLink::new(setup(mode));
        let (mut to_stm, mut to_pi) = ([0; MAX_FRAME], [0; MAX_FRAME]);
        let len = pi.send(&Command::default(), &mut to_stm);
        stm.send(&Report::default(), &mut to_pi);
        stm.receive(&to_stm[..len]).unwrap();
        pi.receive(&to_pi[..len]).unwrap();

        let mut next = [[0; MAX_FRAME]; 4];
        stm.clone().send(&Report::default(), &mut next[0]);
        pi.clone().send(&Command::default(), &mut next[1]);
        if let Err(error) = stm.receive(&frame) {
            prop_assert_eq!(stm.counters().rejected(error.reason.cause()), 1);
            prop_assert_eq!(stm.counters().rejected_total(), 1);
            prop_assert_eq!(stm.counters().accepted, 1);
            stm.send(&Report::default(), &mut next[2]);
            prop_assert_eq!(next[0], next[2]);
        }
        if let Err(error) = pi.receive(&frame) {
            prop_assert_eq!(pi.counters().rejected(error.reason.cause()), 1);
            prop_assert_eq!(pi.counters().frames(), 2);
            pi.send(&Command::default(), &mut next[3]);
            prop_assert_eq!(next[1], next[3]);
        }
    }
}

// Requirement: WIRE-chain-2
#[test]
fn an_error_reads_as_one_sentence() {
    let mut stm = StmLink::new(setup(Mode::Normal));
    let text =
        |frame: &[u8], stm: &mut StmLink| std::format!("{}", stm.receive(frame).unwrap_err());
    assert_eq!(
        text(&[0x97], &mut stm),
        "transmission key at byte 0: key 0x97, expected 0x96"
    );
    assert_eq!(
        text(&[0x96, 1, 2], &mut stm),
        "position at byte 1: frame too short, needs 10 bytes, has 2"
    );
    let mut guarded = StmLink::new(setup(Mode::GuardedNormal));
    let mut frame = command_frame(Mode::GuardedNormal, &Command::default());
    frame[25] ^= 1;
    let error = text(&frame, &mut guarded);
    assert!(error.starts_with("crc at byte 24: checksum 0x"), "{error}");
    frame[25] ^= 1;
    guarded.receive(&frame).unwrap();
    assert_eq!(
        text(&frame, &mut guarded),
        "sequence at byte 1: stale, number 1 after 1"
    );
}

#[test]
fn every_reason_says_what_was_found_and_what_is_right() {
    for (reason, text) in [
        (
            Reason::Short { needed: 2, left: 1 },
            "frame too short, needs 2 bytes, has 1",
        ),
        (Reason::Long { left: 3 }, "frame too long by 3"),
        (
            Reason::Key {
                expected: 0x0A,
                found: 0xB0,
            },
            "key 0xB0, expected 0x0A",
        ),
        (Reason::NotFinite, "not a finite number"),
        (Reason::PercentOutOfRange, "percentage beyond -100 to 100"),
        (
            Reason::Cell { cells: 2, found: 7 },
            "cell index 7 of 2 cells",
        ),
        (
            Reason::Stale {
                last: 255,
                found: 128,
            },
            "stale, number 128 after 255",
        ),
        (Reason::UnknownState(5), "unknown state 5"),
        (Reason::UnknownOrder(255), "unknown order 255"),
        (
            Reason::Crc {
                expected: 0x01AB,
                found: 0xF00D,
            },
            "checksum 0xF00D, expected 0x01AB",
        ),
    ] {
        let error = FrameError {
            strategy: "battery",
            offset: 12,
            reason,
        };
        assert_eq!(
            std::format!("{error}"),
            std::format!("battery at byte 12: {text}")
        );
    }
}

proptest! {
    #![proptest_config(ProptestConfig::with_cases(20_000))]

    #[test]
    fn straight_or_in_a_loop_the_same_frames_are_taken_and_say_the_same(
        mut bytes in any::<[u8; MAX_FRAME]>(),
        right in any::<[bool; 5]>(),
        last in any::<Option<u8>>(),
    ) {
        let context = Context { last, ..CONTEXT };
        let [key, cell, fresh, order, seal] = right;
        if key {
            bytes[0] = context.key_from_pi;
        }
        for &mode in Mode::ALL {
            let mut bytes = bytes;
            let guarded = mode.tells_fresh();
            if fresh && guarded {
                bytes[1] = last.unwrap_or_default().wrapping_add(1);
            }
            if order && guarded {
                bytes[5] %= 3;
            }
            let mut at = 0;
            for strategy in chain(mode) {
                match strategy.name {
                    // A cell that is there, and a percentage that is one.
                    "battery" if cell => bytes[at] &= 0x1F,
                    "double" if cell => bytes[at + 7] &= 0xBF,
                    _ => {}
                }
                at += strategy.bytes;
            }
            let mut whole = bytes[..frame_len(mode)].to_vec();
            if seal && guarded {
                whole = sealed(whole);
            }
            let taken = parse_command(mode, &context, &whole, 0).ok();
            prop_assert_eq!(parse_whole(mode, &context, &whole), taken);
            if right == [true; 5] {
                prop_assert!(taken.is_some(), "{}", mode.name());
            }
            for len in (0..=MAX_FRAME).filter(|len| *len != whole.len()) {
                prop_assert_eq!(parse_whole(mode, &context, &bytes[..len]), None);
            }
        }
    }
}

//! Frames derived by hand from the document's tables (and their checksums by another program), so
//! that an error made both in writing and in parsing still shows.

use super::{setup, Mode};
use crate::binary64::Binary64;
use crate::types::Faults;
use crate::wire::{
    CellCode, Command, DistanceCode, Order, PiLink, PoseCode, Report, Sequence, State, StmLink,
    MAX_FRAME,
};
use std::vec::Vec;

fn bytes(hex: &str) -> Vec<u8> {
    hex.split_whitespace()
        .map(|byte| u8::from_str_radix(byte, 16).unwrap())
        .collect()
}

/// x = −123.456 mm, y = 7654.321 mm, rotation 0x1234, apply, cell 2 tuned at 4.2 V = 840.
fn command() -> Command {
    Command {
        expected: PoseCode {
            x: -123_456,
            y: 7_654_321,
            rotation: 0x1234,
        },
        apply: true,
        tune: CellCode {
            cell: 1,
            voltage: 840,
        },
        ..Command::default()
    }
}

/// The same pose, the same cell; 1000 mm ahead (26214 = 0x6666), nothing right, an obstacle left.
fn report() -> Report {
    Report {
        pose: command().expected,
        cell: command().tune,
        ranges: [DistanceCode(0x6666), DistanceCode::NONE, DistanceCode(0)],
        ..Report::default()
    }
}

const FIRST: Sequence = Sequence { own: 1, seen: 0 };

fn crosses_to_the_stm(mode: Mode, command: Command, heard: Command, hex: &str) {
    let mut frame = [0; MAX_FRAME];
    let len = PiLink::new(setup(mode)).send(&command, &mut frame);
    assert_eq!(frame[..len], bytes(hex), "{mode:?}");
    let received = StmLink::new(setup(mode)).receive(&bytes(hex));
    assert_eq!(received, Ok(heard), "{mode:?}");
}

fn crosses_to_the_pi(mode: Mode, report: Report, heard: Report, hex: &str) {
    let mut frame = [0; MAX_FRAME];
    let len = StmLink::new(setup(mode)).send(&report, &mut frame);
    assert_eq!(frame[..len], bytes(hex), "{mode:?}");
    let received = PiLink::new(setup(mode)).receive(&bytes(hex));
    assert_eq!(received, Ok(heard), "{mode:?}");
}

// Requirement: DOC-5.1.1-1, WIRE-modes-1
#[test]
fn a_normal_command_is_the_documents_bytes() {
    crosses_to_the_stm(
        Mode::Normal,
        command(),
        command(),
        "96 FF FE 1D C0 00 74 CB B1 92 34 23 48 00 00 00 00 00 00",
    );
}

// Requirement: DOC-5.1.1-4
#[test]
fn a_pose_is_applied_if_the_highest_bit_of_byte_9_is_set_and_only_then() {
    let mut frame = bytes("96 FF FE 1D C0 00 74 CB B1 00 00 23 48 00 00 00 00 00 00");
    for word in 0..=u16::MAX {
        frame[9..11].copy_from_slice(&word.to_be_bytes());
        let heard = StmLink::new(setup(Mode::Normal)).receive(&frame).unwrap();
        assert_eq!(heard.apply, word >> 15 == 1, "{word:#x}");
        assert_eq!(heard.expected.rotation, word & 0x7FFF);
    }
    for mode in [Mode::GuardedNormal, Mode::GuardedSweep] {
        for apply in [false, true] {
            let said = Command { apply, ..command() };
            let mut frame = [0; MAX_FRAME];
            let len = PiLink::new(setup(mode)).send(&said, &mut frame);
            let heard = StmLink::new(setup(mode)).receive(&frame[..len]).unwrap();
            assert_eq!(heard.apply, apply, "{mode:?}");
        }
    }
}

// Requirement: DOC-5.1.1-1, WIRE-modes-1
#[test]
fn a_normal_report_is_the_documents_bytes() {
    crosses_to_the_pi(
        Mode::Normal,
        report(),
        report(),
        "5A FF FE 1D C0 00 74 CB B1 12 34 23 48 66 66 FF FF 00 00",
    );
}

// Requirement: DOC-5.1.2-1, WIRE-double-2
#[test]
fn a_tuning_command_is_the_documents_bytes() {
    // −37.5: sign, 1.171875 · 2⁵, so 0xC042C00000000000, last byte first.
    let command = Command {
        percent: Binary64((-37.5_f64).to_bits()),
        ..Command::default()
    };
    for mode in [Mode::TuneRotate, Mode::TuneMove] {
        crosses_to_the_stm(mode, command, command, "96 00 00 00 00 00 C0 42 C0 00 00");
    }
}

// Requirement: DOC-5.1.2-1, WIRE-double-2
#[test]
fn a_tuning_report_is_the_documents_bytes() {
    // 123.25 = 1.92578125 · 2⁶: 0x405ED00000000000.
    let report = Report {
        measurement: Binary64(123.25_f64.to_bits()),
        cell: report().cell,
        ..Report::default()
    };
    for mode in [Mode::TuneRotate, Mode::TuneMove] {
        crosses_to_the_pi(mode, report, report, "5A 00 00 00 00 00 D0 5E 40 23 48");
    }
}

// Requirement: WIRE-status-4
#[test]
fn guarded_commands_add_sequence_status_and_checksum() {
    let normal = Command {
        clear_faults: Faults::from_bits(0x8001),
        order: Order::Resume,
        ..command()
    };
    let heard = Command {
        sequence: FIRST,
        ..normal
    };
    crosses_to_the_stm(
        Mode::GuardedNormal,
        normal,
        heard,
        "96 01 00 80 01 02 FF FE 1D C0 00 74 CB B1 92 34 23 48 00 00 00 00 00 00 5C 23",
    );
    let tune = Command {
        percent: Binary64((-37.5_f64).to_bits()),
        ..Command::default()
    };
    let heard = Command {
        sequence: FIRST,
        ..tune
    };
    for mode in [Mode::GuardedTuneRotate, Mode::GuardedTuneMove] {
        let frame = "96 01 00 00 00 00 00 00 00 00 00 C0 42 C0 00 00 B9 8D";
        crosses_to_the_stm(mode, tune, heard, frame);
    }
    let heard = Command {
        sequence: FIRST,
        ..command()
    };
    crosses_to_the_stm(
        Mode::GuardedSweep,
        command(),
        heard,
        "96 01 00 00 00 00 FF FE 1D C0 00 74 CB B1 92 34 23 48 00 00 00 00 A9 27",
    );
}

// Requirement: WIRE-status-4, WIRE-bearing-1
#[test]
fn guarded_reports_add_sequence_status_and_checksum() {
    let normal = Report {
        faults: Faults::from_bits(0x0841),
        state: State::Moving,
        ..report()
    };
    let heard = Report {
        sequence: FIRST,
        ..normal
    };
    crosses_to_the_pi(
        Mode::GuardedNormal,
        normal,
        heard,
        "5A 01 00 08 41 02 FF FE 1D C0 00 74 CB B1 12 34 23 48 66 66 FF FF 00 00 39 02",
    );
    let tune = Report {
        measurement: Binary64(123.25_f64.to_bits()),
        cell: report().cell,
        state: State::Ready,
        ..Report::default()
    };
    let heard = Report {
        sequence: FIRST,
        ..tune
    };
    for mode in [Mode::GuardedTuneRotate, Mode::GuardedTuneMove] {
        let frame = "5A 01 00 00 00 01 00 00 00 00 00 D0 5E 40 23 48 85 26";
        crosses_to_the_pi(mode, tune, heard, frame);
    }
    // Bearing 320° = 0xE38E.
    let sweep = Report {
        ranges: [DistanceCode(0x6666), DistanceCode::NONE, DistanceCode::NONE],
        bearing: 0xE38E,
        state: State::Ready,
        ..report()
    };
    let heard = Report {
        sequence: FIRST,
        ..sweep
    };
    crosses_to_the_pi(
        Mode::GuardedSweep,
        sweep,
        heard,
        "5A 01 00 00 00 01 FF FE 1D C0 00 74 CB B1 12 34 23 48 66 66 E3 8E B0 4E",
    );
}

// Requirement: DOC-5.1.1-5, DOC-5.1.4-3
#[test]
fn bits_that_carry_nothing_are_ignored() {
    let mut stm = StmLink::new(setup(Mode::Normal));
    let dummies = bytes("96 FF FE 1D C0 00 74 CB B1 92 34 23 48 FF 01 80 7E 55 AA");
    assert_eq!(stm.receive(&dummies), Ok(command()));
    let mut pi = PiLink::new(setup(Mode::Normal));
    let not_used = bytes("5A FF FE 1D C0 00 74 CB B1 92 34 23 48 66 66 FF FF 00 00");
    assert_eq!(pi.receive(&not_used), Ok(report()));
}

// Requirement: DOC-5.2-1, DOC-5.1.5-1, DOC-5.1.6-3, DOC-5.2-4, DOC-5.2.1-3, DOC-5.2.2-3
// Requirement: DOC-5.2.3-2, WIRE-modes-5, WIRE-modes-6
#[test]
fn the_modes_have_the_documents_numbers_chains_and_lengths() {
    use crate::wire::{chain, frame_len};
    let normal = "transmission key|position|battery|distance front|distance right|distance left";
    let tune = "transmission key|double|battery";
    let table = [
        (0x00, "Normal", 19, normal.into()),
        (0x01, "TuneRotatePID", 11, tune.into()),
        (0x02, "TuneMovePID", 11, tune.into()),
        (0x10, "Guarded Normal", 26, guarded(normal)),
        (0x11, "Guarded TuneRotate", 18, guarded(tune)),
        (0x12, "Guarded TuneMove", 18, guarded(tune)),
        (
            0x20,
            "Guarded Sweep",
            24,
            guarded("transmission key|position|battery|distance front|bearing"),
        ),
    ];
    for (code, name, len, names) in table {
        let mode = Mode::from_code(code).unwrap();
        assert_eq!(
            (mode.code(), mode.name(), frame_len(mode)),
            (code, name, len)
        );
        let listed: Vec<_> = chain(mode).iter().map(|strategy| strategy.name).collect();
        assert_eq!(listed.join("|"), names + "|all data used");
        let total: usize = chain(mode).iter().map(|strategy| strategy.bytes).sum();
        assert_eq!(total, len);
        assert_eq!(mode.tells_fresh(), code >= 0x10);
    }
    assert_eq!(Mode::ALL.len(), 7);
    assert_eq!((0..=255).filter_map(Mode::from_code).count(), 7);
}

fn guarded(chain: &str) -> std::string::String {
    chain.replacen('|', "|sequence|status|", 1) + "|crc"
}

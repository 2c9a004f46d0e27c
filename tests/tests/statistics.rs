//! The link statistics of both ends against the frames actually sent: the host's code on one end, the
//! ELF on the other.

use fw_core::eeprom::Config;
use fw_core::wire::{Cause, Field, Mode, frame_len};
use host_link::log::{LogLine, LogParser};
use host_link::session::{CommandRequest, RATE_HZ, Session};
use robot_tests::reference::{normal_frame, original_image};
use robot_tests::test_board::{Rig, image_with_servo};
use twin::Options;

/// Frames in two and a half seconds: enough for a log line with the pause and one without.
const FRAMES: u32 = RATE_HZ * 5 / 2;

fn booted(mode: Mode) -> (Rig, Config) {
    let config = Config::decode(&image_with_servo(mode)).expect("accepted");
    (Rig::in_mode(mode), config)
}

// Requirement: DOC-5-3, DOC-5.2.2-5, WIRE-rejected-1, WIRE-log-3
#[test]
fn statistics_count_frames_of_both_ends() {
    for &mode in Mode::ALL {
        let (rig, config) = booted(mode);
        let mut machine = rig.io();
        let mut session = Session::with_config(&mut machine, config.clone(), RATE_HZ);
        let exchange = |session: &mut Session, frames| {
            for _ in 0..frames {
                let exchanged = session.exchange(&CommandRequest::default());
                exchanged.unwrap_or_else(|error| panic!("{}: {error}", mode.name()));
                session.poll_log();
            }
        };
        exchange(&mut session, 10);
        let mut wrong = vec![0; frame_len(mode)];
        wrong[0] = !config.link_setup().key_from_pi;
        for _ in 0..3 {
            let _ = rig.frame(&wrong);
            rig.run_us(100);
        }
        for len in [1, frame_len(mode) - 1, frame_len(mode) + 2] {
            let mut bytes = vec![0; len];
            bytes[0] = config.link_setup().key_from_pi;
            let _ = rig.frame(&bytes);
            rig.run_us(100);
        }
        // A pause that the stop deadline allows.
        rig.run_us(100_000);
        exchange(&mut session, FRAMES);
        rig.run_us(20_000);
        session.poll_log();

        let log = rig.log();
        let name = mode.name();
        let stm = session.snapshot().stm.expect(name);
        let guarded = mode.has(Field::Sequence);
        assert_eq!(stm.causes.get(Cause::Key), 3, "{name}: {log}");
        let others = [Cause::Short, Cause::Long, Cause::Stale].map(|cause| stm.causes.get(cause));
        // A number of 0 is none that comes next, and is looked at before the frame's end.
        let expected = if guarded { [1, 0, 2] } else { [2, 1, 0] };
        assert_eq!(others, expected, "{name}: {log}");
        assert_eq!((stm.rejected, stm.lost), (6, 0), "{name}: {log}");
        assert_eq!(stm.frames, stm.accepted + 6);
        let pi = session.statistics();
        assert_eq!(pi.frames, u64::from(10 + FRAMES));
        assert_eq!((pi.accepted, pi.rejected), (10 + FRAMES, 0));
        // The line is of some frames ago, and none but the wrong ones were rejected.
        assert!(stm.accepted <= pi.accepted && stm.accepted > pi.accepted - RATE_HZ);
        // The wrong frames took replies with them, which the Pi did not get.
        assert_eq!(pi.missed, guarded.then_some(6), "{name}");
        assert_eq!(stm.missed, guarded.then_some(0), "{name}: {log}");
        // 25 ms from frame to frame, and the pause.
        for gap in [stm.worst_gap_us.into(), pi.worst_gap_us] {
            assert!((100_000..130_000).contains(&gap), "{name}: {gap}");
        }
        assert!(stm.recent_gap_us.abs_diff(25_000) < 20, "{name}: {log}");
        // A frame is confirmed with the next one, or the one after where a tick was at work at its end; the
        // STM has numbered its next reply by then.
        let frames = pi.round_trip_frames;
        assert!(!guarded || matches!(frames, Some(1 | 2)), "{name}: {pi:?}");
        assert_eq!(stm.round_trip_frames, guarded.then_some(2), "{name}");
        // Where the last reply confirms nothing new, the time is that of an earlier one.
        let longest = u64::from(frames.unwrap_or(1));
        let is_due = |us| (1..=longest).any(|frames| (25_000 * frames).abs_diff(us) < 100);
        let trip = pi.round_trip_us.map(is_due);
        assert_eq!(trip, guarded.then_some(true), "{name}: {pi:?}");
    }
}

/// A core of 20 MIPS takes longer for a tick than two frames at the wire's highest rate: one of them is lost.
// Requirement: WIRE-log-3
#[test]
fn statistics_count_frames_that_come_too_fast() {
    const FRAMES: u32 = 1_000;
    let rig = Rig::with_mips(20, Options::with_eeprom(original_image()));
    for _ in 0..FRAMES {
        let _ = rig.frame(&normal_frame(0, 0, 0, false));
    }
    rig.run_us(1_100_000);
    let log = rig.log();
    let mut lines = LogParser::default().feed(log.as_bytes()).into_iter();
    let line = lines.rfind(|(_, line)| matches!(line, LogLine::Link(_)));
    let Some((_, LogLine::Link(stm))) = line else {
        panic!("{log}")
    };
    let counts = (stm.frames, stm.accepted + stm.lost);
    assert_eq!(counts, (FRAMES, FRAMES), "{log}");
    assert!(stm.lost > 0, "{log}");
    rig.assert_logged("frames lost: not read in time");
}

// Requirement: WIRE-log-3
#[test]
fn statistics_silent_link_logs_nothing() {
    let (rig, config) = booted(Mode::GuardedNormal);
    let mut machine = rig.io();
    let mut session = Session::with_config(&mut machine, config, RATE_HZ);
    session.confirm_mode().expect("a good link");
    rig.run_us(5_000_000);
    let lines = |log: &str| log.lines().filter(|line| line.contains(": L ")).count();
    assert_eq!(lines(&rig.log()), 1, "{}", rig.log());
    rig.run_us(5_000_000);
    assert_eq!(lines(&rig.log()), 1, "{}", rig.log());
    let exchanged = session.exchange(&CommandRequest::default());
    exchanged.expect("a good link");
    rig.run_us(1_100_000);
    session.poll_log();
    let stm = session.snapshot().stm.expect("a line");
    assert!(stm.worst_gap_us > 10_000_000, "{}", rig.log());
}

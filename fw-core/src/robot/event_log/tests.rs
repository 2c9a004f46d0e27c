extern crate std;

use super::*;
use crate::log::tests::transmitted;
use crate::types::RangefinderId::{Front, Left};
use crate::wire::{Field, Reason};
use fixed::types::I16F16;
use std::format;
use std::string::String;
use std::vec::Vec;

/// New lines of a log: levels and texts, without the numbers.
fn lines(log: &mut Log) -> Vec<String> {
    let text = transmitted(log);
    let line = |line: &str| format!("{}{}", &line[..1], &line[6..]);
    text.lines().map(line).collect()
}

fn lines_of(write: impl FnOnce(&mut Log)) -> Vec<String> {
    let mut log = Log::new();
    write(&mut log);
    lines(&mut log)
}

const NOTHING: [&str; 0] = [];

fn pose(x: i32, y: i32, rotation: u16) -> PoseCode {
    PoseCode { x, y, rotation }
}

fn stale(found: u8) -> FrameError {
    FrameError {
        field: Field::Sequence,
        offset: 9,
        reason: Reason::Stale { last: 7, found },
    }
}

// Requirement: DOC-2.1-3
#[test]
fn state_change_is_logged_once_with_its_level() {
    let mut event_log = EventLog::new(Milliseconds(0));
    for (state, halt, line) in [
        (State::Ready, Halt::None, "I: ready"),
        (State::Moving, Halt::None, "I: moving"),
        (State::Stopped, Halt::Ordered, "W: stopped"),
        (State::Ready, Halt::None, "I: ready"),
        (
            State::Stopped,
            Halt::Silence,
            "W: stopped: no fresh frame in time",
        ),
        (State::Faulted, Halt::Ordered, "E: faulted: motors off"),
        (State::Stopped, Halt::Ordered, "W: stopped"),
        (State::Booting, Halt::None, "I: booting"),
    ] {
        for expected in [&[line][..], &NOTHING] {
            let mut logged = false;
            let lines = lines_of(|log| logged = event_log.tick(state, halt, false, log));
            assert_eq!(lines, expected);
            assert_eq!(logged, !expected.is_empty());
        }
    }
}

#[test]
fn rejected_frames_are_logged_once_a_second() {
    let mut event_log = EventLog::new(Milliseconds(0));
    let mut log = Log::new();
    let mut all = Vec::new();
    // Two frames a tick, from tick 5 to tick 154, and one long after.
    for tick in 0..700 {
        if (5..155).contains(&tick) {
            event_log.frame_rejected(stale(1));
            event_log.frame_rejected(stale(2));
        }
        if tick == 600 {
            event_log.frame_rejected(stale(1));
        }
        let logged = event_log.tick(State::Booting, Halt::None, false, &mut log);
        let new = lines(&mut log);
        assert_eq!(logged, !new.is_empty());
        all.extend(new.into_iter().map(|line| (tick, line)));
    }
    let first = |tick| (tick, format!("W: frame rejected: {}", stale(1)));
    let more = |tick, count| (tick, format!("W: {count} more frames rejected"));
    assert_eq!(all, [first(5), more(105, 201), more(205, 98), first(600)]);
}

#[test]
fn state_is_logged_before_rejection_and_target() {
    let mut event_log = EventLog::new(Milliseconds(0));
    event_log.frame_rejected(stale(1));
    event_log.target_set(PoseCode::default());
    // The last of several: half a metre ahead, a quarter turn.
    event_log.target_set(pose(500_000, -20, 0x2000));
    for expected in [
        "I: ready",
        "W: frame rejected: sequence at byte 9: stale, number 1 after 7",
        "I: target 500.000 -0.020 mm, 90.00 deg",
    ] {
        let lines = lines_of(|log| _ = event_log.tick(State::Ready, Halt::None, false, log));
        assert_eq!(lines, [expected]);
    }
}

#[test]
fn pose_line_is_due_once_a_period() {
    for milliseconds in [1, 10, 11, 20, 100, 60_000] {
        let ticks = u32::from(milliseconds).div_ceil(10);
        let mut event_log = EventLog::new(Milliseconds(milliseconds));
        for tick in 1..=3 * ticks {
            assert_eq!(event_log.pose_due(), tick % ticks == 0, "{milliseconds}");
        }
    }
    let mut off = EventLog::new(Milliseconds(0));
    assert!((0..70_000).all(|_| !off.pose_due()));
}

#[test]
fn tuning_sample_and_pose_have_fixed_format() {
    let lines = lines_of(|log| log_tuning(Duty::saturating(-1234), -5, log));
    assert_eq!(lines, ["I: T -12.34 -0.005"]);
    // 359.989°, cut off after the second decimal.
    let lines = lines_of(|log| log_pose(&pose(-1, 1_234_567, 0x7FFF), log));
    assert_eq!(lines, ["I: pose -0.001 1234.567 mm, 359.98 deg"]);
}

#[test]
fn new_faults_are_logged_by_the_table() {
    let line = |fault: &crate::types::Fault| {
        let level = if fault.blocking { 'E' } else { 'W' };
        Some(format!("{level}: {}", fault.log_line?))
    };
    for fault in Faults::TABLE {
        let lines = lines_of(|log| log_faults(fault.faults, log));
        assert_eq!(lines, Vec::from_iter(line(fault)));
    }
    let all: Vec<_> = Faults::TABLE.iter().filter_map(line).collect();
    assert_eq!(all.len(), 11);
    assert_eq!(lines_of(|log| log_faults(Faults::ALL_BITS, log)), all);
    assert_eq!(lines_of(|log| log_faults(Faults::NONE, log)), NOTHING);
}

#[test]
fn rangefinder_is_silent_after_three_misses() {
    let mut event_log = EventLog::new(Milliseconds(0));
    let mut stats = EchoStats {
        hits: 11,
        out_of_range: 22,
        missing: 30,
        consecutive_misses: 0,
    };
    let mut lines = Vec::new();
    for misses in [0, 1, 2, 0, 1, 2, 3, 4, 255, 0, 0, 1] {
        stats.missing += u32::from(misses > 0);
        stats.consecutive_misses = misses;
        lines.extend(lines_of(|log| event_log.rangefinder(Left, &stats, log)));
    }
    let expected = [
        "W: left rangefinder silent: hits 11, out of range 22, missing 35",
        "W: left rangefinder answers: hits 11, out of range 22, missing 37",
    ];
    assert_eq!(lines, expected);
    stats.consecutive_misses = 3;
    for (id, count) in [(Left, 1), (Front, 1), (Front, 0)] {
        let lines = lines_of(|log| event_log.rangefinder(id, &stats, log));
        assert_eq!(lines.len(), count);
    }
}

// Requirement: WIRE-log-10
#[test]
fn temperature_is_logged_when_known_and_when_lost() {
    let mut event_log = EventLog::new(Milliseconds(0));
    let degrees = |degrees: f64| Some(I16F16::from_num(degrees));
    let lost = Some("W: no temperature: sound at 343 m/s");
    for (air, line) in [
        (None, lost),
        (degrees(-12.4), Some("I: air at -12 deg C")),
        (degrees(30.0), None),
        (None, lost),
        (None, None),
        (degrees(21.6), Some("I: air at 22 deg C")),
    ] {
        let lines = lines_of(|log| event_log.temperature(air, log));
        assert_eq!(lines, Vec::from_iter(line));
    }
}

#[test]
fn rejected_frames_beyond_the_last_number_stay_there() {
    let mut event_log = EventLog::new(Milliseconds(0));
    event_log.frame_rejected(stale(1));
    event_log.suppressed = u32::MAX;
    event_log.frame_rejected(stale(2));
    assert_eq!(event_log.suppressed, u32::MAX);
}

// Requirement: WIRE-obstacle-6
#[test]
fn obstacle_is_logged_once_and_its_end_a_second_later() {
    let (mut event_log, mut log) = (EventLog::new(Milliseconds(0)), Log::new());
    let mut all = Vec::new();
    for tick in 0..500 {
        let obstacle = (3..10).contains(&tick) || [20, 300, 400].contains(&tick);
        // A state's line goes first; the limit that comes back meanwhile has not ended.
        let state = [State::Booting, State::Ready][usize::from(tick >= 399)];
        let _ = event_log.tick(state, Halt::None, obstacle, &mut log);
        all.extend(lines(&mut log).into_iter().map(|line| (tick, line)));
    }
    let begin = |tick| (tick, String::from("I: obstacle: speed limited"));
    let end = |tick| (tick, String::from("I: obstacle: way free"));
    let ready = (399, String::from("I: ready"));
    assert_eq!(all, [begin(3), end(119), begin(300), ready, end(499)]);
}

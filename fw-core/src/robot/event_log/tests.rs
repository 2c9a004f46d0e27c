//! Every line, its level, and how often it comes.

extern crate std;

use super::*;
use crate::log::tests::transmitted;
use crate::types::RangefinderId::{Front, Left};
use crate::wire::Reason;
use fixed::types::I16F16;
use std::string::String;
use std::vec::Vec;

/// What a log has said since it was asked last: levels and texts, without the numbers.
fn said(log: &mut Log) -> Vec<String> {
    let text = transmitted(log);
    let line = |line: &str| std::format!("{}{}", &line[..1], &line[6..]);
    text.lines().map(line).collect()
}

/// What one call says.
fn told(tell: impl FnOnce(&mut Log)) -> Vec<String> {
    let mut log = Log::new();
    tell(&mut log);
    said(&mut log)
}

const NOTHING: [&str; 0] = [];

fn stale(found: u8) -> FrameError {
    FrameError {
        field: crate::wire::Field::Sequence,
        offset: 9,
        reason: Reason::Stale { last: 7, found },
    }
}

// Requirement: DOC-2.1-3
#[test]
fn a_change_of_state_is_one_line_and_its_level_says_whether_somebody_should_look() {
    let mut event_log = EventLog::new(0);
    for (state, faults, line) in [
        (State::Ready, Faults::NONE, "I: ready"),
        (State::Moving, Faults::NONE, "I: moving"),
        (State::Stopped, Faults::NONE, "W: stopped"),
        (State::Ready, Faults::NONE, "I: ready"),
        (
            State::Stopped,
            Faults::LINK_LOST | Faults::SLIP,
            "W: stopped: no fresh frame in time",
        ),
        (
            State::Faulted,
            Faults::ENCODER_JUMP,
            "E: faulted: motors off",
        ),
        // An order to stop, whatever else is latched.
        (
            State::Stopped,
            Faults::ALL_BITS.difference(Faults::LINK_LOST),
            "W: stopped",
        ),
        (State::Booting, Faults::NONE, "I: booting"),
    ] {
        let mut due = false;
        let lines = told(|log| due = event_log.tick(state, faults, log));
        assert_eq!(lines, [line]);
        assert!(due);
        let lines = told(|log| due = event_log.tick(state, faults, log));
        assert_eq!(lines, NOTHING, "told once");
        assert!(!due);
    }
}

#[test]
fn a_broken_wire_tells_of_the_first_frame_and_counts_the_others_once_a_second() {
    let mut event_log = EventLog::new(0);
    let mut log = Log::new();
    let mut lines = Vec::new();
    // Two frames a tick, from tick 5 to tick 154.
    for tick in 0..500 {
        if (5..155).contains(&tick) {
            event_log.frame_rejected(stale(1));
            event_log.frame_rejected(stale(2));
        }
        let due = event_log.tick(State::Booting, Faults::NONE, &mut log);
        let said = said(&mut log);
        assert_eq!(due, !said.is_empty());
        lines.extend(said.into_iter().map(|line| (tick, line)));
    }
    let first = {
        let mut line = Line::new();
        stale(1).log(line.text("W: frame rejected: "));
        String::from(line.as_str())
    };
    let more = |tick: u32, count: u32| (tick, std::format!("W: {count} more frames rejected"));
    // One frame is told of and 299 are counted: those of 5 to 105, the other one of tick 5 left out,
    // and those of 106 to 154.
    assert_eq!(lines, [(5, first), more(105, 201), more(205, 98)]);
}

#[test]
fn after_a_second_of_silence_a_rejected_frame_is_told_of_itself_again() {
    let mut event_log = EventLog::new(0);
    event_log.frame_rejected(stale(1));
    let lines = told(|log| _ = event_log.tick(State::Booting, Faults::NONE, log));
    assert_eq!(lines.len(), 1);
    for _ in 0..QUIET_TICKS {
        let lines = told(|log| _ = event_log.tick(State::Booting, Faults::NONE, log));
        assert_eq!(lines, NOTHING);
    }
    event_log.frame_rejected(stale(2));
    let lines = told(|log| _ = event_log.tick(State::Booting, Faults::NONE, log));
    assert_eq!(lines.len(), 1);
    assert!(lines[0].starts_with("W: frame rejected: "), "{lines:?}");
}

#[test]
fn a_state_goes_before_a_rejected_frame_and_that_before_a_target() {
    let mut event_log = EventLog::new(0);
    event_log.frame_rejected(stale(1));
    event_log.target_set(PoseCode::default());
    // The last of several: half a metre ahead, a quarter turn.
    event_log.target_set(PoseCode {
        x: 500_000,
        y: -20,
        rotation: 0x2000,
    });
    let mut lines = Vec::new();
    for _ in 0..4 {
        let now = told(|log| _ = event_log.tick(State::Ready, Faults::NONE, log));
        assert!(now.len() <= 1);
        lines.extend(now);
    }
    assert_eq!(lines[0], "I: ready");
    assert!(lines[1].starts_with("W: frame rejected: "), "{lines:?}");
    assert_eq!(lines[2..], ["I: target 500.000 -0.020 mm, 90.00 deg"]);
}

#[test]
fn a_pose_line_is_due_every_so_many_ticks() {
    for (milliseconds, ticks) in [
        (1, 1),
        (10, 1),
        (11, 2),
        (20, 2),
        (100, 10),
        (60_000, 6_000),
    ] {
        let mut event_log = EventLog::new(milliseconds);
        for tick in 1..=3 * ticks {
            assert_eq!(event_log.pose_due(), tick % ticks == 0, "{milliseconds}");
        }
    }
    let mut silent = EventLog::new(0);
    assert!((0..70_000).all(|_| !silent.pose_due()));
}

#[test]
fn a_sample_of_a_tuning_mode_and_a_pose_read_as_they_are() {
    let lines = told(|log| log_tuning(Duty::saturating(-1234), -5, log));
    assert_eq!(lines, ["I: T -12.34 -0.005"]);
    let code = PoseCode {
        x: -1,
        y: 1_234_567,
        rotation: 0x7FFF,
    };
    // A 32768th of a turn less than one is 359.989°, and what is cut off is below a hundredth.
    assert_eq!(
        told(|log| log_pose(&code, log)),
        ["I: pose -0.001 1234.567 mm, 359.98 deg"]
    );
}

#[test]
fn every_fault_that_somebody_must_know_of_has_a_line_of_its_own() {
    let lines = [
        "no crystal: running from the internal oscillator",
        "battery low: charge it",
        "battery empty: motors off",
        "left wheel stalled",
        "right wheel stalled",
        "an encoder jumped",
        "left wheel reversed",
        "right wheel reversed",
        "restarted after a failure",
    ];
    let bits = [1, 3, 4, 5, 6, 7, 8, 9, 11];
    let mut all = Vec::new();
    for bit in 0..16 {
        let told = told(|log| log_faults(Faults::from_bits(1 << bit), log));
        let place = bits.iter().position(|&own| own == bit);
        let expected: Vec<String> = place
            .map(|place| {
                // What keeps the motors off is an error.
                let blocks = Faults::BLOCKING.intersects(Faults::from_bits(1 << bit));
                std::format!("{}: {}", if blocks { 'E' } else { 'W' }, lines[place])
            })
            .into_iter()
            .collect();
        assert_eq!(told, expected, "bit {bit}");
        all.extend(told);
    }
    let mut log = Log::<1024>::new();
    log_faults(Faults::ALL_BITS, &mut log);
    assert_eq!(said(&mut log), all);
    log_faults(Faults::NONE, &mut log);
    assert_eq!(said(&mut log), NOTHING);
}

#[test]
fn a_rangefinder_is_silent_after_three_triggers_without_an_answer_and_answers_with_the_first() {
    let mut event_log = EventLog::new(0);
    let mut stats = EchoStats {
        hits: 11,
        out_of_range: 22,
        missing: 30,
        consecutive_misses: 0,
    };
    let mut lines = Vec::new();
    for row in [0, 1, 2, 0, 1, 2, 3, 4, 255, 0, 0, 1] {
        stats.missing += u32::from(row > 0);
        stats.consecutive_misses = row;
        lines.extend(told(|log| event_log.rangefinder(Left, &stats, log)));
    }
    // Two and two before the third in a consecutive_misses, and two after it.
    assert_eq!(
        lines,
        [
            "W: left rangefinder silent: hits 11, out of range 22, missing 35",
            "W: left rangefinder answers: hits 11, out of range 22, missing 37",
        ]
    );
    // Each on its own.
    stats.consecutive_misses = 3;
    assert_eq!(
        told(|log| event_log.rangefinder(Left, &stats, log)).len(),
        1
    );
    assert_eq!(
        told(|log| event_log.rangefinder(Front, &stats, log)).len(),
        1
    );
    assert_eq!(
        told(|log| event_log.rangefinder(Front, &stats, log)),
        NOTHING
    );
}

#[test]
fn a_temperature_is_told_when_it_becomes_known_and_when_it_is_no_more() {
    let mut event_log = EventLog::new(0);
    let degrees = |degrees: f64| Some(I16F16::from_num(degrees));
    for (air, line) in [
        (degrees(-12.4), Some("I: air at -12 deg C")),
        (degrees(30.0), None),
        (
            None,
            Some("W: no temperature: speed of sound 343 m/s assumed"),
        ),
        (None, None),
        (degrees(21.6), Some("I: air at 22 deg C")),
        (degrees(21.6), None),
    ] {
        let lines = told(|log| event_log.temperature(air, log));
        assert_eq!(lines, Vec::from_iter(line));
    }
    let mut event_log = EventLog::new(0);
    assert_eq!(
        told(|log| event_log.temperature(None, log)),
        ["W: no temperature: speed of sound 343 m/s assumed"],
        "not even the first"
    );
}

//! Both ends step by step: sequence numbers over lost, repeated and torn frames and restarts.

use crate::ends::{Ends, Message};
use crate::json::{Value, bytes, essence, file, int, list, rejection, report, setup, text};
use fw_core::wire::{
    Cause, Command, LinkCounters, PiLink, Report, Sequence, Setup, State, StmLink,
};

fn perform(ends: &mut Ends, setup: Setup, step: &Value) {
    let is_pi = step["end"] == "pi";
    match text(step, "do") {
        "start" if is_pi => ends.pi = PiLink::new(setup),
        "start" => (ends.stm, ends.reply) = (StmLink::new(setup), 0),
        "send" => {
            let frame = ends.send(&Message::new(is_pi, &step["values"]));
            assert_eq!(frame, bytes(step));
            // The number decides what a reply is, not how often it is encoded.
            if !is_pi {
                resend(ends, step);
            }
        }
        "resend" => resend(ends, step),
        "receive" => {
            let received = ends.receive(!is_pi, &bytes(step), 0);
            if step["values"].is_null() {
                let error = received.unwrap_err();
                assert_eq!(essence(&error), rejection(&step["rejected"]));
            } else {
                assert_eq!(received, Ok(Message::new(!is_pi, &step["values"])));
            }
        }
        "exchange" => {
            for _ in 0..int::<u16>(step, "times") {
                exchange(ends, step["to_stm"] == true, step["to_pi"] == true);
            }
        }
        "counters" => check(ends.counters(is_pi), &step["counters"]),
        other => panic!("step {other}"),
    }
}

fn resend(ends: &Ends, step: &Value) {
    let report = report(&step["values"]);
    for _ in 0..2 {
        assert_eq!(ends.encode_reply(&report), bytes(step));
    }
}

/// A chip-select at rest; the reply was written before the command arrives.
fn exchange(ends: &mut Ends, to_stm: bool, to_pi: bool) {
    let ready = Report {
        state: State::Ready,
        ..Report::default()
    };
    let there = ends.send(&Message::at_rest(true));
    let back = ends.send(&Message::FromStm(ready));
    assert_eq!(there.len(), back.len());
    if to_stm {
        let received = ends.stm.receive(&there, 0, ends.reply + 1);
        let mut command = received.expect("accepted");
        command.sequence = Sequence::default();
        assert_eq!(command, Command::default());
    }
    if to_pi {
        ends.pi.receive(&back).expect("accepted");
    }
}

fn check(counters: &LinkCounters, expected: &Value) {
    assert_eq!(counters.accepted, int::<u32>(expected, "accepted"));
    assert_eq!(counters.missed, int::<u32>(expected, "missed"));
    for cause in Cause::ALL {
        let count = expected["rejected"][cause.name()].as_u64().unwrap_or(0);
        let rejected = u64::from(counters.rejected(cause));
        assert_eq!(rejected, count, "{}", cause.name());
    }
}

// Requirement: WIRE-sequence-2, WIRE-sequence-4
#[test]
fn sessions_match_vectors() {
    for session in list(&file("sessions")) {
        let name = text(session, "name");
        let setup = setup(session);
        let mut ends = Ends::new(setup);
        for (number, step) in list(&session["steps"]).iter().enumerate() {
            let step_once = std::panic::AssertUnwindSafe(|| perform(&mut ends, setup, step));
            let run = std::panic::catch_unwind(step_once);
            let mode = &session["mode"];
            assert!(run.is_ok(), "{name}, mode {mode}, step {number}: {step}");
        }
    }
}

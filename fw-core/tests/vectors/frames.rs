//! Whole frames of every mode through both ends of the link: accepted and rejected ones.

use crate::ends::{Ends, Message};
use crate::json::{
    Value, bytes, essence, file, int, is_command, is_written, list, maybe, mode, rejection, setup,
};
use fw_core::wire::{Field, Mode, Setup, frame_len};

/// Ends of which the sender's next number is `own`, and it has accepted `seen`; 0 where it has accepted
/// nothing.
fn sending(setup: Setup, is_command: bool, own: u8, seen: u8) -> Ends {
    let mut ends = Ends::new(setup);
    if seen != 0 {
        accept(&mut ends, !is_command, seen, setup);
    }
    for _ in 1..number(own) {
        ends.send(&Message::at_rest(is_command));
    }
    ends
}

/// Ends of which the receiver has accepted `last`, or nothing.
fn receiving(setup: Setup, is_command: bool, last: Option<u8>) -> Ends {
    let mut ends = Ends::new(setup);
    if let Some(last) = last.filter(|_| setup.mode.has(Field::Sequence)) {
        accept(&mut ends, is_command, last, setup);
    }
    ends
}

/// Has a frame at rest with this number accepted.
#[track_caller]
fn accept(ends: &mut Ends, is_command: bool, own: u8, setup: Setup) {
    let frame = sending(setup, is_command, own, 0).send(&Message::at_rest(is_command));
    ends.receive(is_command, &frame, 0).expect("accepted");
}

/// How many sends lead to a number: it starts at 1 and wraps.
fn number(own: u8) -> u16 {
    if own == 0 { 256 } else { own.into() }
}

// Requirement: WIRE-modes-1, DOC-5.2-1, WIRE-distance-2
#[test]
fn frames_encode_to_vector_bytes() {
    let file = file("frames");
    for vector in list(&file).iter().filter(|vector| is_written(vector)) {
        let (values, is_command) = (&vector["values"], is_command(vector));
        let own = maybe(values, "own").unwrap_or(1);
        let seen = maybe(values, "seen").unwrap_or(0);
        let mut ends = sending(setup(vector), is_command, own, seen);
        let frame = ends.send(&Message::new(is_command, values));
        assert_eq!(frame, bytes(vector), "{vector}");
        assert_eq!(frame.len(), frame_len(mode(vector)), "{vector}");
    }
}

// Requirement: WIRE-modes-1, DOC-5.2-1, WIRE-distance-2
#[test]
fn frames_decode_to_vector_values() {
    for vector in list(&file("frames")) {
        let is_command = is_command(vector);
        let mut ends = receiving(setup(vector), is_command, maybe(vector, "last"));
        let before = ends.counters(!is_command).accepted;
        let found = ends.receive(is_command, &bytes(vector), 0);
        let expected = Message::new(is_command, &vector["values"]);
        assert_eq!(found, Ok(expected), "{vector}");
        let counters = ends.counters(!is_command);
        assert_eq!(counters.accepted, before + 1, "{vector}");
        assert_eq!(counters.rejected_total(), 0, "{vector}");
    }
}

// Requirement: DOC-5.1-3, DOC-5.1.3-5, DOC-5.1.6-1, DOC-5.1.6-3, WIRE-battery-3, WIRE-rejected-1
// Requirement: WIRE-rejected-2, WIRE-rejected-3
#[test]
fn rejected_frames_match_vector_errors() {
    for vector in list(&file("rejected")) {
        let (setup, is_command) = (setup(vector), is_command(vector));
        let last = maybe(vector, "last");
        let mut ends = receiving(setup, is_command, last);
        let before = ends.counters(!is_command).frames();
        let expected = rejection(&vector["rejected"]);
        let frame = bytes(vector);
        let clocked = maybe(vector, "clocked").unwrap_or(frame.len());
        assert!(is_command || clocked == frame.len());
        let taken = frame.get(..clocked).unwrap_or(&frame);
        let received = ends.receive(is_command, taken, clocked.saturating_sub(frame.len()));
        let error = received.unwrap_err();
        assert_eq!(essence(&error), expected, "{vector}: {error}");

        let after = ends.counters(!is_command);
        assert_eq!(after.rejected(expected.2), 1, "{vector}");
        assert_eq!(after.rejected_total(), 1, "{vector}");
        assert_eq!(after.frames(), before + 1, "{vector}");
        // Nothing else has changed: the frame that would have been next still is.
        let next = last.unwrap_or(0_u8).wrapping_add(1);
        accept(&mut ends, is_command, next, setup);
        assert_eq!(ends.counters(!is_command).missed, 0, "{vector}");
    }
}

#[test]
fn vectors_cover_every_mode_and_wrong_length() {
    let (frames, rejected) = (file("frames"), file("rejected"));
    for &mode in Mode::ALL {
        for command in [true, false] {
            for len in 0..frame_len(mode) + 4 {
                let right = len == frame_len(mode);
                let file = if right { &frames } else { &rejected };
                let covers = |vector: &Value| {
                    let of_mode = int::<u8>(vector, "mode") == mode.code();
                    of_mode && is_command(vector) == command && bytes(vector).len() == len
                };
                assert!(list(file).iter().any(covers), "{mode:?} of {len} bytes");
            }
        }
    }
}

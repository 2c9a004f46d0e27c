//! Whole frames of every mode through both ends of the link: accepted and rejected ones.

use crate::json::{
    Value, bytes, command, essence, file, int, is_command, is_written, list, maybe, mode,
    rejection, report, setup,
};
use fw_core::wire::{
    Command, Field, LinkCounters, MAX_FRAME, Mode, PiLink, Report, Setup, StmLink, frame_len,
};

/// Both ends, brought to where a vector needs them.
struct Pair {
    pi: PiLink,
    stm: StmLink,
    /// Number of the STM's last frame.
    reply: u32,
}

impl Pair {
    fn new(setup: Setup) -> Self {
        Self {
            pi: PiLink::new(setup),
            stm: StmLink::new(setup),
            reply: 0,
        }
    }

    /// The sender's next number is `own`, and it has accepted `seen`; 0 where it has accepted
    /// nothing.
    fn sending(setup: Setup, command: bool, own: u8, seen: u8) -> Self {
        let mut pair = Self::new(setup);
        if seen != 0 {
            pair.accept(&frame_numbered(setup, !command, seen), !command);
        }
        for _ in 1..number(own) {
            pair.send(command, &Command::default(), &Report::default());
        }
        pair
    }

    /// The receiver has accepted `last`, or nothing.
    fn receiving(setup: Setup, command: bool, last: Option<u8>) -> Self {
        let mut pair = Self::new(setup);
        if let Some(last) = last.filter(|_| setup.mode.has(Field::Sequence)) {
            pair.accept(&frame_numbered(setup, command, last), command);
        }
        pair
    }

    #[track_caller]
    fn accept(&mut self, frame: &[u8], is_command: bool) {
        if is_command {
            self.stm.receive(frame, 0, 1).expect("accepted");
        } else {
            self.pi.receive(frame).expect("accepted");
        }
    }

    fn send(&mut self, is_command: bool, command: &Command, report: &Report) -> Vec<u8> {
        let mut frame = [0xEE; MAX_FRAME];
        let len = if is_command {
            self.pi.send(command, &mut frame)
        } else {
            self.reply += 1;
            self.stm.encode_reply(self.reply, report, &mut frame)
        };
        frame[..len].to_vec()
    }

    fn counters(&self, command: bool) -> LinkCounters {
        *if command {
            self.stm.counters()
        } else {
            self.pi.counters()
        }
    }
}

/// How many sends lead to a number: it starts at 1 and wraps.
fn number(own: u8) -> u16 {
    if own == 0 { 256 } else { own.into() }
}

/// A frame at rest with this number of its sender.
fn frame_numbered(setup: Setup, command: bool, own: u8) -> Vec<u8> {
    Pair::sending(setup, command, own, 0).send(command, &Command::default(), &Report::default())
}

// Requirement: WIRE-modes-1, DOC-5.2-1, WIRE-distance-2
#[test]
fn frames_encode_to_vector_bytes() {
    let file = file("frames");
    for vector in list(&file).iter().filter(|vector| is_written(vector)) {
        let (values, is_command) = (&vector["values"], is_command(vector));
        let own = maybe(values, "own").unwrap_or(1);
        let seen = maybe(values, "seen").unwrap_or(0);
        let mut ends = Pair::sending(setup(vector), is_command, own, seen);
        let frame = if is_command {
            ends.send(true, &command(values), &Report::default())
        } else {
            ends.send(false, &Command::default(), &report(values))
        };
        assert_eq!(frame, bytes(vector), "{vector}");
        assert_eq!(frame.len(), frame_len(mode(vector)), "{vector}");
    }
}

// Requirement: WIRE-modes-1, DOC-5.2-1, WIRE-distance-2
#[test]
fn frames_decode_to_vector_values() {
    for vector in list(&file("frames")) {
        let is_command = is_command(vector);
        let mut ends = Pair::receiving(setup(vector), is_command, maybe(vector, "last"));
        let before = ends.counters(is_command).accepted;
        if is_command {
            let found = ends.stm.receive(&bytes(vector), 0, 1);
            assert_eq!(found, Ok(command(&vector["values"])), "{vector}");
        } else {
            let found = ends.pi.receive(&bytes(vector));
            assert_eq!(found, Ok(report(&vector["values"])), "{vector}");
        }
        let counters = ends.counters(is_command);
        assert_eq!(counters.accepted, before + 1, "{vector}");
        assert_eq!(counters.rejected_total(), 0, "{vector}");
    }
}

// Requirement: DOC-5.1-3, DOC-5.1.3-5, DOC-5.1.6-1, DOC-5.1.6-3, WIRE-battery-3, WIRE-rejected-1
// Requirement: WIRE-rejected-2
#[test]
fn rejected_frames_match_vector_errors() {
    for vector in list(&file("rejected")) {
        let (setup, is_command) = (setup(vector), is_command(vector));
        let last = maybe(vector, "last");
        let mut ends = Pair::receiving(setup, is_command, last);
        let before = ends.counters(is_command);
        let expected = rejection(&vector["rejected"]);
        let frame = bytes(vector);
        let clocked = maybe(vector, "clocked").unwrap_or(frame.len());
        let error = if is_command {
            let bytes = frame.get(..clocked).unwrap_or(&frame);
            let overflow_len = clocked.saturating_sub(frame.len());
            ends.stm.receive(bytes, overflow_len, 1).unwrap_err()
        } else {
            assert_eq!(clocked, frame.len());
            ends.pi.receive(&frame).unwrap_err()
        };
        assert_eq!(essence(&error), expected, "{vector}: {error}");

        let after = ends.counters(is_command);
        assert_eq!(after.rejected(expected.2), 1, "{vector}");
        assert_eq!(after.rejected_total(), 1, "{vector}");
        assert_eq!(after.frames(), before.frames() + 1, "{vector}");
        // Nothing else has changed: the frame that would have been next still is.
        let next = last.unwrap_or(0_u8).wrapping_add(1);
        ends.accept(&frame_numbered(setup, is_command, next), is_command);
        assert_eq!(ends.counters(is_command).missed, 0, "{vector}");
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

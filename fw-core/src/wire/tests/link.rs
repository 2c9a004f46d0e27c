//! Sequence numbers and counters of both ends.

use super::{setup, Mode, GUARDED};
use crate::types::Faults;
use crate::wire::sequence::newer;
use crate::wire::{
    chain, Cause, Command, FrameError, PiLink, Reason, Report, State, StmLink, MAX_FRAME,
};
use std::vec::Vec;

struct Wire {
    pi: PiLink,
    stm: StmLink,
    reply: [u8; MAX_FRAME],
    len: usize,
}

impl Wire {
    fn new(mode: Mode) -> Self {
        let mut wire = Self {
            pi: PiLink::new(setup(mode)),
            stm: StmLink::new(setup(mode)),
            reply: [0; MAX_FRAME],
            len: 0,
        };
        wire.len = wire.stm.send(&Report::default(), &mut wire.reply);
        wire
    }

    /// One chip-select: both frames cross, then the STM prepares the next reply.
    fn exchange(&mut self) -> (Result<Command, FrameError>, Result<Report, FrameError>) {
        let mut frame = [0; MAX_FRAME];
        let len = self.pi.send(&Command::default(), &mut frame);
        let report = self.pi.receive(&self.reply[..self.len]);
        let command = self.stm.receive(&frame[..len]);
        self.len = self.stm.send(&Report::default(), &mut self.reply);
        (command, report)
    }

    fn both_accept(&mut self) -> bool {
        let (command, report) = self.exchange();
        command.is_ok() && report.is_ok()
    }
}

// Requirement: WIRE-sequence-1
#[test]
fn newer_is_one_to_127_steps_ahead_for_every_pair() {
    for a in 0..=255_u8 {
        for b in 0..=255_u8 {
            let ahead = (i32::from(a) - i32::from(b)).rem_euclid(256);
            assert_eq!(newer(a, b), (1..128).contains(&ahead));
        }
    }
}

#[test]
fn a_whole_frame_that_is_right_is_taken_at_once_and_any_other_left_to_the_long_way() {
    for &mode in Mode::ALL {
        let said = Command {
            apply: chain(mode)
                .iter()
                .any(|strategy| strategy.name == "position"),
            ..Command::default()
        };
        let mut frame = [0; MAX_FRAME];
        let len = PiLink::new(setup(mode)).send(&said, &mut frame);
        let frame = &frame[..len];
        let fresh = StmLink::new(setup(mode));
        let (mut long, mut whole) = (fresh.clone(), fresh.clone());
        let command = long.receive(frame).ok();
        assert!(command.is_some());
        assert_eq!(whole.receive_whole(frame, len), command, "{mode:?}");
        assert_eq!(whole.counters(), long.counters());
        let (mut one, mut other) = ([0; MAX_FRAME], [0; MAX_FRAME]);
        whole.send(&Report::default(), &mut one);
        long.send(&Report::default(), &mut other);
        assert_eq!(one, other, "what is said next knows of it");
        // More or fewer were clocked, or the key is wrong: not taken, and not counted either.
        let mut wrong = frame.to_vec();
        wrong[0] ^= 1;
        for (frame, clocked) in [(frame, len + 1), (frame, len - 1), (&wrong[..], len)] {
            let mut stm = fresh.clone();
            assert_eq!(stm.receive_whole(frame, clocked), None, "{mode:?}");
            assert_eq!(stm.counters(), fresh.counters());
        }
    }
}

#[test]
fn every_state_has_its_word() {
    let states = [
        State::Booting,
        State::Ready,
        State::Moving,
        State::Stopped,
        State::Faulted,
    ];
    let words = ["booting", "ready", "moving", "stopped", "faulted"];
    assert_eq!(states.map(State::name), words);
}

// Requirement: WIRE-sequence-2, WIRE-sequence-4
#[test]
fn a_thousand_exchanges_wrap_the_counters_and_all_are_accepted() {
    for &mode in Mode::ALL {
        let mut wire = Wire::new(mode);
        for n in 0..1000_u32 {
            let (command, report) = wire.exchange();
            let (command, report) = (command.unwrap(), report.unwrap());
            if mode.tells_fresh() {
                assert_eq!(u32::from(command.sequence.own), (n + 1) % 256);
                // The Pi learns in this frame what the STM accepted in the one before.
                assert_eq!(u32::from(report.sequence.seen), n % 256);
                assert_eq!(wire.pi.counters().unacknowledged, 1);
            }
        }
        assert_eq!(wire.stm.counters().accepted, 1000);
        assert_eq!(wire.pi.counters().accepted, 1000);
        assert_eq!(wire.stm.counters().missed, 0);
        assert_eq!(wire.pi.counters().missed, 0);
        assert_eq!(wire.stm.counters().frames(), 1000);
    }
}

// Requirement: WIRE-sequence-6
#[test]
fn a_repeated_frame_is_stale_in_guarded_modes_only() {
    for &mode in Mode::ALL {
        let mut wire = Wire::new(mode);
        let mut frame = [0; MAX_FRAME];
        let len = wire.pi.send(&Command::default(), &mut frame);
        wire.stm.receive(&frame[..len]).unwrap();
        let again = wire.stm.receive(&frame[..len]);
        if mode.tells_fresh() {
            let reason = Reason::Stale { last: 1, found: 1 };
            assert_eq!(again.unwrap_err().reason, reason);
            assert_eq!(wire.stm.counters().rejected(Cause::Stale), 1);
        } else {
            again.unwrap();
        }
    }
}

// Requirement: WIRE-sequence-5
#[test]
fn a_reply_sent_anew_keeps_its_number_and_a_new_one_gets_the_next() {
    for mode in GUARDED {
        let mut stm = StmLink::new(setup(mode));
        let (mut first, mut fresher, mut next) = ([0; 26], [0; 26], [0; 26]);
        let len = stm.send(&Report::default(), &mut first);
        let report = Report {
            faults: Faults::from_bits(5),
            ..Report::default()
        };
        assert_eq!(stm.resend(&report, &mut fresher), len);
        stm.send(&report, &mut next);
        assert_eq!((first[1], fresher[1], next[1]), (1, 1, 2));
        let mut pi = PiLink::new(setup(mode));
        assert_eq!(pi.receive(&fresher[..len]).unwrap().faults.bits(), 5);
        assert!(pi.receive(&first[..len]).is_err());
        assert!(pi.receive(&next[..len]).is_ok());
    }
}

#[test]
fn lost_frames_are_missed_and_the_next_good_one_is_accepted() {
    for mode in GUARDED {
        for lost in 1..=126_u8 {
            let mut wire = Wire::new(mode);
            assert!(wire.both_accept());
            let mut frame = [0; MAX_FRAME];
            for _ in 0..lost {
                wire.pi.send(&Command::default(), &mut frame);
            }
            assert!(wire.both_accept());
            assert_eq!(wire.stm.counters().missed, u32::from(lost));
        }
    }
}

// Requirement: WIRE-sequence-7
#[test]
fn whatever_an_end_restarted_at_the_link_runs_again_within_five_frames() {
    for mode in GUARDED {
        for before in 0..600 {
            let mut wire = Wire::new(mode);
            for _ in 0..before {
                let _ = wire.exchange();
            }
            let mut restarted_pi = Wire {
                pi: PiLink::new(setup(mode)),
                stm: wire.stm.clone(),
                ..wire
            };
            for _ in 0..4 {
                let _ = restarted_pi.exchange();
            }
            assert!(restarted_pi.both_accept(), "{mode:?} {before}");

            let mut restarted_stm = Wire {
                pi: wire.pi.clone(),
                ..Wire::new(mode)
            };
            for _ in 0..4 {
                let _ = restarted_stm.exchange();
            }
            assert!(restarted_stm.both_accept(), "{mode:?} {before}");
        }
    }
}

/// What the STM, which has accepted number `last`, makes of frames of these numbers.
fn made_of(mode: Mode, last: u8, numbers: &[u8]) -> Vec<bool> {
    let mut stm = StmLink::new(setup(mode));
    let mut frames = std::vec![[0; MAX_FRAME]; 256];
    let mut pi = PiLink::new(setup(mode));
    let mut len = 0;
    for number in 1..=256_usize {
        len = pi.send(&Command::default(), &mut frames[number % 256]);
    }
    let mut receive = |number: u8| stm.receive(&frames[usize::from(number)][..len]).is_ok();
    assert!(receive(last));
    numbers.iter().map(|&number| receive(number)).collect()
}

#[test]
fn four_stale_frames_in_a_row_that_count_upwards_begin_anew() {
    for mode in GUARDED {
        let taken = made_of(mode, 100, &[254, 255, 0, 1, 2, 1]);
        assert_eq!(taken, [false, false, false, true, true, false]);
        // A gap, a number twice, a fresh frame and the last number each break the row.
        for row in [
            [1, 2, 3, 5, 6, 7],
            [1, 2, 3, 3, 4, 5],
            [98, 99, 100, 97, 98, 99],
            [97, 98, 99, 100, 99, 100],
            [99, 100, 99, 100, 99, 100],
        ] {
            assert_eq!(made_of(mode, 100, &row), [false; 6], "{row:?}");
        }
        let taken = made_of(mode, 100, &[1, 2, 3, 101, 4, 5, 6, 7]);
        let expected = [false, false, false, true, false, false, false, true];
        assert_eq!(taken, expected);
    }
}

#[test]
fn a_frame_with_a_wrong_checksum_stands_in_no_row() {
    for mode in GUARDED {
        let mut stm = StmLink::new(setup(mode));
        let mut pi = PiLink::new(setup(mode));
        let mut frame = [0; MAX_FRAME];
        for _ in 0..100 {
            let len = pi.send(&Command::default(), &mut frame);
            stm.receive(&frame[..len]).unwrap();
        }
        let mut pi = PiLink::new(setup(mode));
        for number in 1..=50 {
            let len = pi.send(&Command::default(), &mut frame);
            frame[len - 1] ^= u8::from(number % 4 == 0);
            assert!(stm.receive(&frame[..len]).is_err(), "{number}");
        }
        assert_eq!(stm.counters().accepted, 100);
        assert_eq!(stm.counters().rejected(Cause::Stale), 50);
    }
}

// Requirement: WIRE-spi-3, WIRE-log-11
#[test]
fn frames_dropped_unread_are_counted() {
    let mut stm = StmLink::new(setup(Mode::Normal));
    stm.overrun(3);
    stm.overrun(u32::MAX);
    assert_eq!(stm.counters().overrun, u32::MAX);
    assert_eq!(stm.counters().frames(), u32::MAX);
}

// Requirement: WIRE-rejected-1
#[test]
fn every_cause_has_its_own_counter_and_name() {
    for (place, cause) in Cause::ALL.into_iter().enumerate() {
        assert_eq!(cause as usize, place);
        let same_name = Cause::ALL
            .iter()
            .filter(|other| other.name() == cause.name());
        assert_eq!(same_name.count(), 1);
    }
}

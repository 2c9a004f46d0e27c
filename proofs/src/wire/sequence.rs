//! T8: the sequence numbers: no old frame counts, and the two ends always find each other again.

use fw_core::wire::strategy::Context;
use fw_core::wire::{
    Command, MAX_FRAME, Mode, PiLink, Report, Setup, StmLink, write_command, write_report,
};

use super::table::{is_fresh, table};
use crate::property::Seen;

/// A quiet frame of each end with this number.
fn numbered(setup: Setup, own: u8) -> ([u8; MAX_FRAME], [u8; MAX_FRAME]) {
    let context = Context {
        own,
        ..setup.context()
    };
    let (mut there, mut back) = ([0; MAX_FRAME], [0; MAX_FRAME]);
    let _ = write_command(setup.mode, &context, &Command::default(), &mut there);
    let _ = write_report(setup.mode, &context, &Report::default(), &mut back);
    (there, back)
}

/// A frame that the STM once took is never taken a second time in a guarded mode, whatever number it had and
/// however many newer ones were taken since, as long as the numbers have not gone half way around.
// Requirement: WIRE-sequence-1, WIRE-sequence-6
pub fn repeated_frame_is_stale(mode: Mode, first: u8, between: u8) -> Seen {
    given!(table(mode).guarded && between < 128);
    let setup = Setup::first_board(mode);
    let mut stm = StmLink::new(setup);
    let mut receive = |number: u8| {
        let (frame, _) = numbered(setup, number);
        stm.receive(&frame[..table(mode).len], 0, 1).is_ok()
    };
    assert!((0..=between).all(|newer| receive(first.wrapping_add(newer))));
    assert!(!receive(first));
    assert!(stm.counters().accepted == u32::from(between) + 1);
    Seen::NOTHING.case(0, between == 0).case(1, between == 127)
}

/// Frames of up to three old numbers, in turn as often as one likes, never count: not the same one
/// again and again, not two in turn, not three. So none of them feeds the stop deadline.
// Requirement: WIRE-sequence-3
pub fn old_frames_never_count(mode: Mode, accepted: u8, old: [u8; 3]) -> Seen {
    let stale = |number| !is_fresh(Some(accepted), number);
    given!(table(mode).guarded && old.into_iter().all(stale));
    let len = table(mode).len;
    let setup = Setup::first_board(mode);
    let (mut pi, mut stm) = (PiLink::new(setup), StmLink::new(setup));
    let (there, back) = numbered(setup, accepted);
    assert!(stm.receive(&there[..len], 0, 1).is_ok());
    assert!(pi.receive(&back[..len]).is_ok());
    let old = old.map(|number| (number, numbered(setup, number)));
    for _ in 0..4 {
        for (_, (there, back)) in &old {
            assert!(stm.receive(&there[..len], 0, 1).is_err());
            assert!(pi.receive(&back[..len]).is_err());
        }
    }
    assert!(stm.counters().accepted == 1 && pi.counters().accepted == 1);
    let [(first, _), (second, _), (third, _)] = old;
    let upwards = |number: u8, next: u8| next == number.wrapping_add(1);
    Seen::NOTHING
        .case(0, first == second && second == third)
        .case(1, upwards(first, second) && first == third)
        .case(2, upwards(first, second) && upwards(second, third))
}

/// A frame with a wrong bit restarts no sequence: of four old frames that count upwards, one
/// of them disturbed, none is taken.
// Requirement: WIRE-sequence-3
pub fn disturbed_frame_never_counts(
    mode: Mode,
    accepted: u8,
    behind: u8,
    which: u8,
    bit: u8,
) -> Seen {
    let first = accepted.wrapping_sub(behind);
    let stale = |place| !is_fresh(Some(accepted), first.wrapping_add(place));
    given!(table(mode).guarded && which < 4 && (0..4).all(stale));
    let len = table(mode).len;
    given!(usize::from(bit) < 8 * len);
    let setup = Setup::first_board(mode);
    let (mut pi, mut stm) = (PiLink::new(setup), StmLink::new(setup));
    let (there, back) = numbered(setup, accepted);
    assert!(stm.receive(&there[..len], 0, 1).is_ok());
    assert!(pi.receive(&back[..len]).is_ok());
    for place in 0..4 {
        let (mut there, mut back) = numbered(setup, first.wrapping_add(place));
        if place == which {
            there[usize::from(bit / 8)] ^= 1 << (bit % 8);
            back[usize::from(bit / 8)] ^= 1 << (bit % 8);
        }
        assert!(stm.receive(&there[..len], 0, 1).is_err());
        assert!(pi.receive(&back[..len]).is_err());
    }
    seen!(usize::from(bit) >= 8 * (len - 2), bit / 8 == 1)
}

/// However the two ends stand to each other (one restarted, both, or any number of frames lost), after
/// five undisturbed exchanges each takes the other's frames.
// Requirement: WIRE-sequence-3, WIRE-sequence-7
pub fn ends_find_each_other(
    mode: Mode,
    pi_sent: u8,
    stm_accepted: u8,
    stm_sent: u8,
    pi_accepted: u8,
) -> Seen {
    given!(table(mode).guarded);
    let setup = Setup::first_board(mode);
    let (command, report) = (Command::default(), Report::default());
    let mut frame = [0; MAX_FRAME];
    let len = table(mode).len;
    let (mut pi, mut stm) = (PiLink::new(setup), StmLink::new(setup));
    // 0 = accepted nothing yet.
    let (there, _) = numbered(setup, stm_accepted);
    assert!(stm_accepted == 0 || stm.receive(&there[..len], 0, 1).is_ok());
    let (_, back) = numbered(setup, pi_accepted);
    assert!(pi_accepted == 0 || pi.receive(&back[..len]).is_ok());
    for _ in 0..pi_sent {
        let _ = pi.send(&command, &mut frame);
    }
    let mut taken = (false, false);
    let mut at_once = false;
    let mut late = false;
    for exchange in 0..EXCHANGES {
        let mut reply = [0; MAX_FRAME];
        let number = u32::from(stm_sent) + exchange + 1;
        let _ = stm.encode_reply(number, &report, &mut reply);
        let _ = pi.send(&command, &mut frame);
        taken.0 = stm.receive(&frame[..len], 0, 1).is_ok();
        taken.1 = pi.receive(&reply[..len]).is_ok();
        at_once |= exchange == 0 && taken == (true, true);
        late |= exchange == 2 && taken == (false, false);
    }
    assert!(taken == (true, true));
    Seen::NOTHING.case(0, at_once).case(1, late)
}

/// Undisturbed exchanges after which the ends understand each other.
pub const EXCHANGES: u32 = 5;

/// Every number of one end against every number that the other accepted last, in both directions, while
/// the way back is at rest, has carried nothing yet, wraps, was cut off for long, or comes to the last
/// number accepted within the row. What an end accepts depends on nothing that it sends, so no more
/// combinations matter.
#[cfg(test)]
fn encounters() -> impl Iterator<Item = (Mode, u8, u8, u8, u8)> {
    let ways_back = [
        (7, 7),
        (0, 0),
        (255, 0),
        (0, 255),
        (93, 218),
        (45, 81),
        (10, 14),
    ];
    let mode = Mode::GuardedTuneRotate;
    (0..=255).flat_map(move |sent| {
        (0..=255).flat_map(move |accepted| {
            ways_back
                .into_iter()
                .flat_map(move |(other, other_accepted)| {
                    [
                        (mode, sent, accepted, other, other_accepted),
                        (mode, other, other_accepted, sent, accepted),
                    ]
                })
        })
    })
}

/// Every old number after every number accepted, with every neighbour as the second and the third.
#[cfg(test)]
fn old_frames() -> impl Iterator<Item = (Mode, u8, [u8; 3])> {
    let near = [0, 1, 2, 255];
    (0..=255_u8).flat_map(move |accepted| {
        (0..=128_u8).flat_map(move |behind| {
            near.into_iter().flat_map(move |second| {
                near.into_iter().map(move |third| {
                    let old = accepted.wrapping_sub(behind);
                    let old = [old, old.wrapping_add(second), old.wrapping_add(third)];
                    (Mode::GuardedTuneRotate, accepted, old)
                })
            })
        })
    })
}

#[cfg(test)]
fn guarded_modes() -> impl Iterator<Item = Mode> {
    let guarded = |mode: &Mode| table(*mode).guarded;
    Mode::ALL.iter().copied().filter(guarded)
}

/// Every bit of every frame of a row, at both ends of what is old.
#[cfg(test)]
fn disturbed_rows() -> impl Iterator<Item = (Mode, u8, u8, u8, u8)> {
    guarded_modes().flat_map(|mode| {
        [0, 1, 200].into_iter().flat_map(move |accepted| {
            [4, 64, 128].into_iter().flat_map(move |behind| {
                (0..4).flat_map(move |which| {
                    (0..=255).map(move |bit| (mode, accepted, behind, which, bit))
                })
            })
        })
    })
}

#[cfg(test)]
fn repeats() -> impl Iterator<Item = (Mode, u8, u8)> {
    guarded_modes().flat_map(|mode| {
        (0..=255).flat_map(move |first| (0..128).map(move |between| (mode, first, between)))
    })
}

crate::properties! {
    theorem T8 ends_find_each_other(
        mode: Mode, pi_sent: u8, stm_accepted: u8, stm_sent: u8, pi_accepted: u8
    ) {
        cases ["at once", "after three stale frames each"];
        exhaustive encounters();
    }
    theorem T8 old_frames_never_count(mode: Mode, accepted: u8, old: [u8; 3]) {
        cases ["the same again and again", "two in turn", "three that count upwards"];
        exhaustive old_frames();
    }
    theorem T8 disturbed_frame_never_counts(mode: Mode, accepted: u8, behind: u8, which: u8, bit: u8) {
        cases ["in the checksum", "in the number"];
        exhaustive disturbed_rows();
    }
    theorem T8 repeated_frame_is_stale(mode: Mode, first: u8, between: u8) {
        cases ["at once", "as late as the numbers allow"];
        exhaustive repeats();
    }
}

#[cfg(test)]
mod tests {
    //! What the drivers above leave out, up to the symmetries that are checked here.

    use super::*;
    use fw_core::wire::{parse_command, parse_report};

    /// Every guarded mode with every two numbers.
    fn numbers() -> impl Iterator<Item = (Mode, u8, u8)> {
        let pairs =
            |mode| (0..=255).flat_map(move |one| (0..=255).map(move |two| (mode, one, two)));
        guarded_modes().flat_map(pairs)
    }

    /// Whether both ends accept a frame after `last`.
    fn accepts(setup: Setup, last: Option<u8>, there: &[u8], back: &[u8]) -> bool {
        let context = Context {
            last,
            ..setup.context()
        };
        let there = parse_command(setup.mode, &context, there, 0).is_ok();
        assert_eq!(there, parse_report(setup.mode, &context, back, 0).is_ok());
        there
    }

    /// The ways there and back are independent: whatever a frame acknowledges, its own number decides.
    #[test]
    fn frame_is_accepted_by_its_own_number_alone() {
        for (mode, own, seen) in numbers() {
            let (setup, len) = (Setup::first_board(mode), table(mode).len);
            let context = Context {
                own,
                last: Some(seen),
                ..setup.context()
            };
            let (mut there, mut back) = ([0; MAX_FRAME], [0; MAX_FRAME]);
            let _ = write_command(mode, &context, &Command::default(), &mut there);
            let _ = write_report(mode, &context, &Report::default(), &mut back);
            for last in [None, Some(seen), Some(seen.wrapping_add(own))] {
                let accepted = accepts(setup, last, &there[..len], &back[..len]);
                assert_eq!(
                    accepted,
                    is_fresh(last, own),
                    "{mode:?}: {own} after {last:?}"
                );
            }
        }
    }

    /// So each way alone is all of [`ends_find_each_other`].
    #[test]
    fn ends_find_each_other_in_every_mode() {
        for (mode, sent, accepted) in numbers() {
            let _ = ends_find_each_other(mode, sent, accepted, sent, accepted);
        }
    }

    /// A frame with any wrong bit is rejected even as a sender's first: it counts in no row.
    #[test]
    fn disturbed_frame_is_no_first() {
        for (mode, number, bit) in numbers() {
            let (setup, len) = (Setup::first_board(mode), table(mode).len);
            let (mut there, mut back) = numbered(setup, number);
            let at = usize::from(bit / 8);
            if at < len {
                there[at] ^= 1 << (bit % 8);
                back[at] ^= 1 << (bit % 8);
                assert!(!accepts(setup, None, &there[..len], &back[..len]));
            }
        }
    }

    /// So one bit a row is all of [`disturbed_frame_never_counts`].
    #[test]
    fn disturbed_frame_never_counts_in_any_row() {
        for (mode, accepted, behind) in numbers() {
            for which in 0..4 {
                let bit = accepted.wrapping_add(behind) % 144;
                let _ = disturbed_frame_never_counts(mode, accepted, behind, which, bit);
            }
        }
    }

    /// How far the three are behind the number accepted decides: all of that, with modes and numbers in turn.
    #[test]
    fn old_frames_never_count_however_old() {
        let modes: Vec<_> = guarded_modes().collect();
        let mut turns = modes.iter().cycle().zip((0..=255).cycle());
        let two = || (0..=128).flat_map(|one| (0..=128).map(move |two| (one, two)));
        for ((second, third), first) in
            (0..=128).flat_map(|first| two().map(move |rest| (rest, first)))
        {
            if let Some((&mode, accepted)) = turns.next() {
                let old = [first, second, third].map(|behind| u8::wrapping_sub(accepted, behind));
                let _ = old_frames_never_count(mode, accepted, old);
            }
        }
    }
}

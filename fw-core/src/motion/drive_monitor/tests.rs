//! Where each fault begins, to the count, the tick and the hundredth of a percent.

use super::*;
use crate::eeprom::first_board;

/// A wheel of the first board: which of a pair is it?
#[derive(Clone, Copy, Debug)]
enum Side {
    Left,
    Right,
}

use crate::types::Duty;
use Side::{Left, Right};

/// What the bridges are told where one wheel shall go forward with so many hundredths of a percent beyond
/// its dead zone, backwards if they are negative, and the other is braked.
fn told(side: Side, beyond: i16) -> MotorCommands {
    let platform = first_board().platform;
    let (dead_zone, reversed) = match side {
        Left => (platform.dead_zone_left, platform.motor_left_reversed),
        Right => (platform.dead_zone_right, platform.motor_right_reversed),
    };
    let duty = i32::from(beyond) + i32::from(dead_zone) * i32::from(beyond.signum());
    let run = MotorCommand::Run(Duty::saturating(if reversed { -duty } else { duty }));
    let mut wheels = MotorCommands::BRAKE;
    match side {
        Left => wheels.left = run,
        Right => wheels.right = run,
    }
    wheels
}

fn rolled(side: Side, counts: i32) -> Delta {
    let mut delta = Delta::default();
    match side {
        Left => delta.left = counts,
        Right => delta.right = counts,
    }
    delta
}

/// What is said of each of so many ticks: which one, and the fault. The wheel rolls `counts` in the tick
/// after each of them, and stands otherwise.
fn said(side: Side, beyond: i16, counts: i32, ticks: usize) -> std::vec::Vec<(usize, Faults)> {
    let mut watch = DriveMonitor::new(&first_board().platform);
    let mut said = std::vec::Vec::new();
    let mut rolls = 0;
    for tick in 0..ticks {
        let faults = watch.step(&told(side, beyond), &rolled(side, rolls));
        rolls = 0;
        if !faults.is_empty() {
            said.push((tick, faults));
            rolls = counts;
        }
    }
    said
}

const fn stalled(side: Side) -> Faults {
    match side {
        Left => Faults::LEFT_STALLED,
        Right => Faults::RIGHT_STALLED,
    }
}

const fn reversed(side: Side) -> Faults {
    match side {
        Left => Faults::LEFT_REVERSED,
        Right => Faults::RIGHT_REVERSED,
    }
}

#[test]
fn a_wheel_that_stands_is_noticed_either_way_and_again_every_window() {
    for side in [Left, Right] {
        for beyond in [5000, -5000] {
            let said = said(side, beyond, 0, 300);
            let (first, _) = said[0];
            assert!((60..=90).contains(&first), "{side:?} {beyond}: {first}");
            for (number, &(tick, faults)) in said.iter().enumerate() {
                assert_eq!(tick, first + number * usize::from(WINDOW));
                assert_eq!(faults, stalled(side), "{side:?} {beyond}");
            }
        }
    }
}

#[test]
fn a_wheel_turns_from_a_128th_of_a_turn_on_and_wrongly_from_as_much_the_other_way() {
    let least = i32::from(first_board().platform.counts_per_turn) / 128;
    assert!(least > 2);
    for side in [Left, Right] {
        for way in [1, -1] {
            let second = |counts: i32| {
                let said = said(side, 5000 * way, counts * i32::from(way), 150);
                said.get(1).map(|&(_, faults)| faults)
            };
            assert_eq!(second(least), None, "{side:?} {way}");
            assert_eq!(second(least - 1), Some(stalled(side)), "{side:?} {way}");
            assert_eq!(second(1 - least), Some(stalled(side)), "{side:?} {way}");
            assert_eq!(second(-least), Some(reversed(side)), "{side:?} {way}");
        }
    }
}

#[test]
fn a_wheel_must_turn_from_20_percent_beyond_its_dead_zone_on() {
    // Backwards, for the lags reach a negative duty to the last bit.
    for side in [Left, Right] {
        assert!(!said(side, -2000, 0, 600).is_empty(), "{side:?}");
        assert!(said(side, -1999, 0, 600).is_empty(), "{side:?}");
        assert!(said(side, 1999, 0, 600).is_empty(), "{side:?}");
    }
}

#[test]
fn a_jump_is_more_than_a_tenth_of_a_turn_in_a_tick_of_either_wheel_either_way() {
    let most = i32::from(first_board().platform.counts_per_turn) / 10;
    for side in [Left, Right] {
        for way in [1, -1] {
            let faults = |counts: i32| {
                let mut watch = DriveMonitor::new(&first_board().platform);
                watch.step(&MotorCommands::BRAKE, &rolled(side, counts * way))
            };
            assert_eq!(faults(most), Faults::NONE, "{side:?}");
            assert_eq!(faults(most + 1), Faults::ENCODER_JUMP, "{side:?}");
        }
    }
}

#[test]
fn a_brake_begins_everything_anew() {
    let mut watch = DriveMonitor::new(&first_board().platform);
    let stands = Delta::default();
    for round in 0..20 {
        for tick in 0..59 {
            assert_eq!(
                watch.step(&told(Left, 5000), &stands),
                Faults::NONE,
                "{round} {tick}"
            );
        }
        assert_eq!(watch.step(&MotorCommands::BRAKE, &stands), Faults::NONE);
    }
}

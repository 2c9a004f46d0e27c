//! Threshold of each fault, to the count, the tick and the hundredth of a percent.

use super::*;
use crate::eeprom::{config_with, fields, first_board};
use crate::types::Duty;
use std::vec::Vec;

#[derive(Clone, Copy, Debug)]
enum Side {
    Left,
    Right,
}

use Side::{Left, Right};

/// Ticks over which a wheel is judged that may be driven by 25 % or more beyond its dead zone.
const WINDOW_TICKS: usize = 50;

impl Side {
    const fn stalled(self) -> Faults {
        [Faults::LEFT_STALLED, Faults::RIGHT_STALLED][self as usize]
    }

    const fn reversed(self) -> Faults {
        [Faults::LEFT_REVERSED, Faults::RIGHT_REVERSED][self as usize]
    }

    /// Drives this wheel by hundredths of a percent beyond its dead zone and brakes the other.
    fn driven(self, beyond: i16) -> MotorCommands {
        let config = first_board();
        let mut commands = MotorCommands::BRAKE;
        let (command, wheel) = match self {
            Left => (&mut commands.left, config.left()),
            Right => (&mut commands.right, config.right()),
        };
        let dead_zone = i32::from(wheel.dead_zone.hundredths());
        let duty = i32::from(beyond) + dead_zone * i32::from(beyond.signum());
        let duty = if wheel.motor_reversed { -duty } else { duty };
        *command = MotorCommand::Run(Duty::saturating(duty));
        commands
    }

    fn rolled(self, counts: i32) -> Delta {
        match self {
            Left => Delta::rolled(counts, 0),
            Right => Delta::rolled(0, counts),
        }
    }
}

fn monitor() -> DriveMonitor {
    DriveMonitor::new(&first_board())
}

/// Ticks and faults of a wheel that rolls `counts` in the tick after each fault, and else stands.
fn faults(side: Side, beyond: i16, counts: i32, ticks: usize) -> Vec<(usize, Faults)> {
    let mut monitor = monitor();
    let (mut found, mut rolls) = (Vec::new(), 0);
    for tick in 0..ticks {
        let faults = monitor.step(&side.driven(beyond), &side.rolled(rolls));
        rolls = 0;
        if !faults.is_empty() {
            found.push((tick, faults));
            rolls = counts;
        }
    }
    found
}

#[test]
fn standing_wheel_is_stalled_every_window() {
    for side in [Left, Right] {
        for beyond in [5000, -5000] {
            let found = faults(side, beyond, 0, 300);
            let (first, _) = found[0];
            assert!((60..=90).contains(&first), "{side:?} {beyond}: {first}");
            for (number, &(tick, faults)) in found.iter().enumerate() {
                assert_eq!(tick, first + number * WINDOW_TICKS);
                assert_eq!(faults, side.stalled(), "{side:?} {beyond}");
            }
        }
    }
}

#[test]
fn wheel_turns_from_a_128th_of_a_turn() {
    let least = i32::from(first_board().counts_per_turn()) / 128;
    assert!(least > 2);
    for side in [Left, Right] {
        for way in [1, -1] {
            for (counts, fault) in [
                (least, None),
                (least - 1, Some(side.stalled())),
                (1 - least, Some(side.stalled())),
                (-least, Some(side.reversed())),
            ] {
                let case = std::format!("{side:?} {way} {counts}");
                let rolls = counts * i32::from(way);
                let found = faults(side, 5000 * way, rolls, 150);
                let second = found.get(1).map(|&(_, faults)| faults);
                assert_eq!(second, fault, "{case}");
                // In the first window, too.
                let (first, _) = found[0];
                let mut monitor = monitor();
                let turn = |tick| {
                    let rolls = if tick == first - 1 { rolls } else { 0 };
                    monitor.step(&side.driven(5000 * way), &side.rolled(rolls))
                };
                let ends = (0..=first).map(turn).last().unwrap();
                assert_eq!(ends, fault.unwrap_or(Faults::NONE), "{case}");
            }
        }
    }
}

#[test]
fn coarse_encoder_stands_below_two_counts() {
    // A 128th of its turn is less than a count.
    let config = config_with(&[(fields::COUNTS_PER_TURN, 100)]);
    let stalled = Faults::LEFT_STALLED;
    for (counts, expected) in [(0, stalled), (1, stalled), (2, Faults::NONE)] {
        let mut monitor = DriveMonitor::new(&config);
        let mut found = Faults::NONE;
        for tick in 0..300 {
            let rolled = if tick % 50 == 0 { counts } else { 0 };
            found |= monitor.step(&Left.driven(5000), &Left.rolled(rolled));
        }
        assert_eq!(found, expected, "{counts}");
    }
}

#[test]
fn pause_or_weak_drive_restarts_the_window() {
    for side in [Left, Right] {
        let (first, _) = faults(side, 5000, 0, 100)[0];
        let window = WINDOW_TICKS - 1;
        for (pause, due) in [(MotorCommands::BRAKE, first), (side.driven(1000), window)] {
            let mut monitor = monitor();
            let turning = core::iter::repeat_n(side.driven(5000), first).chain([pause]);
            for commands in turning {
                assert_eq!(monitor.step(&commands, &side.rolled(10)), Faults::NONE);
            }
            let mut stands = || monitor.step(&side.driven(5000), &side.rolled(0));
            let stalled = (0..200).find(|_| stands() == side.stalled());
            assert_eq!(stalled, Some(due), "{side:?}");
        }
    }
}

#[test]
fn narrow_headroom_lengthens_the_window() {
    let dead_zone = first_board().left().dead_zone.hundredths();
    // Hundredths of a percent between dead zone and limit, of which the second part is judged and the third not;
    // ticks of a window.
    for (headroom, judged, idle, window) in [
        (2510, 2001, 1999, 50),
        (2500, 1993, 1992, 51),
        (1250, 997, 996, 101),
        (100, 80, 79, 1255),
        (1, 1, 0, 125_491),
    ] {
        let limit = u64::from((dead_zone + headroom).unsigned_abs());
        let config = config_with(&[(fields::LIMIT_LEFT, limit)]);
        let least = i32::from(config.counts_per_turn()) / 128;
        let run = |beyond, counts: i32, ticks: usize| {
            let mut monitor = DriveMonitor::new(&config);
            let mut step = |counts| monitor.step(&Left.driven(beyond), &Left.rolled(counts));
            // The first fault ends the lags' time.
            let settled = (0..200_000).find(|_| !step(0).is_empty())?;
            let mut after = (0..ticks).map(|tick| step(if tick == 0 { counts } else { 0 }));
            Some((settled, after.position(|faults| !faults.is_empty())))
        };
        let (first, again) = run(judged, 0, window).unwrap_or_default();
        assert!(first >= window, "{headroom}: {first}");
        assert_eq!(again, Some(window - 1), "{headroom}");
        let turned = run(judged, least, window).unwrap_or_default();
        assert_eq!(turned, (first, None), "{headroom}");
        assert_eq!(run(idle, 0, 1), None, "{headroom}");
    }
}

#[test]
fn encoder_jumps_beyond_a_tenth_of_a_turn_either_way() {
    let most = i32::from(first_board().counts_per_turn()) / 10;
    for side in [Left, Right] {
        for way in [1, -1] {
            for (counts, fault) in [(most, Faults::NONE), (most + 1, Faults::ENCODER_JUMP)] {
                let rolled = side.rolled(counts * way);
                let found = monitor().step(&MotorCommands::default(), &rolled);
                assert_eq!(found, fault, "{side:?} {way} {counts}");
            }
        }
    }
}

//! Time-out, statistics, invalidation and temperature; schedule, edges and widths are properties in
//! `proofs`.

use super::*;
use RangefinderId::{Front, Left, Right};
use std::vec::Vec;

const TICK: u32 = 10_000;
const AHEAD: Option<u16> = Some(0);

/// The front sensor, triggered at `at`.
fn triggered(at: Micros) -> Rangefinders {
    let mut rangefinders = Rangefinders::new(1);
    assert_eq!(rangefinders.tick(at, AHEAD, false), Some(Front));
    rangefinders
}

#[test]
fn missing_echo_times_out_at_20_ms_before_its_cause_is_known() {
    for (answers, last, expected) in [
        (true, Echo::OutOfRange, (1, 1, 0)),
        (false, Echo::Missing, (1, 0, 1)),
    ] {
        let mut rangefinders = triggered(Micros(0));
        rangefinders.echo(Front, Micros(500), Micros(5_500));
        let mut seen = Vec::new();
        for k in 1..=12 {
            rangefinders.tick(Micros(k * TICK), AHEAD, false);
            if k == 10 && answers {
                // A US-015 without an echo lowers its line after 38 ms.
                rangefinders.echo(Front, Micros(60_500), Micros(98_500));
            }
            seen.push(rangefinders.reading(Front).echo);
        }
        let measured = |echo: &Echo| matches!(echo, Echo::Distance(_));
        assert!(seen[..7].iter().all(measured));
        assert_eq!(seen[7..9], [Echo::TimedOut; 2]);
        assert_eq!(seen[11], last);
        let stats = rangefinders.stats(Front);
        assert_eq!((stats.hits, stats.out_of_range, stats.missing), expected);
        assert_eq!(stats.consecutive_misses, u8::from(!answers));
    }
}

#[test]
fn silent_sensor_is_followed_a_tick_later_and_answers_once() {
    for (answers, expected) in [(true, 2), (false, 3)] {
        let mut rangefinders = Rangefinders::new(3);
        let ticks = (0..60).filter(|k| {
            let now = Micros(k * TICK);
            let trigger = rangefinders.tick(now, AHEAD, false);
            if let Some(which) = trigger.filter(|_| answers) {
                for fall in [5_500, 4_500] {
                    rangefinders.echo(which, now.after(500), now.after(fall));
                }
            }
            trigger.is_some()
        });
        let ticks: Vec<_> = ticks.collect();
        assert!(ticks.windows(2).all(|two| two[1] - two[0] == expected));
        let distance = rangefinders.distance(Front).map(|mm| mm.0.to_num::<i32>());
        assert_eq!(distance, answers.then_some(857));
    }
}

// Requirement: WIRE-log-9
#[test]
fn echo_from_beyond_the_range_counts_behind_the_next_trigger() {
    let mut rangefinders = Rangefinders::new(3);
    let mut falls = Vec::new();
    for k in 0..60 {
        let now = Micros(k * TICK);
        falls.retain(|&(which, rise, fall)| {
            let due = now.since(fall) < 1 << 31;
            if due {
                rangefinders.echo(which, rise, fall);
            }
            !due
        });
        if let Some(which) = rangefinders.tick(now, AHEAD, false) {
            falls.push((which, now.after(500), now.after(38_500)));
        }
    }
    for which in RangefinderId::ALL {
        let stats = rangefinders.stats(which);
        assert!(stats.out_of_range >= 6 && stats.missing == 0, "{stats:?}");
    }
}

// Requirement: WIRE-servo-1
#[test]
fn invalidate_discards_readings_and_pending_triggers() {
    for measured in [true, false] {
        let mut rangefinders = triggered(Micros(0));
        if measured {
            rangefinders.echo(Front, Micros(500), Micros(5_500));
            assert_eq!(rangefinders.take_updated(), Some(Front));
        }
        assert_eq!(rangefinders.take_updated(), None);
        rangefinders.invalidate();
        rangefinders.echo(Front, Micros(500), Micros(5_500));
        assert_eq!(rangefinders.reading(Front).echo, Echo::NotMeasured);
        let updated = [(); 4].map(|()| rangefinders.take_updated());
        assert_eq!(updated, [Some(Front), Some(Right), Some(Left), None]);
    }
}

#[test]
fn distance_follows_the_temperature_from_40_below_to_85() {
    for celsius in -50..=95 {
        let mut rangefinders = triggered(Micros(0));
        rangefinders.set_temperature(Some(I16F16::from_num(celsius)));
        rangefinders.echo(Front, Micros(500), Micros(10_500));
        let distance = rangefinders.distance(Front).unwrap().0.to_num::<f64>();
        let speed = 331.3 + 0.606 * f64::from(celsius.clamp(-40, 85));
        assert!((distance - speed * 5.0).abs() < 0.01, "{celsius}");
    }
}

#[test]
fn edges_of_no_echo_are_ignored() {
    let start = Micros(7 * TICK);
    let before = Micros(start.0 - 500);
    let late = start.after(MAX_RISE_DELAY + 1);
    for (rise, fall) in [
        (before, start.after(5_000)),
        (late, late.after(4_999)),
        (start.after(500), start.after(500 + (1 << 20) + 1)),
    ] {
        let mut rangefinders = triggered(start);
        rangefinders.echo(Front, rise, fall);
        assert_eq!(rangefinders.reading(Front).echo, Echo::NotMeasured);
        rangefinders.echo(Front, start.after(500), start.after(5_500));
        let echo = rangefinders.reading(Front).echo;
        assert!(matches!(echo, Echo::Distance(_)));
    }
}

#[test]
fn counts_beyond_their_type_stay_at_its_end() {
    let most = EchoStats {
        missing: u32::MAX,
        consecutive_misses: u8::MAX,
        ..EchoStats::default()
    };
    let mut stats = most;
    stats.count(Echo::Missing);
    assert_eq!(stats, most);
}

#[test]
fn answer_from_beyond_the_range_ends_the_run_of_misses() {
    for (echo, misses) in [
        (Echo::Missing, 4),
        (Echo::TimedOut, 3),
        (Echo::OutOfRange, 0),
    ] {
        let mut stats = EchoStats {
            consecutive_misses: 3,
            ..EchoStats::default()
        };
        stats.count(echo);
        assert_eq!(stats.consecutive_misses, misses, "{echo:?}");
    }
}

#[test]
fn missing_echo_has_the_bearing_of_its_trigger() {
    let mut rangefinders = Rangefinders::new(1);
    assert_eq!(rangefinders.tick(Micros(0), Some(100), false), Some(Front));
    for k in 1..=6 {
        let _ = rangefinders.tick(Micros(k * TICK), Some(200), false);
    }
    let Reading { echo, bearing } = rangefinders.reading(Front);
    assert_eq!((echo, bearing), (Echo::Missing, 100));
}

// Requirement: WIRE-bearing-2
#[test]
fn front_sensor_waits_for_its_bearing_and_the_sides_do_not() {
    let mut rangefinders = Rangefinders::new(3);
    let mut tick = 0;
    let mut triggered_within = |ticks: u32, bearing| {
        (0..ticks).find_map(|_| {
            tick += 1;
            rangefinders.tick(Micros(tick * TICK), bearing, true)
        })
    };
    for _ in 0..2 {
        assert_eq!(triggered_within(20, None), None);
        assert_eq!(triggered_within(1, AHEAD), Some(Front));
        assert_eq!(triggered_within(3, None), Some(Right));
        assert_eq!(triggered_within(3, None), Some(Left));
    }
}

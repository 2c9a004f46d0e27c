//! Schedule and edges; widths and statistics over all inputs are properties in `proofs`.

use super::*;
use std::vec::Vec;
use RangefinderId::{Front, Left, Right};

const TICK: u32 = 10_000;
const AHEAD: Option<u16> = Some(0);

/// The front sensor, triggered at `at`.
fn triggered(at: Micros) -> Rangefinders {
    let mut rangefinders = Rangefinders::new(1);
    assert_eq!(rangefinders.tick(at, AHEAD), Some(Front));
    rangefinders
}

/// Tick and sensor of each trigger in 6 s.
fn triggers(count: u8, answers: bool) -> Vec<(u32, RangefinderId)> {
    let mut rangefinders = Rangefinders::new(count);
    let mut all = Vec::new();
    for k in 0..600 {
        let now = Micros(k * TICK);
        if let Some(which) = rangefinders.tick(now, AHEAD) {
            all.push((k, which));
            if answers {
                // From 2.5 m, with the largest delay.
                rangefinders.echo(which, now.after(3_000), now.after(3_000 + 14_577));
            }
        }
    }
    all
}

#[test]
fn sensors_take_turns_in_their_slots() {
    assert!(triggers(0, true).is_empty());
    for (count, answered, timed_out) in [(1, 6, 6), (2, 3, 3), (3, 2, 3)] {
        for (answers, slot) in [(true, answered), (false, timed_out)] {
            let all = triggers(count, answers);
            assert!(all.windows(2).all(|w| w[1].0 - w[0].0 == slot), "{count}");
            let turns = [Front, Right, Left];
            for (n, &(_, which)) in all.iter().enumerate() {
                assert_eq!(which, turns[n % usize::from(count)]);
            }
        }
    }
}

#[test]
fn unknown_bearing_defers_the_trigger() {
    let mut rangefinders = Rangefinders::new(3);
    for k in 0..20 {
        assert_eq!(rangefinders.tick(Micros(k * TICK), None), None);
    }
    let now = Micros(20 * TICK);
    assert_eq!(rangefinders.tick(now, Some(0x1234)), Some(Front));
    rangefinders.echo(Front, now.after(500), now.after(5_500));
    assert_eq!(rangefinders.reading(Front).bearing, 0x1234);
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
            rangefinders.tick(Micros(k * TICK), AHEAD);
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

// Requirement: WIRE-distance-1
#[test]
fn edges_that_no_trigger_explains_are_ignored() {
    let at = Micros(u32::MAX - 2_000);
    for (rise, fall, echo) in [
        // Both before the trigger; the rise before it; the fall before the rise.
        (-9_000, -3_000, Echo::NotMeasured),
        (-1, 5_000, Echo::NotMeasured),
        (700, 699, Echo::NotMeasured),
        // Later than 3 ms, longer than 2²⁰ µs.
        (3_001, 10_000, Echo::NotMeasured),
        (500, 500 + 1_048_577, Echo::NotMeasured),
        (500, 500 + 1_048_576, Echo::OutOfRange),
    ] {
        let mut rangefinders = triggered(at);
        let time = |offset: i32| Micros(at.0.wrapping_add_signed(offset));
        rangefinders.echo(Front, time(rise), time(fall));
        assert_eq!(rangefinders.reading(Front).echo, echo, "{rise} {fall}");
        if echo == Echo::NotMeasured {
            // The right edges still count, across the clock's wrap.
            rangefinders.echo(Front, time(3_000), time(9_000));
            assert!(rangefinders.distance(Front).is_some());
        }
        // One trigger gives one reading, and none gives none.
        let first = rangefinders.reading(Front).echo;
        rangefinders.echo(Front, time(500), time(2_500));
        rangefinders.echo(Left, time(500), time(1_500));
        assert_eq!(rangefinders.reading(Front).echo, first);
        assert_eq!(rangefinders.reading(Left).echo, Echo::NotMeasured);
    }
}

#[test]
fn silent_sensor_is_missing_after_a_cycle_and_recovers() {
    let mut rangefinders = Rangefinders::new(3);
    for k in 0..60u32 {
        let now = Micros(k * TICK);
        if let Some(which) = rangefinders.tick(now, AHEAD) {
            if which != Right || k >= 30 {
                rangefinders.echo(which, now.after(600), now.after(6_600));
            }
        }
        let echo = rangefinders.reading(Right).echo;
        match k {
            0..2 => assert_eq!(echo, Echo::NotMeasured),
            10..30 => assert!(matches!(echo, Echo::TimedOut | Echo::Missing), "{k}"),
            38.. => assert!(rangefinders.distance(Right).is_some()),
            _ => {}
        }
    }
}

//! Every width, every schedule, every edge that is not the sensor's.

extern crate std;

use super::*;
use std::vec::Vec;
use RangefinderId::{Front, Left, Right};

const TICK: u32 = 10_000;
const AHEAD: Option<u16> = Some(0);

fn triggers(count: u8, ticks: u32) -> Vec<(u32, RangefinderId)> {
    let mut rangefinders = Rangefinders::new(count);
    (0..ticks)
        .filter_map(|k| Some((k, rangefinders.tick(Micros(k * TICK), AHEAD)?)))
        .collect()
}

/// One that has just been triggered at `at`.
fn triggered(at: Micros) -> Rangefinders {
    let mut rangefinders = Rangefinders::new(1);
    assert_eq!(rangefinders.tick(at, AHEAD), Some(Front));
    rangefinders
}

fn measured(width: u32) -> Echo {
    let mut rangefinders = triggered(Micros(0));
    rangefinders.echo(Front, Micros(500), Micros(500).after(width));
    rangefinders.reading(Front).echo
}

#[test]
fn they_take_turns_and_each_measures_every_60_ms_while_they_answer() {
    for count in 1..=3u8 {
        let mut rangefinders = Rangefinders::new(count);
        let mut all = Vec::new();
        for k in 0..600 {
            let now = Micros(k * TICK);
            if let Some(which) = rangefinders.tick(now, AHEAD) {
                all.push((k, which));
                // From 2.5 m, as late as can be.
                rangefinders.echo(which, now.after(3_000), now.after(3_000 + 14_577));
            }
        }
        for which in [Front, Right, Left].into_iter().take(usize::from(count)) {
            let own: Vec<u32> = all.iter().filter(|t| t.1 == which).map(|t| t.0).collect();
            assert!(own.len() == 100, "{count} {which:?} {}", own.len());
            assert!(own.windows(2).all(|w| w[1] - w[0] == 6));
        }
        let apart = u32::from(6 / count);
        assert!(all.windows(2).all(|w| w[1].0 - w[0].0 == apart));
    }
    assert!(triggers(0, 600).is_empty());
}

#[test]
fn where_nothing_answers_the_next_one_waits_until_no_echo_can_be_on_its_way() {
    for (count, slot) in [(1, 6), (2, 3), (3, 3)] {
        let all = triggers(count, 600);
        assert!(all.windows(2).all(|w| w[1].0 - w[0].0 == slot), "{count}");
    }
}

#[test]
fn a_sensor_that_may_not_be_triggered_is_not_and_the_others_wait() {
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
fn what_nothing_answers_is_late_at_20_ms_and_out_of_range_or_missing_later() {
    for answers in [true, false] {
        let mut rangefinders = triggered(Micros(0));
        rangefinders.echo(Front, Micros(500), Micros(5_500));
        let mut seen = Vec::new();
        for k in 1..=12 {
            let now = Micros(k * TICK);
            rangefinders.tick(now, AHEAD);
            if k == 10 && answers {
                // A US-015 that hears nothing lets go after 38 ms.
                rangefinders.echo(Front, Micros(60_500), Micros(98_500));
            }
            seen.push(rangefinders.reading(Front).echo);
        }
        assert!(seen[..7]
            .iter()
            .all(|echo| matches!(echo, Echo::Distance(_))));
        assert_eq!(seen[7..9], [Echo::TimedOut; 2]);
        let last = if answers {
            Echo::OutOfRange
        } else {
            Echo::Missing
        };
        assert_eq!(seen[11], last);
        let stats = rangefinders.stats(Front);
        let told = if answers { (1, 1, 0) } else { (1, 0, 1) };
        assert_eq!((stats.hits, stats.out_of_range, stats.missing), told);
    }
}

// Requirement: WIRE-servo-1
#[test]
fn nobody_knowing_where_they_point_takes_every_reading_back() {
    let mut rangefinders = triggered(Micros(0));
    rangefinders.echo(Front, Micros(500), Micros(5_500));
    rangefinders.invalidate();
    assert_eq!(rangefinders.reading(Front).echo, Echo::NotMeasured);
    let mut rangefinders = triggered(Micros(0));
    rangefinders.invalidate();
    rangefinders.echo(Front, Micros(500), Micros(5_500));
    assert_eq!(
        rangefinders.reading(Front).echo,
        Echo::NotMeasured,
        "on its way then"
    );
}

#[test]
fn every_width_is_a_distance_within_a_thousandth_of_a_millimetre_or_says_why_not() {
    let mut last = I32F32::ZERO;
    for width in 0..70_000u32 {
        let truth = f64::from(width) * 0.1715;
        match measured(width) {
            Echo::Distance(Millimetres(d)) => {
                assert!(width >= SHORTEST && truth <= 2500.0, "{width}");
                assert!((d.to_num::<f64>() - truth).abs() < 1e-3, "{width} {d}");
                assert!(d > last, "monotone");
                last = d;
            }
            Echo::OutOfRange => assert!(truth > 2499.999, "{width}"),
            Echo::Missing => assert!(width < SHORTEST, "{width}"),
            Echo::NotMeasured | Echo::TimedOut => panic!("{width}"),
        }
    }
}

#[test]
fn warm_air_carries_sound_faster() {
    let mut rangefinders = triggered(Micros(0));
    rangefinders.set_temperature(Some(I16F16::from_num(30)));
    rangefinders.echo(Front, Micros(500), Micros(10_500));
    let distance = rangefinders.distance(Front).unwrap().0.to_num::<f64>();
    assert!((distance - 1747.4).abs() < 0.01, "{distance}");
}

#[test]
fn sound_is_taken_at_what_the_air_carries_it_from_40_below_to_85_above() {
    let mut rangefinders = Rangefinders::new(1);
    for celsius in -50..=95 {
        let now = Micros(100_000).after((celsius + 50) as u32 * 6 * TICK);
        let trigger = (0..6).find_map(|k| {
            let now = now.after(k * TICK);
            rangefinders.tick(now, AHEAD).map(|_| now)
        });
        let rise = trigger.expect("once in 60 ms").after(500);
        rangefinders.set_temperature(Some(I16F16::from_num(celsius)));
        rangefinders.echo(Front, rise, rise.after(10_000));
        let distance = rangefinders.distance(Front).unwrap().0.to_num::<f64>();
        // Half of 10 ms of way; beyond the ends the air is taken to be as warm as there.
        let speed = 331.3 + 0.606 * f64::from(celsius.clamp(-40, 85));
        assert!(
            (distance - speed * 5.0).abs() < 0.01,
            "{celsius}: {distance}"
        );
    }
}

#[test]
fn each_that_has_news_is_named_once_the_front_one_first() {
    let mut rangefinders = Rangefinders::new(3);
    assert_eq!(rangefinders.take_updated(), None);
    let mut named = Vec::new();
    rangefinders.invalidate();
    for _ in 0..4 {
        named.push(rangefinders.take_updated());
    }
    assert_eq!(named, [Some(Front), Some(Right), Some(Left), None]);
}

#[test]
fn an_echo_may_begin_up_to_3_ms_after_its_trigger() {
    let mut rangefinders = triggered(Micros(0));
    rangefinders.echo(Front, Micros(3_001), Micros(8_001));
    assert_eq!(rangefinders.distance(Front), None);
    rangefinders.echo(Front, Micros(3_000), Micros(8_000));
    assert!(rangefinders.distance(Front).is_some());
}

#[test]
fn an_echo_may_last_up_to_a_second_and_says_then_that_nothing_is_in_range() {
    // 2²⁰ µs.
    let mut rangefinders = triggered(Micros(0));
    rangefinders.echo(Front, Micros(500), Micros(500 + 1_048_577));
    assert_eq!(rangefinders.reading(Front).echo, Echo::NotMeasured);
    rangefinders.echo(Front, Micros(500), Micros(500 + 1_048_576));
    assert_eq!(rangefinders.reading(Front).echo, Echo::OutOfRange);
}

#[test]
fn a_sensor_that_does_not_answer_is_missing_after_a_cycle_and_comes_back() {
    let mut rangefinders = Rangefinders::new(3);
    assert_eq!(rangefinders.reading(Right).echo, Echo::NotMeasured);
    for k in 0..60u32 {
        let now = Micros(k * TICK);
        let answers = k >= 30;
        if let Some(which) = rangefinders.tick(now, AHEAD) {
            if which != Right || answers {
                rangefinders.echo(which, now.after(600), now.after(6_600));
            }
        }
        if (10..30).contains(&k) {
            let echo = rangefinders.reading(Right).echo;
            assert!(
                matches!(echo, Echo::TimedOut | Echo::Missing),
                "{k} {echo:?}"
            );
            assert_eq!(rangefinders.distance(Right), None);
        }
        if k > 37 {
            assert!(rangefinders.distance(Right).is_some());
        }
    }
}

// Requirement: WIRE-distance-1
#[test]
fn an_edge_of_another_trigger_never_becomes_a_distance() {
    let at = Micros(u32::MAX - 2_000);
    for (rise, fall) in [
        // Both before the trigger; the rise before it; the fall before the rise; far too late.
        (at.0.wrapping_sub(9_000), at.0.wrapping_sub(3_000)),
        (at.0.wrapping_sub(1), at.0.wrapping_add(5_000)),
        (at.0.wrapping_add(700), at.0.wrapping_add(699)),
        (at.0.wrapping_add(3_001), at.0.wrapping_add(10_000)),
    ] {
        let mut rangefinders = triggered(at);
        rangefinders.echo(Front, Micros(rise), Micros(fall));
        assert_eq!(
            rangefinders.reading(Front).echo,
            Echo::NotMeasured,
            "{rise} {fall}"
        );
        // The right one still counts, across the clock's wrap.
        rangefinders.echo(Front, at.after(500), at.after(6_500));
        assert!(rangefinders.distance(Front).is_some());
    }
}

#[test]
fn one_trigger_gives_one_reading_and_none_gives_none() {
    let mut rangefinders = triggered(Micros(0));
    rangefinders.echo(Front, Micros(500), Micros(1_500));
    let first = rangefinders.reading(Front).echo;
    rangefinders.echo(Front, Micros(2_000), Micros(4_000));
    assert_eq!(rangefinders.reading(Front).echo, first);
    rangefinders.echo(Left, Micros(500), Micros(1_500));
    assert_eq!(rangefinders.reading(Left).echo, Echo::NotMeasured);
}

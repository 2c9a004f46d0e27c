//! The watcher on made-up turns: what the robot does, what its wheels say, what the part reads.
#![allow(
    clippy::cast_precision_loss,
    clippy::float_cmp,
    reason = "what is made up is made up in binary64; nothing added is exactly nothing"
)]

extern crate std;

use super::*;
use std::vec::Vec;

/// A robot that turns by `truth` and wheels that say `wheels`, degrees a tick, and a part with errors.
struct Bench {
    gyro: GyroFusion,
    bias: f64,
    scale: f64,
    chance: u64,
    events: Vec<Event>,
    /// What was added to the heading, degrees.
    added: f64,
    /// What the truth turned beyond the wheels, degrees.
    owed: f64,
}

/// Counts that a robot turned by an angle has made stand for whether it moved at all.
fn delta(moved: bool, turn: i32) -> Delta {
    Delta {
        left: if moved { -10 } else { 0 },
        right: if moved { 10 } else { 0 },
        turn,
        ..Delta::default()
    }
}

impl Bench {
    fn new() -> Self {
        Self {
            gyro: GyroFusion::new(),
            bias: -7.3,
            scale: 1.03,
            chance: 1,
            events: Vec::new(),
            added: 0.0,
            owed: 0.0,
        }
    }

    /// ±3 least significant bits.
    fn noise(&mut self) -> f64 {
        self.chance = self
            .chance
            .wrapping_mul(6_364_136_223_846_793_005)
            .wrapping_add(1_442_695_040_888_963_407);
        (self.chance >> 40) as f64 / f64::from(1 << 24) * 6.0 - 3.0
    }

    fn reading(&mut self, truth: f64) -> i16 {
        let rate = truth * 100.0 * self.scale + self.bias;
        let noise = self.noise();
        #[allow(
            clippy::cast_possible_truncation,
            reason = "it saturates, as the part does"
        )]
        let raw = (rate * 65.5 + noise).round() as i16;
        raw
    }

    fn turn(degrees: f64) -> i32 {
        #[allow(clippy::cast_possible_truncation, reason = "a few degrees")]
        let turn = (degrees / 360.0 * 4_294_967_296.0).round() as i32;
        turn
    }

    fn tick(&mut self, truth: f64, wheels: f64) {
        let raw = self.reading(truth);
        self.tick_read(Some(raw), truth, wheels);
    }

    fn tick_read(&mut self, reading: Option<i16>, truth: f64, wheels: f64) {
        let turn = Self::turn(wheels);
        let (correction, event) = self.gyro.step(reading, &delta(wheels != 0.0, turn), turn);
        self.added += f64::from(correction.heading) / 4_294_967_296.0 * 360.0;
        self.owed += truth - wheels;
        self.events.extend(event);
    }

    fn run(&mut self, ticks: u32, truth: f64, wheels: f64) {
        for _ in 0..ticks {
            self.tick(truth, wheels);
        }
    }

    /// Rested, and turned once.
    fn believed() -> Self {
        let mut bench = Self::new();
        bench.run(120, 0.0, 0.0);
        bench.run(30, 1.0, 1.0);
        bench.run(50, 0.0, 0.0);
        assert!(matches!(
            bench.events[..],
            [Event::BiasUpdated(_), Event::Trusted]
        ));
        bench.events.clear();
        bench
    }
}

#[test]
fn the_bias_is_found_at_rest_within_a_hundredth_of_a_degree_per_second() {
    for bias in [0.0, -7.3, 19.9, -39.0] {
        let mut bench = Bench::new();
        bench.bias = bias;
        bench.run(83, 0.0, 0.0);
        assert_eq!(bench.gyro.bias(), None);
        bench.run(1, 0.0, 0.0);
        let found = f64::from(bench.gyro.bias().expect("after 0.84 s")) / 256.0 / 65.5;
        assert!((found - bias).abs() < 0.01, "{found} for {bias}");
    }
}

#[test]
fn a_robot_that_is_shaken_driven_or_beyond_the_data_sheet_finds_no_bias() {
    let mut bench = Bench::new();
    for tick in 0..400 {
        bench.tick(if tick % 20 < 10 { 0.01 } else { -0.01 }, 0.0);
    }
    assert_eq!(bench.gyro.bias(), None, "shaken");
    let mut bench = Bench::new();
    bench.run(400, 0.02, 0.02);
    assert_eq!(bench.gyro.bias(), None, "driven");
    let mut bench = Bench::new();
    bench.bias = 45.0;
    bench.run(400, 0.0, 0.0);
    assert_eq!(bench.gyro.bias(), None, "no part is that far off");
}

#[test]
fn as_long_as_the_wheels_grip_nothing_is_added_whatever_the_scale_and_a_bias_that_drifts() {
    for scale in [0.95, 1.0, 1.05] {
        let mut bench = Bench::believed();
        bench.scale = scale;
        for tick in 0..20_000_u32 {
            // Up to 140 °/s, to and fro, standing now and then.
            let phase = f64::from(tick) / 300.0;
            let wheels = if tick % 3_000 < 200 {
                0.0
            } else {
                1.4 * phase.sin() * (phase / 7.0).cos()
            };
            bench.bias = -7.3 + 0.5 * (f64::from(tick) / 4_000.0).sin();
            bench.tick(wheels, wheels);
        }
        assert_eq!(bench.added, 0.0, "scale {scale}");
        assert!(bench.events.is_empty(), "{:?}", bench.events);
    }
}

#[test]
fn a_slipping_wheel_is_seen_and_the_heading_keeps_within_the_scale_of_what_was_turned() {
    for (truth, wheels) in [
        // Straight on by the wheels; one of them spins.
        (0.77, 0.0),
        (-0.2, 0.0),
        // Turning on the spot, and half of it does not arrive.
        (0.6, 1.2),
        // It stands and the wheels turn.
        (0.0, 1.3),
    ] {
        let mut bench = Bench::believed();
        bench.run(100, 0.3, 0.3);
        bench.owed = 0.0;
        bench.run(100, truth, wheels);
        assert!(bench.gyro.is_slipping(), "{truth} {wheels}");
        bench.run(20, 0.3, 0.3);
        assert!(!bench.gyro.is_slipping());
        let off = bench.added - bench.owed;
        // The window before it and the tenth of a second after it are the gyroscope's too.
        let allowed = 0.03 * (truth.abs() * 100.0 + 42.0 * 0.3) + 0.15;
        assert!(off.abs() < allowed, "{truth} {wheels}: {off:.3}°");
        assert!(
            matches!(bench.events[..], [Event::SlipStarted, Event::SlipEnded(_)]),
            "{:?}",
            bench.events
        );
        bench.events.clear();
        bench.added = 0.0;
        bench.run(500, 0.5, 0.5);
        assert_eq!(bench.added, 0.0, "and not a bit more");
    }
}

#[test]
fn a_slow_slip_is_taken_in_pieces_and_the_last_degree_may_be_missing() {
    let mut bench = Bench::believed();
    bench.owed = 0.0;
    bench.run(300, 0.05, 0.0);
    bench.run(40, 0.0, 0.0);
    assert!((bench.added - bench.owed).abs() < 1.5, "{}", bench.added);
}

#[test]
fn a_robot_turned_by_hand_is_followed_as_long_as_it_takes() {
    let mut bench = Bench::believed();
    bench.run(600, 0.5, 0.0);
    bench.run(20, 0.0, 0.0);
    assert!((bench.added - 300.0).abs() < 9.5, "{}", bench.added);
    assert!(matches!(
        bench.events[..],
        [Event::SlipStarted, Event::SlipEnded(_)]
    ));
}

#[test]
fn wheels_that_spin_for_two_seconds_are_believed_again_whatever_the_sensor_says() {
    let mut bench = Bench::believed();
    bench.run(1_000, 0.0, 0.8);
    assert!(matches!(
        bench.events[..],
        [Event::SlipStarted, Event::SlipTimedOut, Event::Mismatch]
    ));
    let added = bench.added;
    bench.run(1_000, 0.0, 0.8);
    assert_eq!(bench.added, added);
    bench.run(60, 0.8, 0.8);
    assert_eq!(bench.events.pop(), Some(Event::Trusted));
}

#[test]
fn one_mounted_upside_down_or_on_its_side_is_never_believed() {
    for scale in [-1.0, 0.0, 0.5, 1.3] {
        let mut bench = Bench::new();
        bench.scale = scale;
        bench.run(120, 0.0, 0.0);
        for _ in 0..20 {
            bench.run(100, 0.9, 0.9);
            bench.run(100, -0.9, -0.9);
        }
        assert_eq!(bench.added, 0.0);
        let doubted = |event: &&Event| **event == Event::Mismatch;
        assert_eq!(bench.events.iter().filter(doubted).count(), 1, "told once");
        assert!(!bench.events.contains(&Event::Trusted));
    }
}

#[test]
fn readings_at_the_end_of_the_range_or_missing_end_a_slip_and_add_nothing() {
    for reading in [Some(i16::MIN), Some(i16::MAX), None] {
        let mut bench = Bench::believed();
        bench.run(20, 0.7, 0.0);
        assert!(bench.gyro.is_slipping());
        for _ in 0..5 {
            bench.tick_read(reading, 0.7, 0.0);
        }
        assert!(!bench.gyro.is_slipping());
        let added = bench.added;
        for _ in 0..50 {
            bench.tick_read(reading, 0.7, 0.0);
        }
        assert_eq!(bench.added, added);
        bench.run(40, 0.2, 0.2);
        assert_eq!(bench.added, added, "and it is believed still");
    }
}

#[test]
fn a_missing_reading_or_two_change_little() {
    let mut bench = Bench::believed();
    for tick in 0..100 {
        if tick % 4 == 0 {
            bench.tick_read(None, 0.7, 0.0);
        } else {
            bench.tick(0.7, 0.0);
        }
    }
    bench.run(20, 0.0, 0.0);
    assert!((bench.added - bench.owed).abs() < 2.5);
}

#[test]
fn what_is_lost_begins_anew() {
    let mut bench = Bench::believed();
    bench.run(20, 0.7, 0.0);
    assert!(matches!(bench.gyro.lost(), Some(Event::SlipEnded(_))));
    assert_eq!((bench.gyro.bias(), bench.gyro.lost()), (None, None));
}

#[test]
fn a_turn_is_believed_as_soon_as_it_is_10_degrees_long() {
    let mut bench = Bench::new();
    bench.run(120, 0.0, 0.0);
    bench.events.clear();
    let degree = i32::try_from(DEGREE).expect("small");
    for tick in 1..=10 {
        let reading = bench.reading(1.0);
        let (_, event) = bench.gyro.step(Some(reading), &delta(true, degree), degree);
        assert_eq!(event, (tick == 10).then_some(Event::Trusted), "{tick}");
    }
}

#[test]
fn a_turn_that_takes_longer_than_three_seconds_or_rests_in_between_proves_nothing() {
    let mut bench = Bench::new();
    bench.run(120, 0.0, 0.0);
    bench.events.clear();
    // 6° in three seconds.
    bench.run(2_000, 0.02, 0.02);
    assert!(bench.events.is_empty(), "{:?}", bench.events);
    for _ in 0..10 {
        bench.run(60, 0.1, 0.1);
        bench.run(60, 0.0, 0.0);
    }
    assert!(bench.events.is_empty(), "{:?}", bench.events);
    bench.run(101, 0.1, 0.1);
    assert_eq!(bench.events, [Event::Trusted]);
}

#[test]
fn what_was_not_read_at_rest_is_no_bias() {
    let mut bench = Bench::new();
    for tick in 0..400 {
        if tick % 2 == 0 {
            bench.tick_read(None, 0.0, 0.0);
        } else {
            bench.tick(0.0, 0.0);
        }
    }
    assert_eq!(bench.gyro.bias(), None, "every second reading is missing");
    for (left, right) in [(1, 0), (0, -1)] {
        let mut bench = Bench::new();
        let wheel = Delta {
            left,
            right,
            ..Delta::default()
        };
        for _ in 0..400 {
            let reading = bench.reading(0.0);
            let _ = bench.gyro.step(Some(reading), &wheel, 0);
        }
        assert_eq!(bench.gyro.bias(), None, "one wheel moves");
    }
    // The wheels stand, and a hand turns it at a rate that might be a bias.
    let mut bench = Bench::believed();
    let before = bench.gyro.bias();
    bench.run(300, 0.3, 0.0);
    assert!(bench.gyro.is_slipping());
    assert_eq!(bench.gyro.bias(), before);
    assert!((bench.added - 90.0).abs() < 3.0, "{}", bench.added);
}

#[test]
fn the_rate_is_not_known_at_the_end_of_the_range() {
    for (reading, slips) in [
        (32_699, true),
        (32_700, false),
        (-32_699, true),
        (-32_700, false),
    ] {
        let mut bench = Bench::believed();
        bench.tick_read(Some(reading), 0.0, 0.0);
        assert_eq!(bench.gyro.is_slipping(), slips, "{reading}");
    }
}

#[test]
fn a_slip_ends_where_both_agree_to_a_tenth_of_a_degree_and_an_eighth_of_the_turn() {
    // Turning by 0.8° a tick the two may be 0.2° apart.
    for (apart, grips) in [(0.18, true), (0.22, false), (-0.18, true), (-0.22, false)] {
        let mut bench = Bench::believed();
        bench.scale = 1.0;
        bench.run(10, 0.8, -0.8);
        assert!(bench.gyro.is_slipping());
        bench.run(10, 0.8 + apart, 0.8);
        assert_eq!(bench.gyro.is_slipping(), !grips, "{apart}");
    }
}

#[test]
fn a_reading_is_the_nearest_turn_of_a_tick() {
    for bias in [-670_720, -1, 0, 1, 128, 670_720] {
        for raw in (-32_699..32_700).step_by(7) {
            // 65.5 least significant bits per °/s, a hundredth of a second, 360° in 2³².
            let rate = f64::from(raw) - f64::from(bias) / 256.0;
            let truth = rate / 65.5 / 100.0 / 360.0 * 4_294_967_296.0;
            let turn = f64::from(turn_of(raw, bias));
            // Half a bit, and as much again as the factor's own 2⁻¹⁵ make of so large a turn.
            let slack = 0.5 + rate.abs() * 256.0 / f64::from(1 << 23);
            assert!((turn - truth).abs() <= slack + 1e-6, "{raw} {bias}");
        }
    }
}

#[test]
fn a_block_that_keeps_within_a_degree_per_second_and_is_not_beyond_forty_is_a_bias() {
    // Least significant bits: the lowest and the highest of a block.
    for (least, most, known) in [
        (0, 66, true),
        (0, 67, false),
        (-30, 36, true),
        (-30, 37, false),
        (2_620, 2_620, true),
        (2_619, 2_622, false),
        (-2_620, -2_620, true),
        (-2_622, -2_619, false),
    ] {
        let mut bias = Bias::new();
        for tick in 0..84 {
            let found = bias.rest(if tick % 2 == 0 { least } else { most });
            assert_eq!(found, known && tick == 83, "{least} {most} {tick}");
        }
        let mean = i32::from(least + most) * 128;
        assert_eq!(bias.get(), known.then_some(mean));
    }
}

//! Fusion on simulated turns of robot and wheels and a sensor with bias, scale error and noise.
#![allow(
    clippy::cast_precision_loss,
    clippy::float_cmp,
    reason = "the simulation is binary64; a correction of nothing is exactly 0"
)]

use super::*;
use std::vec::Vec;

/// Degrees, and degrees a tick.
struct Simulation {
    gyro: GyroFusion,
    bias: f64,
    scale: f64,
    random: fastrand::Rng,
    events: Vec<Event>,
    /// Sum of the corrections.
    corrected: f64,
    /// The last correction's turn of its tick.
    tick_turn: f64,
    /// Turn of the robot less that of the wheels.
    owed: f64,
}

fn turn(degrees: f64) -> i32 {
    (degrees / 360.0 * 4_294_967_296.0).round() as i32
}

fn degrees(turn: i64) -> f64 {
    turn as f64 / 4_294_967_296.0 * 360.0
}

impl Simulation {
    fn new() -> Self {
        Self {
            gyro: GyroFusion::new(),
            bias: -7.3,
            scale: 1.03,
            random: fastrand::Rng::with_seed(1),
            events: Vec::new(),
            corrected: 0.0,
            tick_turn: 0.0,
            owed: 0.0,
        }
    }

    /// At rest until the bias is known.
    fn rested() -> Self {
        let mut sim = Self::new();
        sim.run(120, 0.0, 0.0);
        assert!(matches!(sim.events[..], [Event::BiasUpdated(_)]));
        sim.events.clear();
        sim
    }

    fn trusted() -> Self {
        let mut sim = Self::rested();
        sim.run(30, 1.0, 1.0);
        sim.run(50, 0.0, 0.0);
        assert_eq!(sim.events, [Event::Trusted]);
        sim.events.clear();
        sim
    }

    /// With ±3 LSB of noise, saturating like the part.
    fn reading(&mut self, robot: f64) -> i16 {
        let rate = robot * 100.0 * self.scale + self.bias;
        (rate * 65.5 + self.random.f64() * 6.0 - 3.0).round() as i16
    }

    fn tick(&mut self, reading: Option<i16>, robot: f64, wheels: f64) {
        let counts = if wheels == 0.0 { 0 } else { 10 };
        let delta = Delta::rolled(-counts, counts);
        let (correction, event) = self.gyro.step(reading, &delta, turn(wheels));
        self.corrected += degrees(correction.heading.into());
        self.tick_turn = degrees(correction.tick.into());
        self.owed += robot - wheels;
        self.events.extend(event);
    }

    fn run(&mut self, ticks: u32, robot: f64, wheels: f64) {
        for _ in 0..ticks {
            let reading = self.reading(robot);
            self.tick(Some(reading), robot, wheels);
        }
    }
}

#[test]
fn bias_is_found_at_rest_to_a_hundredth() {
    for bias in [0.0, -7.3, 19.9, -39.0] {
        let mut sim = Simulation::new();
        sim.bias = bias;
        sim.run(83, 0.0, 0.0);
        assert_eq!(sim.gyro.bias(), None);
        sim.run(1, 0.0, 0.0);
        let found = sim.gyro.bias().expect("after 0.84 s");
        assert!((f64::from(found) / 256.0 / 65.5 - bias).abs() < 0.01);
        assert!((f64::from(hundredths(found)) - bias * 100.0).abs() <= 2.0);
    }
}

#[test]
fn bias_needs_rest_readings_and_a_plausible_rate() {
    let mut shaken = Simulation::new();
    let [mut gaps, mut saturated] = [(); 2].map(|()| Simulation::new());
    for tick in 0..400 {
        shaken.run(1, if tick % 20 < 10 { 0.01 } else { -0.01 }, 0.0);
        let reading = gaps.reading(0.0);
        gaps.tick((tick % 2 != 0).then_some(reading), 0.0, 0.0);
        let at_end = tick % 60 == 0;
        saturated.tick(Some(if at_end { i16::MAX } else { reading }), 0.0, 0.0);
    }
    let mut driven = Simulation::new();
    driven.run(400, 0.02, 0.02);
    let mut implausible = Simulation::new();
    implausible.bias = 45.0;
    implausible.run(400, 0.0, 0.0);
    for sim in [shaken, gaps, saturated, driven, implausible] {
        assert_eq!(sim.gyro.bias(), None);
    }
    for (left, right) in [(1, 0), (0, -1)] {
        let mut sim = Simulation::new();
        for _ in 0..400 {
            let reading = sim.reading(0.0);
            let _ = sim.gyro.step(Some(reading), &Delta::rolled(left, right), 0);
        }
        assert_eq!(sim.gyro.bias(), None, "one wheel moves");
    }
    // Turned by hand at a rate that might be a bias.
    let mut sim = Simulation::trusted();
    let before = sim.gyro.bias();
    sim.run(300, 0.3, 0.0);
    assert!(sim.gyro.is_slipping());
    assert_eq!(sim.gyro.bias(), before);
    assert!((sim.corrected - 90.0).abs() < 3.0, "{}", sim.corrected);
}

#[test]
fn gripping_wheels_are_never_corrected() {
    for scale in [0.95, 1.0, 1.05] {
        let mut sim = Simulation::trusted();
        sim.scale = scale;
        for tick in 0..20_000_u32 {
            // Up to 140 °/s in both directions, with pauses, and a drifting bias.
            let phase = f64::from(tick) / 300.0;
            let pause = tick % 3_000 < 200;
            let wheels = 1.4 * phase.sin() * (phase / 7.0).cos() * f64::from(!pause);
            sim.bias = -7.3 + 0.5 * (f64::from(tick) / 4_000.0).sin();
            sim.run(1, wheels, wheels);
        }
        assert_eq!(sim.corrected, 0.0, "scale {scale}");
        assert!(sim.events.is_empty(), "{:?}", sim.events);
    }
}

#[test]
fn slip_is_corrected_within_the_scale_error() {
    for (robot, wheels, ticks) in [
        // One wheel spins while driving straight on.
        (0.77, 0.0, 100),
        (-0.2, 0.0, 100),
        // Turning on the spot.
        (0.6, 1.2, 100),
        (0.0, 1.3, 100),
        // Turned by hand.
        (0.5, 0.0, 600),
    ] {
        let mut sim = Simulation::trusted();
        sim.run(100, 0.3, 0.3);
        sim.owed = 0.0;
        sim.run(ticks, robot, wheels);
        assert!(sim.gyro.is_slipping(), "{robot} {wheels}");
        sim.run(20, 0.3, 0.3);
        assert!(!sim.gyro.is_slipping());
        let off = sim.corrected - sim.owed;
        // Including the window before it and the tenth of a second after it.
        let allowed = 0.03 * (robot.abs() * f64::from(ticks) + 42.0 * 0.3) + 0.15;
        assert!(off.abs() < allowed, "{robot} {wheels}: {off:.3}°");
        let [Event::SlipStarted, Event::SlipEnded(sum)] = sim.events[..] else {
            panic!("{:?}", sim.events);
        };
        assert!((degrees(sum) - sim.corrected).abs() < 1e-6);
        sim.corrected = 0.0;
        sim.run(500, 0.5, 0.5);
        assert_eq!(sim.corrected, 0.0);
    }
}

#[test]
fn slow_slip_is_corrected_to_the_last_window() {
    let mut sim = Simulation::trusted();
    sim.owed = 0.0;
    sim.run(300, 0.05, 0.0);
    sim.run(40, 0.0, 0.0);
    assert!((sim.corrected - sim.owed).abs() < 1.5, "{}", sim.corrected);
}

#[test]
fn slip_ends_within_a_tenth_of_a_degree_and_an_eighth() {
    // 0.2° at 0.8° a tick.
    for (off, ends) in [(0.18, true), (0.22, false), (-0.18, true), (-0.22, false)] {
        let mut sim = Simulation::trusted();
        sim.scale = 1.0;
        sim.run(10, 0.8, -0.8);
        assert!(sim.gyro.is_slipping());
        sim.run(9, 0.8 + off, 0.8);
        assert!(sim.gyro.is_slipping(), "a tick early");
        sim.run(1, 0.8 + off, 0.8);
        assert_eq!(sim.gyro.is_slipping(), !ends, "{off}");
    }
}

#[test]
fn slip_of_two_seconds_with_turning_wheels_times_out() {
    let mut sim = Simulation::trusted();
    sim.run(1_000, 0.0, 0.8);
    let expected = [Event::SlipStarted, Event::SlipTimedOut, Event::Mismatch];
    assert_eq!(sim.events, expected);
    let corrected = sim.corrected;
    sim.run(1_000, 0.0, 0.8);
    assert_eq!(sim.corrected, corrected);
    sim.run(60, 0.8, 0.8);
    assert_eq!(sim.events.pop(), Some(Event::Trusted));
    // Agreement in the last tick ends it.
    let mut sim = Simulation::trusted();
    while !sim.gyro.is_slipping() {
        sim.run(1, 0.0, 0.8);
    }
    // The heading takes the window, of two ticks, the controllers the last tick.
    assert!((sim.corrected + 1.6).abs() < 0.05 && (sim.tick_turn + 0.8).abs() < 0.05);
    sim.run(190, 0.0, 0.8);
    sim.run(10, 0.8, 0.8);
    let [Event::SlipStarted, Event::SlipEnded(_)] = sim.events[..] else {
        panic!("{:?}", sim.events);
    };
    // Pauses of the wheels neither count nor restart the time.
    let mut sim = Simulation::trusted();
    for round in 1..=101 {
        sim.run(2, 0.0, 0.8);
        sim.run(1, 0.0, 0.0);
        let timed_out = sim.events.contains(&Event::SlipTimedOut);
        assert_eq!(timed_out, round == 101, "{round}");
    }
}

#[test]
fn wrongly_mounted_gyro_is_never_trusted() {
    for scale in [-1.0, 0.0, 0.5, 1.3] {
        let mut sim = Simulation::new();
        sim.scale = scale;
        sim.run(120, 0.0, 0.0);
        for _ in 0..20 {
            // One failed verification each way, then a rest that ends the next.
            sim.run(15, 0.9, 0.9);
            sim.run(15, -0.9, -0.9);
            sim.run(30, 0.0, 0.0);
        }
        assert_eq!(sim.corrected, 0.0);
        let mismatches = sim.events.iter().filter(|e| **e == Event::Mismatch);
        assert_eq!(mismatches.count(), 1);
        assert!(!sim.events.contains(&Event::Trusted));
    }
}

#[test]
fn saturated_or_missing_readings_end_a_slip() {
    for reading in [Some(i16::MIN), Some(i16::MAX), None] {
        let mut sim = Simulation::trusted();
        sim.run(20, 0.7, 0.0);
        assert!(sim.gyro.is_slipping());
        for _ in 0..5 {
            sim.tick(reading, 0.7, 0.0);
        }
        assert!(!sim.gyro.is_slipping());
        let corrected = sim.corrected;
        for _ in 0..50 {
            sim.tick(reading, 0.7, 0.0);
        }
        sim.run(40, 0.2, 0.2);
        assert_eq!(sim.corrected, corrected);
    }
    for reading in [32_699, 32_700, -32_699, -32_700] {
        let mut sim = Simulation::trusted();
        sim.tick(Some(reading), 0.0, 0.0);
        assert_eq!(sim.gyro.is_slipping(), reading.abs() < 32_700, "{reading}");
    }
    // The difference before the gap is not added to the one behind it. Five ticks are 1.08°: nothing is
    // allowed for wheels that stand.
    for (gap, slips) in [(None, true), (Some(i16::MIN), false)] {
        let mut sim = Simulation::trusted();
        sim.run(3, 0.21, 0.0);
        sim.tick(gap, 0.0, 0.0);
        sim.run(1, 0.21, 0.0);
        assert_eq!(sim.gyro.is_slipping(), slips, "{gap:?}");
    }
    // One in four missing.
    let mut sim = Simulation::trusted();
    for tick in 0..100 {
        let reading = sim.reading(0.7);
        sim.tick((tick % 4 != 0).then_some(reading), 0.7, 0.0);
    }
    sim.run(20, 0.0, 0.0);
    assert!((sim.corrected - sim.owed).abs() < 2.5);
}

#[test]
fn verification_takes_a_turn_of_10_degrees() {
    let mut sim = Simulation::rested();
    for tick in 1..=10 {
        let reading = sim.reading(1.0);
        let turn = i32::try_from(DEGREE).expect("small");
        let (_, event) = sim.gyro.step(Some(reading), &Delta::rolled(-10, 10), turn);
        assert_eq!(event, (tick == 10).then_some(Event::Trusted), "{tick}");
    }
}

#[test]
fn verification_fails_beyond_3_seconds_or_with_a_rest() {
    let mut sim = Simulation::rested();
    // 6° in three seconds.
    sim.run(2_000, 0.02, 0.02);
    for _ in 0..10 {
        sim.run(60, 0.1, 0.1);
        sim.run(60, 0.0, 0.0);
    }
    assert!(sim.events.is_empty(), "{:?}", sim.events);
    sim.run(101, 0.1, 0.1);
    assert_eq!(sim.events, [Event::Trusted]);
    // 10° just within them.
    let mut slow = Simulation::rested();
    slow.run(295, 0.035, 0.035);
    assert_eq!(slow.events, [Event::Trusted]);
}

#[test]
fn reading_is_converted_to_the_nearest_turn() {
    for bias in [-670_720, -1, 0, 1, 128, 670_720] {
        for raw in (-32_699..32_700).step_by(7) {
            let rate = f64::from(raw) - f64::from(bias) / 256.0;
            let exact = rate / 65.5 / 100.0 / 360.0 * 4_294_967_296.0;
            let found = f64::from(turn_of(raw, bias));
            // Half a unit, and the factor's own rounding of 2⁻¹⁵.
            let slack = 0.5 + rate.abs() * 256.0 / f64::from(1 << 23);
            assert!((found - exact).abs() <= slack + 1e-6, "{raw} {bias}");
        }
    }
}

// Requirement: WIRE-gyro-2
#[test]
fn angle_starts_with_first_bias_and_keeps_its_past() {
    let degrees = |sim: &Simulation| degrees(sim.gyro.angle().unwrap());
    let mut sim = Simulation::new();
    sim.scale = 1.0;
    sim.run(83, 0.0, 0.0);
    assert_eq!(sim.gyro.angle(), None);
    sim.run(1, 0.0, 0.0);
    assert!(degrees(&sim).abs() < 0.2);
    sim.run(400, 1.0, 1.0);
    let turned = degrees(&sim);
    assert!((turned - 400.0).abs() < 0.5, "{turned}");
    // The rest under another bias counts as a turn until it is known, and is not taken back then.
    sim.bias += 2.0;
    sim.run(60, 0.0, 0.0);
    let before = degrees(&sim);
    assert!((before - turned - 1.2).abs() < 0.2, "{before}");
    sim.run(60, 0.0, 0.0);
    let known = degrees(&sim);
    sim.run(100, 0.0, 0.0);
    assert!(known - turned > 1.0 && (degrees(&sim) - known).abs() < 0.1);
}

//! The odometry against exact arcs, and its parts against wider arithmetic.
#![allow(clippy::cast_precision_loss, reason = "the references are binary64")]

mod exact_arcs;

use std::println;

use super::*;
use crate::eeprom::{config_with, fields, first_board};
use crate::types::HeadingCorrection;
use exact_arcs::ExactArcs;

#[test]
fn figures_per_count_and_turn_are_nearest() {
    for (diameter, counts, track) in [(80_000, 3840, 125_000), (10_007, 60_000, 792_555)] {
        let config = config_with(&[
            (fields::WHEEL_DIAMETER_LEFT, diameter),
            (fields::WHEEL_DIAMETER_RIGHT, diameter),
            (fields::COUNTS_PER_TURN, counts),
            (fields::TRACK, track),
        ]);
        let odometry = Odometry::new(&config, 0, 0);
        let way = u128::from(diameter) * u128::from(PI);
        let per = u128::from(2000 * counts);
        let nearest = ((2 * way + per) / (2 * per)) as i64;
        assert_eq!(odometry.left.half.times(1, 0), nearest);
        assert_eq!(odometry.right.half.times(1, 0), nearest);
        // π · track in 2⁻⁴⁰ mm.
        let exact = core::f64::consts::PI * track as f64 / 1000.0 * (1_u64 << 40) as f64;
        let found = odometry.half_travel_per_turn as f64;
        assert!((found / exact - 1.0).abs() < 1e-9, "{found} {exact}");
    }
}

/// Odometry and reference over the same counts.
struct Pair {
    odometry: Odometry,
    exact: ExactArcs,
    left: u32,
    right: u16,
}

impl Pair {
    /// The counters start close to their wrap.
    fn new(config: &Config) -> Self {
        let (left, right) = (u32::MAX - 5, u16::MAX - 5);
        Self {
            odometry: Odometry::new(config, left, right),
            exact: ExactArcs::new(config.clone()),
            left,
            right,
        }
    }

    fn step(&mut self, left: i64, right: i64) {
        let config = &self.exact.config;
        let sign = |reversed: bool| if reversed { -1 } else { 1 };
        let left_sign = sign(config.left().encoder_reversed);
        let right_sign = sign(config.right().encoder_reversed);
        self.left = self.left.wrapping_add((left * left_sign) as u32);
        self.right = self.right.wrapping_add((right * right_sign) as u16);
        self.exact.step(left, right);
        let _ = self.odometry.step(self.left, self.right);
    }

    /// Distance between the two positions, µm.
    fn error(&self) -> f64 {
        let mm = |ours: i64| ours as f64 * 2f64.powi(-40);
        let x = self.exact.x.less(mm(self.odometry.position.x));
        let y = self.exact.y.less(mm(self.odometry.position.y));
        x.hypot(y) * 1000.0
    }

    fn assert_heading(&self) {
        let heading = self.odometry.pose().heading;
        let off = heading.from_nearest(self.exact.heading());
        assert!(off.abs() <= 1, "heading off by {off} of 2^-32 turns");
    }
}

fn unequal() -> Config {
    config_with(&[
        (fields::WHEEL_DIAMETER_LEFT, 79_613),
        (fields::WHEEL_DIAMETER_RIGHT, 80_471),
        (fields::TRACK, 124_733),
        (fields::ENCODER_LEFT_REVERSED, 0),
    ])
}

// Requirement: DOC-4.1-4
#[test]
fn position_error_of_a_straight_km_is_below_1_um() {
    let mut worst = 0.0f64;
    for spin in (0..3000).step_by(61) {
        let mut pair = Pair::new(&first_board());
        pair.step(-spin, spin + spin % 2);
        let start = pair.error();
        // 27 counts a tick: 1.767 mm. A km is 565 900 equal ticks, and a hundredth of them has a
        // hundredth of the error.
        for _ in 0..5_659 {
            pair.step(27, 27);
        }
        worst = worst.max((pair.error() - start).abs() * 100.0);
        pair.assert_heading();
    }
    println!("worst of a straight km: {worst:.3} µm");
    assert!(worst <= 1.0);
}

// Requirement: DOC-4.1-3
#[test]
fn position_error_of_curves_is_below_1_um_per_km() {
    for config in [first_board(), unequal()] {
        let mut pair = Pair::new(&config);
        let mut random = fastrand::Rng::with_seed(1);
        let (mut left, mut right) = (0, 0);
        let (mut worst, mut path) = (0.0f64, 0);
        for tick in 0..1_000_000 {
            if tick % 50 == 0 {
                (left, right) = (random.i64(-25..45), random.i64(-25..45));
            }
            let (l, r) = (left + random.i64(-1..=1), right + random.i64(-1..=1));
            path += l.abs() + r.abs();
            pair.step(l, r);
            if tick % 64 == 0 {
                worst = worst.max(pair.error());
            }
        }
        pair.assert_heading();
        println!("worst of {:.0} m: {worst:.4} µm", path as f64 * 32.7e-6);
        assert!(worst <= 1.0);
    }
    let mut circle = Pair::new(&unequal());
    for _ in 0..200_000 {
        circle.step(19, 31);
        assert!(circle.error() <= 0.33, "330 m");
    }
}

// Requirement: DOC-4.1-1, WIRE-position-3
#[test]
fn first_board_drives_ahead_and_turns_left_as_in_the_document() {
    let mut odometry = Odometry::new(&first_board(), 0, 0);
    // Its encoders count down going ahead: a wheel turn is π·80 mm.
    for k in 1..=10u32 {
        odometry.step((k * 384).wrapping_neg(), (k * 384).wrapping_neg() as u16);
    }
    let x = odometry.pose().x.0.to_num::<f64>();
    assert!((x - 251.327_412_287_183_45).abs() < 1e-8, "{x}");
    assert_eq!(odometry.pose().heading, Turns(0));
    // Right wheel ahead, left wheel back by π·125/4 mm, 1500 counts: a quarter turn to the left.
    for k in 1..=10u32 {
        let (left, right) = ((k * 150).wrapping_sub(3840), (k * 150).wrapping_add(3840));
        odometry.step(left, right.wrapping_neg() as u16);
    }
    assert_eq!(odometry.pose().heading, Turns(1 << 30));
}

#[test]
fn position_saturates_at_its_range() {
    let config = config_with(&[
        (fields::WHEEL_DIAMETER_LEFT, 1_000_000),
        (fields::WHEEL_DIAMETER_RIGHT, 1_000_000),
        (fields::COUNTS_PER_TURN, 100),
        (fields::ENCODER_LEFT_REVERSED, 0),
        (fields::ENCODER_RIGHT_REVERSED, 0),
    ]);
    for quarter in [0, 1 << 62] {
        let mut odometry = Odometry::new(&config, 0, 0);
        odometry.heading += quarter;
        let mut last = 0.0;
        for k in 1..=100u32 {
            odometry.step(k * 32_000, (k * 32_000) as u16);
            let Pose { x, y, .. } = odometry.pose();
            let along = if quarter == 0 { x } else { y };
            let along = along.0.to_num::<f64>();
            assert!(along >= last);
            last = along;
        }
        assert!(last > 4_194_303.0);
    }
    // ±2²² mm.
    let end = 1 << 62;
    for position in [0, -1, end - 1, end, i64::MAX, -end, -end - 1, i64::MIN] {
        assert_eq!(saturated(position), position.clamp(-end, end - 1));
    }
}

/// The encoders of the first board count down going forward.
fn roll(odometry: &mut Odometry, at: &mut (u32, u16), left: i32, right: i32) -> Delta {
    at.0 = at.0.wrapping_add_signed(-left);
    at.1 = at.1.wrapping_add_signed(-right as i16);
    odometry.step(at.0, at.1)
}

#[test]
fn slip_of_one_wheel_leaves_the_motion_of_the_other() {
    // The right wheel is larger, so that each one's own way is needed.
    let config = config_with(&[(fields::WHEEL_DIAMETER_RIGHT, 88_000)]);
    let turn_per_count =
        [80_000.0, 88_000.0].map(|way| way / (2.0 * 3840.0 * 125_000.0) * 4_294_967_296.0);
    for (left, right) in [(20, 0), (0, 20), (-20, 0), (0, -20), (20, 10), (-5, -20)] {
        for left_slips in [true, false] {
            let mut corrected = Odometry::new(&config, 0, 0);
            let mut truth = corrected.clone();
            let (mut a, mut b) = ((0, 0), (0, 0));
            let (real_left, real_right) = if left_slips { (0, right) } else { (left, 0) };
            let tick = if left_slips {
                f64::from(left) * turn_per_count[0]
            } else {
                f64::from(-right) * turn_per_count[1]
            };
            let tick = tick.round() as i32;
            let heading = tick;
            for _ in 0..50 {
                let delta = roll(&mut corrected, &mut a, left, right);
                corrected.apply_slip(HeadingCorrection { heading, tick }, &delta);
                let _ = roll(&mut truth, &mut b, real_left, real_right);
            }
            let (is, was) = (corrected.pose(), truth.pose());
            let off = is.heading.from_nearest(was.heading);
            assert!(off.abs() < 100, "{left} {right}: heading {off}");
            for (is, was) in [(is.x.0, was.x.0), (is.y.0, was.y.0)] {
                let mm: f64 = (is - was).to_num();
                // The lost travel points along the end of the tick, not its middle: 0.3° in 65 mm.
                assert!(mm.abs() < 0.4, "{left} {right} {left_slips}: {mm:.3} mm");
            }
        }
    }
}

#[test]
fn correction_without_rolling_changes_the_heading_alone() {
    let mut odometry = Odometry::new(&first_board(), 0, 0);
    let mut at = (0, 0);
    for _ in 0..100 {
        let delta = roll(&mut odometry, &mut at, -10, 10);
        let tick = -delta.turn;
        let heading = tick;
        odometry.apply_slip(HeadingCorrection { heading, tick }, &delta);
    }
    assert!(odometry.pose().heading.from_nearest(Turns(0)).abs() < 200);
    let delta = roll(&mut odometry, &mut at, 0, 0);
    let before = odometry.pose();
    let (heading, tick) = (1 << 30, 1 << 26);
    odometry.apply_slip(HeadingCorrection { heading, tick }, &delta);
    let after = odometry.pose();
    assert_eq!(after.heading.from_nearest(before.heading), 1 << 30);
    assert_eq!((after.x, after.y), (before.x, before.y));
}

#[test]
fn fraction_is_the_nearest() {
    for (n, d) in [
        (0, 1),
        (1, 3),
        (2, 3),
        (7, 5),
        (1, (1 << 62) - 1),
        ((1 << 62) - 2, (1 << 62) - 1),
        (123_456_789, 987_654_321),
        // Exactly half a unit.
        (1, 1 << 61),
        (u64::MAX, (1 << 62) - 57),
    ] {
        let exact = ((u128::from(n % d) << 64) + u128::from(d) / 2) / u128::from(d);
        assert_eq!(fraction(n, d), exact as u64, "{n} / {d}");
    }
}

#[test]
fn step_direction_is_the_nearest_of_34_bits() {
    for (part, nearest) in [
        (0.25, 0.0),
        (0.49, 0.0),
        (0.51, 1.0),
        (0.75, 1.0),
        (1.25, 1.0),
        (-0.25, 0.0),
        (-0.49, 0.0),
        (-0.51, -1.0),
        (-3.75, -4.0),
    ] {
        let mut odometry = Odometry::new(&unequal(), 0, 0);
        odometry.left = odometry.right;
        odometry.left.turn = PerCount::new(0);
        odometry.right.turn = PerCount::new(0);
        odometry.heading += (part * 2f64.powi(30)) as i64;
        let _ = odometry.step(30_000, 30_000);
        let slope = odometry.position.y as f64 / odometry.position.x as f64;
        let turned = slope / std::f64::consts::TAU * 2f64.powi(34);
        assert!((turned - nearest).abs() < 0.02, "{part}: {turned}");
    }
}

#[test]
fn pose_is_rounded_to_nearest() {
    let mut odometry = Odometry::new(&first_board(), 0, 0);
    for whole in [-3_i64, -1, 0, 1, 1 << 40] {
        for (part, up) in [(0, 0), (1, 0), (127, 0), (128, 1), (129, 1), (255, 1)] {
            odometry.position.x = whole * 256 + part;
            // Half a unit more than x: it rounds the other way.
            odometry.position.y = -whole * 256 + (part ^ 128);
            let pose = odometry.pose();
            assert_eq!(pose.x.0.to_bits(), whole + up, "{whole} {part}");
            assert_eq!(pose.y.0.to_bits(), -whole + 1 - up, "{whole} {part}");
        }
        for (part, up) in [(0, 0), ((1 << 31) - 1, 0), (1 << 31, 1), (u32::MAX, 1)] {
            odometry.heading = (whole << 32) + i64::from(part) + ROUNDING;
            let turned = (whole as u32).wrapping_add(up);
            assert_eq!(odometry.pose().heading.0, turned, "{whole} {part}");
        }
    }
}

#[test]
fn travel_is_truncated_and_saturates() {
    for path in [0, 1, -1, 1 << 26, (1 << 26) - 1, -(1 << 26), -(1 << 26) - 1] {
        for far in [0, 1 << 31, 1 << 40, -(1 << 40), 0x81_0000 << 33, -(1 << 56)] {
            let path: i64 = path + far;
            assert_eq!(i64::from(narrow(path)), path >> 26, "{path}");
        }
    }
    let end = i64::from(i32::MAX);
    for path in [1_i64 << 57, (1 << 57) + 5, 1 << 60, i64::MAX] {
        // The lowest six bits are not saturated.
        let (most, least) = (i64::from(narrow(path)), i64::from(narrow(-path)));
        assert!(end - most < 64 && least + end < 64, "{path}");
    }
}

#[test]
fn shortening_is_the_chord_over_the_arc() {
    let one = 4_294_967_296.0;
    let mut worst = 0.0_f64;
    for step in -100_000..=100_000 {
        let turn = step * ((1 << 28) / 100_000);
        let half = f64::from(turn) / one * std::f64::consts::PI;
        let square = half * half;
        // The sine by its series: a difference from 1 would lose its digits.
        let exact =
            -square / 6.0 * (1.0 - square / 20.0 * (1.0 - square / 42.0 * (1.0 - square / 72.0)));
        worst = worst.max((f64::from(shortening(turn)) / one - exact).abs());
    }
    assert!(worst <= 2.1e-10, "{worst}");
}

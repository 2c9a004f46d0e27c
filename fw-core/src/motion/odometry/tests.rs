//! The odometry against [`exact`] arcs.
#![allow(
    clippy::cast_precision_loss,
    clippy::many_single_char_names,
    clippy::similar_names,
    reason = "arithmetic on binary64 pairs"
)]

extern crate std;

mod exact;

use std::println;

use super::*;
use crate::types::HeadingCorrection;
use exact::{Exact, Twofold};

/// Both, over the same counts, and what they differ by.
struct Pair {
    odometry: Odometry,
    exact: Exact,
    left: u32,
    right: u16,
}

impl Pair {
    /// The counters start close to their wrap.
    fn new(platform: Platform) -> Self {
        let (left, right) = (u32::MAX - 5, u16::MAX - 5);
        Self {
            odometry: Odometry::new(&platform, left, right),
            exact: Exact::new(platform),
            left,
            right,
        }
    }

    fn step(&mut self, left: i64, right: i64) -> Delta {
        let p = &self.exact.platform;
        let sign = |reversed: bool| if reversed { -1 } else { 1 };
        let (sl, sr) = (
            sign(p.encoder_left_reversed),
            sign(p.encoder_right_reversed),
        );
        self.left = self.left.wrapping_add((left * sl) as u32);
        self.right = self.right.wrapping_add((right * sr) as u16);
        self.exact.step(left, right);
        self.odometry.step(self.left, self.right)
    }

    /// Distance between the two positions, µm.
    fn error(&self) -> f64 {
        let unit = 2f64.powi(-40);
        let off = |ours: i64, truth: Twofold| {
            (Twofold::of(i128::from(ours)) * Twofold(unit, 0.0) - truth).0 * 1000.0
        };
        off(self.odometry.x, self.exact.x).hypot(off(self.odometry.y, self.exact.y))
    }

    fn assert_heading(&self) {
        let off = self
            .odometry
            .pose()
            .heading
            .from_nearest(self.exact.heading());
        assert!(off.abs() <= 1, "heading off by {off} of 2^-32 turns");
    }
}

/// xorshift: the same paths on every machine.
struct Chance(u64);

impl Chance {
    fn below(&mut self, bound: i64) -> i64 {
        self.0 ^= self.0 << 13;
        self.0 ^= self.0 >> 7;
        self.0 ^= self.0 << 17;
        (self.0 >> 11) as i64 % bound
    }
}

const UNEQUAL: Platform = Platform {
    wheel_diameter_left: 79_613,
    wheel_diameter_right: 80_471,
    track: 124_733,
    encoder_left_reversed: false,
    ..Platform::FIRST_BOARD
};

// Requirement: DOC-4.1-4
#[test]
fn a_kilometre_straight_on_adds_less_than_a_micrometre_whatever_the_heading() {
    let mut worst = 0.0f64;
    // Counts that turn the robot on the spot, to headings with all kinds of lower bits.
    for spin in (0..3000).step_by(61) {
        let mut pair = Pair::new(Platform::FIRST_BOARD);
        pair.step(-spin, spin + spin % 2);
        let start = (pair.odometry.clone(), pair.error());
        // 27 counts a tick on both: 1.767 mm, 177 mm/s; 565 900 ticks are a kilometre. All ticks
        // alike, so a hundredth of them shows a hundredth of the error.
        for _ in 0..5_659 {
            pair.step(27, 27);
        }
        worst = worst.max((pair.error() - start.1).abs() * 100.0);
        pair.assert_heading();
    }
    println!("worst of a kilometre straight on: {worst:.3} µm");
    assert!(worst <= 1.0);
}

#[test]
fn a_million_ticks_of_curves_add_less_than_a_micrometre() {
    for platform in [Platform::FIRST_BOARD, UNEQUAL] {
        let mut pair = Pair::new(platform);
        let mut chance = Chance(0x9E37_79B9_7F4A_7C15);
        let (mut left, mut right) = (0, 0);
        let mut worst = 0.0f64;
        let mut path = 0;
        for tick in 0..1_000_000 {
            if tick % 50 == 0 {
                left = chance.below(70) - 25;
                right = chance.below(70) - 25;
            }
            let (l, r) = (left + chance.below(3) - 1, right + chance.below(3) - 1);
            path += l.abs() + r.abs();
            pair.step(l, r);
            if tick % 64 == 0 {
                worst = worst.max(pair.error());
            }
        }
        pair.assert_heading();
        println!(
            "worst of {:.0} m of curves: {worst:.4} µm",
            path as f64 * 32.7e-6
        );
        assert!(worst <= 1.0);
    }
}

// Requirement: DOC-4.1-3
#[test]
fn a_constant_curve_stays_on_its_circle() {
    let mut pair = Pair::new(UNEQUAL);
    let mut worst = 0.0f64;
    for _ in 0..200_000 {
        pair.step(19, 31);
        worst = worst.max(pair.error());
    }
    println!("worst of a circle, 330 m: {worst:.4} µm");
    assert!(worst <= 0.33);
}

#[test]
fn sharp_turns_keep_the_stated_accuracy_up_to_a_sixteenth_of_a_turn_a_tick() {
    for (left, right) in [(-190, 190), (0, 381), (-381, 0), (150, 520), (-520, -150)] {
        let mut pair = Pair::new(Platform::FIRST_BOARD);
        let mut path = 0.0;
        for _ in 0..10_000 {
            pair.step(left, right);
            path += (left + right).abs() as f64 * 32.7e-3;
        }
        let error = pair.error();
        println!("{left} {right}: {error:.4} µm of {:.0} m", path / 1000.0);
        assert!(error <= 0.01 + path * 1e-6);
        pair.assert_heading();
    }
}

#[test]
fn the_first_sample_never_moves_the_pose() {
    for (left, right) in [
        (0, 0),
        (u32::MAX, u16::MAX),
        (0x8000_0000, 0x8000),
        (12345, 54321),
    ] {
        let mut odometry = Odometry::new(&Platform::FIRST_BOARD, left, right);
        let delta = odometry.step(left, right);
        assert_eq!((delta.left, delta.right, delta.turn), (0, 0, 0));
        assert_eq!(odometry.pose(), Pose::default());
    }
}

// Requirement: DOC-4.1-1, WIRE-position-3
#[test]
fn the_first_board_goes_ahead_and_turns_left_as_the_document_draws_it() {
    let mut odometry = Odometry::new(&Platform::FIRST_BOARD, 0, 0);
    // Its encoders count down going ahead: one wheel turn is π·80 mm.
    for k in 1..=10u32 {
        odometry.step((k * 384).wrapping_neg(), (k * 384).wrapping_neg() as u16);
    }
    let x = odometry.pose().x.0.to_num::<f64>();
    assert!((x - 251.327_412_287_183_45).abs() < 1e-8, "{x}");
    assert_eq!(odometry.pose().heading, Turns(0));
    // Right wheel ahead, left back by π·125/4 mm each, 1500 counts: a quarter turn to the left.
    for k in 1..=10u32 {
        odometry.step(
            (k * 150).wrapping_sub(3840),
            ((k * 150).wrapping_neg() as u16).wrapping_sub(3840),
        );
    }
    assert_eq!(odometry.pose().heading, Turns(1 << 30));
}

#[test]
fn the_position_stays_at_the_end_of_its_range() {
    let platform = Platform {
        wheel_diameter_left: 1_000_000,
        wheel_diameter_right: 1_000_000,
        counts_per_turn: 100,
        encoder_left_reversed: false,
        encoder_right_reversed: false,
        ..Platform::FIRST_BOARD
    };
    let mut odometry = Odometry::new(&platform, 0, 0);
    let (mut left, mut right) = (0u32, 0u16);
    let mut last = 0.0;
    for _ in 0..100 {
        left = left.wrapping_add(32_000);
        right = right.wrapping_add(32_000);
        odometry.step(left, right);
        let x = odometry.pose().x.0.to_num::<f64>();
        assert!(x >= last, "it never comes round");
        last = x;
    }
    assert!(last > 4_194_303.0);
}

#[test]
fn every_platform_that_the_configuration_accepts_and_any_counters_are_safe() {
    // With the test build's overflow checks on.
    for diameter in [10_000, 80_000, 1_000_000] {
        for other in [10_000, 1_000_000] {
            for track in [20_000, 125_000, 2_000_000] {
                for counts_per_turn in [100, 3840, 60_000] {
                    let platform = Platform {
                        wheel_diameter_left: diameter,
                        wheel_diameter_right: other,
                        track,
                        counts_per_turn,
                        ..Platform::FIRST_BOARD
                    };
                    let mut odometry = Odometry::new(&platform, 0, 0);
                    let mut chance = Chance(u64::from(track) * 3 + 1);
                    for k in 0..300 {
                        let left = match k % 4 {
                            0 => 0x8000_0000,
                            1 => u32::MAX,
                            _ => chance.below(1 << 32) as u32,
                        };
                        odometry.step(left, chance.below(1 << 16) as u16);
                        let _ = odometry.pose();
                    }
                }
            }
        }
    }
}

/// The encoders of the first board count down going forward.
fn rolled(odometry: &mut Odometry, at: &mut (u32, u16), left: i32, right: i32) -> Delta {
    at.0 = at.0.wrapping_add_signed(-left);
    at.1 = at.1.wrapping_add_signed(-right as i16);
    odometry.step(at.0, at.1)
}

#[test]
fn a_wheel_that_spins_on_the_spot_leaves_the_robot_where_the_other_one_took_it() {
    // One count turns the first board by this much.
    let count = f64::from(80_000) / (2.0 * 3840.0 * 125_000.0);
    let turn = |counts: f64| {
        #[allow(clippy::cast_possible_truncation)]
        let turn = (counts * count * 4_294_967_296.0).round() as i32;
        turn
    };
    for (left, right) in [(20, 0), (0, 20), (-20, 0), (0, -20), (20, 10), (-5, -20)] {
        // The truth: one of the wheels does not move the robot.
        for left_spins in [true, false] {
            let mut believed = Odometry::new(&Platform::FIRST_BOARD, 0, 0);
            let mut truth = believed.clone();
            let (mut a, mut b) = ((0, 0), (0, 0));
            let (real_left, real_right) = if left_spins { (0, right) } else { (left, 0) };
            for _ in 0..50 {
                let delta = rolled(&mut believed, &mut a, left, right);
                let apart = if left_spins { left } else { -right };
                let tick = turn(f64::from(apart));
                believed.apply_slip(
                    HeadingCorrection {
                        heading: tick,
                        tick,
                    },
                    &delta,
                );
                let _ = rolled(&mut truth, &mut b, real_left, real_right);
            }
            let (is, was) = (believed.pose(), truth.pose());
            let off = is.heading.from_nearest(was.heading);
            assert!(off.abs() < 100, "{left} {right}: heading {off}");
            for (is, was) in [(is.x.0, was.x.0), (is.y.0, was.y.0)] {
                let mm: f64 = (is - was).to_num();
                // What is taken back points along the tick's end, not its middle: 0.3° in 65 mm.
                assert!(mm.abs() < 0.4, "{left} {right} {left_spins}: {mm:.3} mm");
            }
        }
    }
}

#[test]
fn a_robot_that_is_held_keeps_its_heading_and_one_that_is_turned_takes_it() {
    let mut odometry = Odometry::new(&Platform::FIRST_BOARD, 0, 0);
    let mut at = (0, 0);
    for _ in 0..100 {
        let delta = rolled(&mut odometry, &mut at, -10, 10);
        let tick = -delta.turn;
        odometry.apply_slip(
            HeadingCorrection {
                heading: tick,
                tick,
            },
            &delta,
        );
    }
    assert!(odometry.pose().heading.from_nearest(Turns(0)).abs() < 200);
    let delta = rolled(&mut odometry, &mut at, 0, 0);
    let quarter = HeadingCorrection {
        heading: 1 << 30,
        tick: 1 << 26,
    };
    let before = odometry.pose();
    odometry.apply_slip(quarter, &delta);
    let after = odometry.pose();
    assert_eq!(after.heading.from_nearest(before.heading), 1 << 30);
    assert_eq!((after.x, after.y), (before.x, before.y), "no wheel rolled");
}

#[test]
fn a_part_of_a_whole_is_the_nearest() {
    for (n, d) in [
        (0, 1),
        (1, 3),
        (2, 3),
        (7, 5),
        (1, (1 << 62) - 1),
        ((1 << 62) - 2, (1 << 62) - 1),
        (123_456_789, 987_654_321),
        // 2⁻⁶⁵ of the whole is half a unit: up.
        (1, 1 << 61),
        (u64::MAX, (1 << 62) - 57),
    ] {
        let rest = u128::from(n % d);
        let exact = ((rest << 64) + u128::from(d) / 2) / u128::from(d);
        assert_eq!(fraction(n, d), exact as u64, "{n} / {d}");
    }
}

#[test]
fn a_step_goes_in_the_nearest_direction_of_34_bits() {
    let one = 2f64.powi(34);
    for (part, nearest) in [
        (0.0, 0.0),
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
        let mut odometry = Odometry::new(&UNEQUAL, 0, 0);
        // Wheels that turn it by nothing.
        odometry.left = odometry.right;
        odometry.left.turn = PerCount::new(0);
        odometry.right.turn = PerCount::new(0);
        odometry.heading += (part * 2f64.powi(30)) as i64;
        let _ = odometry.step(30_000, 30_000);
        let path = odometry.x as f64;
        let turned = odometry.y as f64 / path / std::f64::consts::TAU * one;
        assert!((turned - nearest).abs() < 0.02, "{part}: {turned}");
    }
}

#[test]
fn a_pose_is_the_nearest_of_what_is_known_more_finely() {
    let platform = crate::eeprom::first_board().platform;
    let mut odometry = Odometry::new(&platform, 0, 0);
    for whole in [-3_i64, -1, 0, 1, 1 << 40] {
        for (part, up) in [(0, 0), (1, 0), (127, 0), (128, 1), (129, 1), (255, 1)] {
            odometry.x = whole * 256 + part;
            odometry.y = -whole * 256 + part;
            let pose = odometry.pose();
            assert_eq!(pose.x.0.to_bits(), whole + up, "{whole} {part}");
            assert_eq!(pose.y.0.to_bits(), -whole + up, "{whole} {part}");
        }
        for (part, up) in [
            (0, 0),
            (1, 0),
            ((1 << 31) - 1, 0),
            (1 << 31, 1),
            (u32::MAX, 1),
        ] {
            let turned = (whole as u32).wrapping_add(up);
            odometry.heading = (whole << 32) + i64::from(part) + NEAREST;
            assert_eq!(odometry.pose().heading.0, turned, "{whole} {part}");
        }
    }
}

#[test]
fn a_position_beyond_its_range_becomes_its_end_and_no_other_does() {
    // 2⁻⁴⁰ mm: ±2²² mm.
    let end = 1 << 62;
    for (position, nearest) in [
        (0, 0),
        (-1, -1),
        (end - 2, end - 2),
        (end - 1, end - 1),
        (end, end - 1),
        (i64::MAX, end - 1),
        (-end + 1, -end + 1),
        (-end, -end),
        (-end - 1, -end),
        (i64::MIN, -end),
    ] {
        assert_eq!(within(position), nearest, "{position}");
    }
}

#[test]
fn a_path_is_cut_to_2_to_the_minus_16_mm_and_stays_within_its_range() {
    for path in [0, 1, -1, 1 << 26, (1 << 26) - 1, -(1 << 26), -(1 << 26) - 1] {
        for far in [
            0,
            1 << 31,
            1 << 40,
            -(1 << 40),
            (1 << 56) + (1 << 33),
            -(1 << 56),
        ] {
            let path: i64 = path + far;
            assert_eq!(i64::from(narrow(path)), path >> 26, "{path}");
        }
    }
    let end = i64::from(i32::MAX);
    for path in [1_i64 << 57, (1 << 57) + 5, 1 << 60, i64::MAX] {
        // The lowest six bits stay the path's.
        let (most, least) = (i64::from(narrow(path)), i64::from(narrow(-path)));
        assert!(
            end - most < 64 && least + end < 64,
            "{path}: {most} {least}"
        );
    }
}

#[test]
fn a_chord_lacks_of_its_arc_what_the_sine_says_up_to_a_sixteenth_of_a_turn() {
    let one = 4_294_967_296.0;
    let mut worst = 0.0_f64;
    for step in -100_000..=100_000 {
        let turn = step * ((1 << 28) / 100_000);
        let half = f64::from(turn) / one * std::f64::consts::PI;
        let square = half * half;
        // The sine by its series: a difference from 1 would lose its digits.
        let lacking =
            -square / 6.0 * (1.0 - square / 20.0 * (1.0 - square / 42.0 * (1.0 - square / 72.0)));
        let error = f64::from(shortening(turn)) / one - lacking;
        worst = worst.max(error.abs());
    }
    assert!(worst <= 2.1e-10, "{worst}");
}

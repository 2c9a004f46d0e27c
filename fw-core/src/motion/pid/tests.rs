#![allow(clippy::cast_precision_loss, reason = "the references are binary64")]

extern crate std;

use super::*;
use crate::eeprom::first_board;

fn gains(p: f64, i: f64, d: f64, anti_windup: f64) -> Gains {
    let double = |v: f64| Binary64(v.to_bits());
    Gains {
        p: double(p),
        i: double(i),
        d: double(d),
        anti_windup: double(anti_windup),
    }
}

fn fixed(value: f64) -> I16F16 {
    I16F16::from_num(value)
}

fn pid(p: f64, i: f64, d: f64, anti_windup: f64) -> Pid {
    Pid::new(&gains(p, i, d, anti_windup), fixed(50.0))
}

/// xorshift.
struct Chance(u64);

impl Chance {
    fn word(&mut self) -> i32 {
        self.0 ^= self.0 << 13;
        self.0 ^= self.0 >> 7;
        self.0 ^= self.0 << 17;
        (self.0 >> 32) as i32
    }
}

#[test]
fn a_factor_times_a_value_is_the_product_over_the_whole_range_of_accepted_factors() {
    for factor in [
        0.0,
        2e-10,
        0.009_326_3,
        0.073_412,
        0.3,
        1.0,
        1.3686,
        6.5088,
        106.72,
        9999.0,
        1e4,
        -2.5,
        -1e4,
    ] {
        for value in [
            -32768.0,
            -700.25,
            -1.0,
            -1.0 / 65536.0,
            0.0,
            0.5,
            3.0,
            32767.99,
        ] {
            let got = Factor::new(Binary64(f64::to_bits(factor))).times(fixed(value).to_bits());
            let truth = factor * fixed(value).to_num::<f64>();
            let error = (got as f64 / 4_294_967_296.0 - truth).abs();
            assert!(
                error <= 3e-10 + value.abs() * 1.3e-10,
                "{factor} · {value}: {error}"
            );
        }
    }
}

#[test]
fn no_double_makes_a_factor_that_overflows() {
    let mut chance = Chance(3);
    for k in 0..200_000u64 {
        let bits = if k < 4096 {
            k << 52
        } else {
            u64::from(chance.word() as u32) << 32 | u64::from(chance.word() as u32)
        };
        let factor = Factor::new(Binary64(bits));
        for value in [i32::MIN, -1, 0, 1, i32::MAX, chance.word()] {
            assert!(factor.times(value).abs() < 1 << 61);
        }
        for not in [f64::NAN, f64::INFINITY, f64::NEG_INFINITY, 0.0, 1e-310] {
            assert_eq!(Factor::new(Binary64(not.to_bits())).times(i32::MAX), 0);
        }
    }
}

#[test]
fn the_output_and_the_integral_stay_within_the_limit_whatever_comes() {
    let mut chance = Chance(77);
    for p in [0.0, 6.5088, 1e4] {
        for i in [0.0, 0.073_412, 1e4] {
            for d in [0.0, 106.72, 1e4] {
                for a in [0.0, 0.3, 1.4, 1e4] {
                    let mut pid = pid(p, i, d, a);
                    for k in 0..2000 {
                        let extreme = [i32::MIN, i32::MAX, 0, 1, -1];
                        let pick = |c: &mut Chance| match c.word() & 7 {
                            n @ 0..=4 => extreme[n as usize],
                            _ => c.word() >> (k % 24),
                        };
                        let error = I16F16::from_bits(pick(&mut chance));
                        let rate = I16F16::from_bits(pick(&mut chance));
                        let output = pid.step(error, rate);
                        assert!(output.abs() <= 50 && pid.integral().abs() <= 50);
                    }
                }
            }
        }
    }
}

// Requirement: DOC-6.0.2-1, WIRE-eeprom-11
#[test]
fn the_document_s_factors_count_per_sample_and_in_percent() {
    let mut pid = pid(2.0, 0.5, 10.0, 0.3);
    // 2·3 + 0.5·3 − 10·0.1
    assert!((pid.step(fixed(3.0), fixed(0.1)).to_num::<f64>() - 6.5).abs() < 1e-3);
    // The integral remembers: 2·1 + 0.5·(3 + 1)
    assert!((pid.step(fixed(1.0), fixed(0.0)).to_num::<f64>() - 4.0).abs() < 1e-3);
    let first = first_board();
    let mut move_pid = Pid::new(&first.forward, fixed(50.0));
    let output = move_pid.step(fixed(1.0), fixed(0.0)).to_num::<f64>();
    assert!((output - 6.582_212).abs() < 1e-3, "{output}");
}

#[test]
fn a_new_set_point_does_not_kick_through_the_derivative() {
    let mut pid = pid(1.0, 0.0, 100.0, 0.3);
    assert!(pid.step(fixed(0.0), fixed(0.0)) == 0);
    assert!((pid.step(fixed(10.0), fixed(0.0)).to_num::<f64>() - 10.0).abs() < 1e-3);
}

#[test]
fn it_takes_over_without_a_jump() {
    for from in [-30.0, -7.5, 0.0, 12.0, 45.0] {
        let mut pid = pid(1.3686, 0.009_326_3, 50.209, 1.4);
        pid.start_at(fixed(from), fixed(2.0), fixed(0.01));
        let output = pid.step(fixed(2.0), fixed(0.01)).to_num::<f64>();
        assert!((output - from).abs() < 0.05, "{from} {output}");
    }
}

#[test]
fn what_the_integral_gathered_is_taken_out_of_it_at_the_limit_and_no_more() {
    let mut pid = pid(1.0, 0.5, 0.0, 0.3);
    for _ in 0..100 {
        let _ = pid.step(fixed(10.0), fixed(0.0));
    }
    assert!(pid.integral() <= 50 && pid.integral() > 30);
    // A far set-point saturates alone: the integral goes, down to zero, not beyond.
    for _ in 0..100 {
        assert!(pid.step(fixed(500.0), fixed(0.0)) == 50);
        assert!(pid.integral() >= 0);
    }
    assert!(pid.integral() == 0);
    // And the output leaves the limit as soon as the error allows.
    assert!(pid.step(fixed(30.0), fixed(0.0)) < 31);
}

#[test]
fn at_the_limit_what_pushes_further_is_not_integrated_and_what_pulls_back_is() {
    for side in [1.0, -1.0] {
        let at = |percent: f64| fixed(side * percent);
        // Nothing is unwound, so what is integrated shows alone.
        let mut pid = pid(1.0, 0.5, 10.0, 0.0);
        for _ in 0..8 {
            let _ = pid.step(at(10.0), fixed(0.0));
        }
        // 10 + 40 is the limit; 5 more would be beyond.
        assert_eq!(pid.integral(), at(40.0));
        assert_eq!(pid.step(at(10.0), fixed(0.0)), at(50.0));
        assert_eq!(pid.integral(), at(40.0));
        // −5 + 20 + 37.5: held at the limit by the derivative, while the error is on the other side.
        assert_eq!(pid.step(at(-5.0), at(-2.0)), at(50.0));
        assert_eq!(pid.integral(), at(37.5));
    }
}

#[test]
fn what_is_far_is_not_integrated() {
    let mut pid = pid(2.0, 0.5, 0.0, 0.3);
    for _ in 0..50 {
        let _ = pid.step(fixed(5.5), fixed(0.0));
    }
    assert!(pid.integral() == 0);
    let _ = pid.step(fixed(4.5), fixed(0.0));
    assert!(pid.integral() > 2);
    pid.reset();
    assert!(pid.integral() == 0);
}

#[test]
fn a_lower_limit_holds_at_once() {
    let mut pid = pid(0.0, 5.0, 0.0, 0.3);
    for _ in 0..100 {
        let _ = pid.step(fixed(10.0), fixed(0.0));
    }
    pid.set_limit(fixed(20.0));
    assert!(pid.step(fixed(0.0), fixed(0.0)) <= 20 && pid.integral() <= 20);
}

#![allow(clippy::cast_precision_loss, reason = "the references are binary64")]

use super::*;
use crate::eeprom::first_board;
use fixed::types::I32F32;

fn gain(value: f64) -> eeprom::Gain {
    eeprom::Gain::new(I32F32::from_num(value)).expect("0 to 10 000")
}

fn gains(p: f64, i: f64, d: f64, anti_windup: f64) -> Gains {
    let [p, i, d, anti_windup] = [p, i, d, anti_windup].map(gain);
    Gains {
        p,
        i,
        d,
        anti_windup,
    }
}

fn fixed(value: f64) -> I16F16 {
    I16F16::from_num(value)
}

/// With a limit of 50 %.
fn pid(p: f64, i: f64, d: f64, anti_windup: f64) -> Pid {
    Pid::new(&gains(p, i, d, anti_windup), fixed(50.0))
}

#[track_caller]
fn assert_output(pid: &mut Pid, error: f64, rate: f64, output: f64) {
    let found = pid.step(fixed(error), fixed(rate)).to_num::<f64>();
    assert!((found - output).abs() < 1e-3, "{found} instead of {output}");
}

#[test]
fn new_scales_limits_and_anti_windup() {
    for (anti_windup, factor) in [(0.0, 0), (0.25, 1 << 14), (1.0, 1 << 16), (1.4, 1 << 16)] {
        let pid = pid(1.0, 1.0, 1.0, anti_windup);
        assert_eq!(pid.back_calculation, factor, "{anti_windup}");
        assert_eq!(pid.limit, 50 << 32);
        let share = i64::from(INTEGRATION_SHARE);
        assert_eq!(pid.integration_limit, (50 << 32) / share);
    }
}

#[test]
fn gain_times_value_is_the_product() {
    for factor in [0.0, 2e-10, 0.009_326, 0.3, 1.0, 6.5088, 106.72, 9999.0, 1e4] {
        for value in [-32768.0, -700.25, -1.0 / 65536.0, 0.0, 0.5, 3.0, 32767.99] {
            let found = Gain::new(gain(factor)).times(fixed(value).to_bits());
            let exact = factor * fixed(value).to_num::<f64>();
            let error = (found as f64 / 4_294_967_296.0 - exact).abs();
            let bound = 3e-10 + value.abs() * 1.3e-10;
            assert!(error <= bound, "{factor} · {value}: {error}");
        }
    }
}

// Requirement: WIRE-eeprom-11
#[test]
fn pid_gains_count_per_sample_and_in_percent() {
    let mut controller = pid(2.0, 0.5, 10.0, 0.3);
    // 2·3 + 0.5·3 − 10·0.1, then 2·1 + 0.5·(3 + 1).
    assert_output(&mut controller, 3.0, 0.1, 6.5);
    assert_output(&mut controller, 1.0, 0.0, 4.0);
    let mut forward = Pid::new(first_board().forward(), fixed(50.0));
    assert_output(&mut forward, 1.0, 0.0, 6.582_212);
    // A new set-point does not kick through the derivative.
    let mut controller = pid(1.0, 0.0, 100.0, 0.3);
    assert_output(&mut controller, 0.0, 0.0, 0.0);
    assert_output(&mut controller, 10.0, 0.0, 10.0);
}

#[test]
fn pid_at_the_limit_integrates_only_away_from_it() {
    for side in [1.0, -1.0] {
        let at = |percent: f64| fixed(side * percent);
        // Without back-calculation the integral shows alone.
        let mut pid = pid(1.0, 0.5, 10.0, 0.0);
        for _ in 0..8 {
            let _ = pid.step(at(10.0), fixed(0.0));
        }
        // 10 + 40 is the limit; 5 more would be beyond.
        assert_eq!(pid.integral(), I32F32::from(at(40.0)));
        assert_eq!(pid.step(at(10.0), fixed(0.0)), at(50.0));
        assert_eq!(pid.integral(), I32F32::from(at(40.0)));
        // −5 + 20 + 37.5: the derivative keeps it at the limit, the error is on the other side.
        assert_eq!(pid.step(at(-5.0), at(-2.0)), at(50.0));
        assert_eq!(pid.integral(), I32F32::from(at(37.5)));
    }
}

#[test]
fn pid_begins_with_the_integral_given_it() {
    let mut controller = pid(1.0, 0.0, 0.0, 0.0).with_integral(I32F32::from_num(20));
    assert_output(&mut controller, 1.0, 0.0, 21.0);
    let beyond = pid(1.0, 0.0, 0.0, 0.0).with_integral(I32F32::from_num(60));
    assert_eq!(beyond.integral(), I32F32::from_num(50));
}

#[test]
fn pid_back_calculation_takes_excess_down_to_zero() {
    for side in [1.0, -1.0] {
        for (anti_windup, integral) in [(0.25, 12.5), (0.5, 5.0), (1.0, 0.0)] {
            let begun = pid(1.0, 0.5, 0.0, anti_windup);
            let mut pid = begun.with_integral(I32F32::from_num(20.0 * side));
            // 60 + 20 is 30 beyond the limit.
            assert_output(&mut pid, 60.0 * side, 0.0, 50.0 * side);
            let off = pid.integral() - I32F32::from_num(integral * side);
            assert!(off.abs() < I32F32::from_num(1e-3), "{anti_windup}: {off}");
        }
    }
}

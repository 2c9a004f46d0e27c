//! Identification of the motors' gains, and its conditions.

use super::*;
use crate::eeprom::{Field, config_with, fields};
use crate::motion::tests::duty;
use std::vec::Vec;

fn percent(value: f64) -> I16F16 {
    I16F16::from_num(value)
}

/// Motors without a dead zone.
fn mixer() -> Mixer {
    mixer_with(&[])
}

fn mixer_with(changes: &[(&Field, u64)]) -> Mixer {
    let none = [(fields::DEAD_ZONE_LEFT, 0), (fields::DEAD_ZONE_RIGHT, 0)];
    Mixer::new(&config_with(&[&none, changes].concat()))
}

/// The factors after each of so many ticks with these outputs, percent, and counts.
fn drive(
    mixer: &mut Mixer,
    (forward, rotation): (f64, f64),
    (left, right): (i32, i32),
    ticks: usize,
) -> Vec<(f64, f64)> {
    let tick = |_| {
        let _ = mixer.mix(percent(forward), percent(rotation));
        mixer.observe(&Delta::rolled(left, right));
        let (left, right) = mixer.gain_balance();
        (left.to_num(), right.to_num())
    };
    (0..ticks).map(tick).collect()
}

#[test]
fn stronger_wheel_is_scaled_to_the_weaker_down_to_a_quarter() {
    for (counts, expected) in [
        ((40, 20), (0.5, 1.0)),
        ((20, 40), (1.0, 0.5)),
        ((100, 10), (0.25, 1.0)),
        ((10, 100), (1.0, 0.25)),
        ((1000, 1), (0.25, 1.0)),
        ((40, 0), (0.25, 1.0)),
    ] {
        let balances = drive(&mut mixer(), (20.0, 0.0), counts, 200);
        // The first identification is at equal duties.
        let first = balances.iter().find(|&&balance| balance != (1.0, 1.0));
        let &(left, right) = first.expect("within two seconds");
        let off = (left - expected.0).abs().max((right - expected.1).abs());
        assert!(off < 1e-3, "{counts:?}: {left} {right}");
        for (left, right) in balances {
            assert!(left.min(right) >= 0.25 && left.max(right).total_cmp(&1.0).is_eq());
        }
    }
}

#[test]
fn identification_needs_6_percent_on_both_wheels() {
    // In reverse the lags reach the duty to the last bit.
    for (forward, rotation, identifies) in [
        (-6.0, 0.0, true),
        (-5.99, 0.0, false),
        (5.0, 0.0, false),
        (6.5, 2.0, false),
        (6.5, -2.0, false),
        (0.0, 5.0, false),
        (0.0, 20.0, true),
        (20.0, 10.0, true),
    ] {
        let way = |percent: f64| if percent < 0.0 { -1 } else { 1 };
        let counts = (40 * way(forward - rotation), 20 * way(forward + rotation));
        let balances = drive(&mut mixer(), (forward, rotation), counts, 1000);
        let identified = balances.last() != Some(&(1.0, 1.0));
        assert_eq!(identified, identifies, "{forward} % {rotation} %");
    }
}

#[test]
fn largest_output_is_of_the_new_gain_balance() {
    let mut motor = mixer().left;
    for (own, other, factor) in [(2, 1, 2), (1, 1, 1), (100, 1, 4), (1, 3, 1)] {
        let largest = motor.balance(own, other);
        assert_eq!(largest, motor.headroom * factor, "{own} {other}");
    }
}

#[test]
fn gain_balance_changes_every_sixteenth_tick() {
    let (mut mixer, mut changes) = (mixer(), 0);
    for _ in 0..500 {
        let before = mixer.gain_balance();
        let _ = drive(&mut mixer, (20.0, 0.0), (40, 20), 1);
        if mixer.gain_balance() != before {
            assert_eq!(mixer.excited % 16, 0);
            changes += 1;
        }
    }
    assert!(changes > 3, "{changes}");
}

#[test]
fn braked_and_raw_driven_wheels_are_not_identified() {
    for raw in [false, true] {
        let mut mixer = mixer();
        let _ = drive(&mut mixer, (20.0, 0.0), (30, 30), 200);
        let before = mixer.gain_balance();
        for tick in 0..500 {
            let _ = if raw {
                mixer.raw(5000, -5000)
            } else {
                mixer.brake()
            };
            // Unequal counts once the lags have decayed.
            let (left, right) = if tick < 100 { (30, 30) } else { (40, 20) };
            mixer.observe(&Delta::rolled(left, right));
        }
        let lags = [mixer.left, mixer.right].map(|motor| motor.lag.output());
        assert_eq!(lags, [0, 0], "the next start begins at rest");
        let after = mixer.gain_balance();
        for (before, after) in [(before.0, after.0), (before.1, after.1)] {
            assert!((before - after).abs() < percent(0.1), "{after:?}");
        }
    }
}

#[test]
fn lags_take_sixteen_ticks_each_and_identification_64() {
    let (mut lag, mut first, mut second) = (MotorLag::default(), 0.0, 0.0);
    for tick in 0..100 {
        first += (100.0 - first) / 16.0;
        second += (first - second) / 16.0;
        let lagged = f64::from(lag.step(100 * PERCENT)) / f64::from(PERCENT);
        assert!((lagged - second).abs() < 1e-3, "{tick}: {lagged} {second}");
    }
    // The share of a response that came 64 ticks ago; counts of more than a thousand are none.
    let identified = |counts: i32| {
        let mut motor = Motor::new(config_with(&[]).left());
        motor.lag = MotorLag([20 * PERCENT; 2]);
        (0..64).for_each(|_| motor.identify(counts));
        let response = i32::try_from(motor.response).expect("below 2³¹");
        f64::from(response) / f64::from((20 << 8) << 8)
    };
    let share = 1.0 - (63.0_f64 / 64.0).powi(64);
    for (counts, counted) in [
        (40, 40),
        (-999, -999),
        (1000, 1000),
        (1001, 1000),
        (-1001, -1000),
    ] {
        let off = identified(counts) - share * f64::from(counted);
        assert!(off.abs() < 0.01, "{counts}: {off}");
    }
}

#[test]
fn full_output_is_the_whole_duty() {
    let mut mixer = mixer_with(&[(fields::LIMIT_LEFT, 10_000), (fields::LIMIT_RIGHT, 10_000)]);
    mixer.balance();
    for forward in [100.0, 150.0] {
        let MotorCommands { left, right } = mixer.mix(percent(forward), percent(0.0));
        let sizes = [left, right].map(|command| duty(command).abs());
        assert_eq!(sizes, [10_000; 2], "{forward}");
    }
}

#[test]
fn duty_is_the_nearest_hundredth() {
    let mixer = mixer_with(&[(fields::MOTOR_LEFT_REVERSED, 0)]);
    for (forward, hundredths) in [(10.004, 1000), (10.006, 1001)] {
        for (forward, hundredths) in [(forward, hundredths), (-forward, -hundredths)] {
            let commands = mixer.clone().mix(percent(forward), percent(0.0));
            assert_eq!(duty(commands.left), hundredths, "{forward}");
        }
    }
}

#[test]
fn first_output_fits_the_lower_limit() {
    for limits in [(10_000, 5_000), (5_000, 10_000)] {
        let mut mixer = mixer_with(&[
            (fields::LIMIT_LEFT, limits.0),
            (fields::LIMIT_RIGHT, limits.1),
        ]);
        // Where one wheel were cut alone, the robot would turn, or not turn on the spot.
        for (forward, rotation) in [(80.0, 0.0), (-80.0, 0.0), (0.0, 80.0), (0.0, -80.0)] {
            let MotorCommands { left, right } = mixer.mix(percent(forward), percent(rotation));
            let sizes = [left, right].map(|command| duty(command).abs());
            assert_eq!(sizes, [5_000; 2], "{forward} {rotation}");
        }
    }
}

// Requirement: WIRE-eeprom-6
#[test]
fn raw_duty_is_cut_to_the_limit_of_its_wheel() {
    let mut mixer = Mixer::new(&config_with(&[
        (fields::LIMIT_LEFT, 8_000),
        (fields::LIMIT_RIGHT, 5_000),
    ]));
    for (left, right, cut) in [
        (9_000, 9_000, [8_000, 5_000]),
        (-9_000, -9_000, [-8_000, -5_000]),
        (6_000, -6_000, [6_000, -5_000]),
        (4_000, 4_000, [4_000, 4_000]),
    ] {
        let MotorCommands { left, right } = mixer.raw(left, right);
        assert_eq!([left, right].map(duty), cut);
    }
}

//! Every field of page 0x03 changes what the robot does, and how.
//!
//! Not here: `layout_version`, `layout_length`, `signs_reserved` and `crc`, which say what the page is;
//! `log_baud`, which the registers obey; `gyro` and `log_period`, which `slip_monitor` and `events` test;
//! `bearing_right` and `bearing_left`, which only the Pi's map uses.

use super::{Bench, duty, motors, tune};
use crate::eeprom::fields::*;
use crate::eeprom::{FIELDS, Field, Image};
use crate::robot::TickOutput;
use crate::types::{Faults, RangefinderId};
use crate::wire::{Command, Mode, State};
use std::f64::consts::{PI, TAU};
use std::vec::Vec;

type Changes<'a> = &'a [(&'a Field, u64)];

/// To drive to: millimetres along x, and hundredths of a turn.
fn go(x_mm: i32, hundredths: u16) -> Command {
    let mut command = super::go(x_mm);
    command.expected.rotation = hundredths * 327;
    command
}

#[test]
fn platform_fields_are_all_tested() {
    let elsewhere = [
        LAYOUT_VERSION,
        LAYOUT_LENGTH,
        SIGNS_RESERVED,
        BEARING_RIGHT,
        BEARING_LEFT,
        LOG_BAUD,
        GYRO,
        LOG_PERIOD,
    ];
    // From 0x0334 on: the obstacle stop's and the velocity's, which have tests of their own.
    let on_page = |field: &&Field| (0x0300..0x0334).contains(&field.address);
    for field in FIELDS.iter().filter(on_page) {
        let changed = std::format!("({}, ", field.name().to_uppercase());
        let here = include_str!("platform.rs").contains(&changed);
        let excepted = elsewhere.iter().any(|other| other.index == field.index);
        assert!(here != excepted, "{}", field.name());
    }
}

/// Where so many counts of both wheels lead from rest: millimetres along x, and radians.
fn rolled(changes: Changes, left: i32, right: i16) -> (f64, f64) {
    // These encoders count up going forward, the first board's down.
    let forward = [(ENCODER_LEFT_REVERSED, 0), (ENCODER_RIGHT_REVERSED, 0)];
    let mut bench = Bench::with(Mode::Normal, &[&forward, changes].concat());
    for _ in 0..100 {
        bench.roll(-left, -right);
        bench.tick();
    }
    let pose = bench.frame(&Command::default()).pose;
    let turn = f64::from(pose.rotation) / 32_768.0;
    let turn = if turn > 0.5 { turn - 1.0 } else { turn };
    (f64::from(pose.x) / 1000.0, turn * TAU)
}

// Requirement: WIRE-platform-2, DOC-1-1
#[test]
fn geometry_fields_scale_the_pose() {
    let changes: [Changes; 6] = [
        &[],
        &[(COUNTS_PER_TURN, 1000)],
        &[(WHEEL_DIAMETER_LEFT, 90_000)],
        &[(WHEEL_DIAMETER_RIGHT, 70_000)],
        &[(TRACK, 250_000)],
        &[
            (COUNTS_PER_TURN, 60_000),
            (WHEEL_DIAMETER_LEFT, 200_000),
            (WHEEL_DIAMETER_RIGHT, 300_000),
            (TRACK, 1_000_000),
        ],
    ];
    for (nth, change) in changes.into_iter().enumerate() {
        let mut image = Image::FIRST_BOARD;
        for &(field, raw) in change {
            image.set(field, raw);
        }
        let number = |field| u32::try_from(image.get(field)).map_or(0.0, f64::from);
        let way = |diameter, counts: i16| {
            number(diameter) / 1000.0 * PI * 100.0 * f64::from(counts) / number(COUNTS_PER_TURN)
        };
        for (left, right) in [(3, 3), (-1, 1), (0, 1)] {
            let one = way(WHEEL_DIAMETER_LEFT, left);
            let other = way(WHEEL_DIAMETER_RIGHT, right);
            let (x, turn) = rolled(change, left.into(), right);
            let turned = (other - one) / (number(TRACK) / 1000.0);
            let straight = f64::midpoint(one, other);
            let ahead = if turned == 0.0 {
                straight
            } else {
                straight / turned * turned.sin()
            };
            assert!((turn - turned).abs() < 2e-4, "{nth}: {turn} for {turned}");
            assert!((x - ahead).abs() < 0.01, "{nth}: {x} for {ahead}");
        }
    }
}

/// The duties of the first tick after this frame.
fn first_duties(mode: Mode, changes: Changes, command: &Command) -> [i16; 2] {
    motors(Bench::with(mode, changes).drive(command)).map(duty)
}

// Requirement: WIRE-platform-3
#[test]
fn sign_fields_reverse_encoders_and_motors() {
    let (ahead, _) = rolled(&[], 3, 3);
    assert!(ahead > 19.0);
    let both = [(ENCODER_LEFT_REVERSED, 1), (ENCODER_RIGHT_REVERSED, 1)];
    let (back, _) = rolled(&both, 3, 3);
    assert!((ahead + back).abs() < 0.001, "{back}");
    let (x, turn) = rolled(&[(ENCODER_LEFT_REVERSED, 1)], 1, 1);
    assert!(x.abs() < 0.001 && turn > 0.1, "counter-clockwise: {turn}");
    let (x, turn) = rolled(&[(ENCODER_RIGHT_REVERSED, 1)], 1, 1);
    assert!(x.abs() < 0.001 && turn < -0.1, "clockwise: {turn}");

    let duties = |changes| first_duties(Mode::TuneRotate, changes, &tune(40.0));
    assert_eq!(duties(&[]), [-4000, 4000]);
    assert_eq!(duties(&[(MOTOR_LEFT_REVERSED, 1)]), [4000, 4000]);
    assert_eq!(duties(&[(MOTOR_RIGHT_REVERSED, 1)]), [-4000, -4000]);
}

// Requirement: WIRE-platform-4, DOC-2.2-2
#[test]
fn fitted_rangefinders_are_triggered() {
    for fitted in 0..=3 {
        let mut bench = Bench::with(Mode::Normal, &[(RANGEFINDERS, fitted as u64)]);
        let mut triggered = [0; 3];
        for _ in 0..180 {
            if let Some(which) = bench.tick().trigger {
                triggered[which as usize] += 1;
            }
        }
        for (nth, times) in triggered.into_iter().enumerate() {
            assert_eq!(times > 15, nth < fitted, "{fitted}: {triggered:?}");
            assert_eq!(times == 0, nth >= fitted, "{fitted}: {triggered:?}");
        }
    }
}

/// Ten readings of a robot that sweeps: the pulse that was sent last before each, and its bearing.
fn swept(changes: Changes) -> Vec<(u16, u16)> {
    let mut bench = Bench::with(Mode::GuardedSweep, &[&[(SERVO, 1)], changes].concat());
    let (mut pulse, mut readings) = (0, Vec::new());
    while readings.len() < 10 {
        let TickOutput { servo, trigger, .. } = bench.drive(&Command::default());
        if let Some(which) = trigger {
            assert_eq!(which, RangefinderId::Front);
            bench.echo(which, 6_000);
            // The reply is one frame behind what it answers.
            bench.frame(&Command::default());
            let report = bench.frame(&Command::default());
            assert_ne!(report.ranges[0].0, 0xFFFF);
            readings.push((pulse, report.bearing));
        }
        pulse = servo.unwrap_or(pulse);
    }
    readings
}

// Requirement: WIRE-platform-3, WIRE-platform-5, WIRE-platform-6
#[test]
fn servo_fields_set_pulses_and_bearings() {
    // Half a turn of travel in steps of 10°, from the 1.0 ms pulse on, −90° first.
    let plain = swept(&[]);
    assert_eq!(plain[0], (1000, 0xC000));
    let step = plain[1].1.wrapping_sub(plain[0].1);
    // A pulse is whole microseconds.
    assert!(step.abs_diff(1820) < 20, "{step}");
    let turned = swept(&[(BEARING_FRONT, 0x1000)]);
    let reversed = swept(&[(SERVO_REVERSED, 1)]);
    for (nth, (pulse, bearing)) in plain.iter().enumerate() {
        assert_eq!(turned[nth], (*pulse, bearing.wrapping_add(0x1000)));
        assert_eq!(reversed[nth], (*pulse, bearing.wrapping_neg()));
    }
    let narrow = swept(&[(SERVO_TRAVEL, 0x4000)]);
    assert_eq!(narrow[0], (1000, 0xE000));
    assert_eq!(narrow[9], (2000, 0x2000));

    let pulses = |changes: Changes| {
        let mut bench = Bench::with(Mode::Normal, changes);
        bench.frame(&Command::default());
        let pulses = (0..20).filter_map(|_| bench.tick().servo);
        pulses.collect::<Vec<_>>()
    };
    assert!(pulses(&[]).is_empty());
    assert_eq!(pulses(&[(SERVO, 1)]), [1500; 10]);
}

// Requirement: WIRE-platform-8
#[test]
fn stop_deadline_field_sets_time() {
    let cases: [(u32, Changes); 3] = [
        (2, &[(STOP_DEADLINE, 20)]),
        (25, &[]),
        (200, &[(STOP_DEADLINE, 2000)]),
    ];
    for (ticks, changes) in cases {
        let mut bench = Bench::with(Mode::TuneMove, changes);
        bench.frame(&tune(1.0));
        let stopped = (1..=400).find(|_| {
            bench.tick();
            bench.robot.state() == State::Stopped
        });
        assert_eq!(stopped, Some(ticks));
    }
}

// Requirement: WIRE-platform-9, WIRE-eeprom-6
#[test]
fn dead_zone_and_limit_bound_the_duty() {
    let first_duties =
        |changes: Changes, command: &Command| first_duties(Mode::Normal, changes, command);
    let none: Changes = &[(DEAD_ZONE_LEFT, 0), (DEAD_ZONE_RIGHT, 0)];
    let near = go(6, 0);
    let [left, right] = first_duties(none, &near);
    assert_eq!(left, right);
    assert!((100..6000).contains(&left), "{left}");
    let [raised, same] = first_duties(&[(DEAD_ZONE_LEFT, 3000), (DEAD_ZONE_RIGHT, 0)], &near);
    assert!(raised > 3000, "{raised}");
    assert!((raised - left).abs_diff(3000) < 900, "{raised} {left}");
    assert!(same.abs_diff(right) < 900, "{same} {right}");
    let [same, raised] = first_duties(&[(DEAD_ZONE_LEFT, 0), (DEAD_ZONE_RIGHT, 3000)], &near);
    assert!(raised > 3000 && same.abs_diff(left) < 900, "{raised}");

    let far = go(3000, 0);
    let [left, right] = first_duties(none, &far);
    assert!(left > 9000 && right > 9000, "{left} {right}");
    let cases: [(Changes, (i16, i16)); 2] = [
        (&[(LIMIT_LEFT, 4000)], (4000, 10_000)),
        (&[(LIMIT_RIGHT, 5000)], (10_000, 5000)),
    ];
    for (change, limits) in cases {
        for command in [&far, &go(0, 50)] {
            let [left, right] = first_duties(change, command).map(i16::abs);
            assert!(left <= limits.0 && right <= limits.1, "{left} {right}");
        }
    }
}

// Requirement: WIRE-fault-3, WIRE-fault-4, WIRE-platform-10
#[test]
fn battery_fields_set_warning_and_cutoff() {
    // Two seconds of cells at 3.6 V.
    let faults = |changes: Changes| {
        let mut bench = Bench::with(Mode::Normal, changes);
        bench.ticks(200);
        bench.robot.faults() & (Faults::BATTERY_LOW | Faults::BATTERY_CUTOFF)
    };
    assert_eq!(faults(&[]), Faults::NONE);
    assert_eq!(faults(&[(BATTERY_WARN, 3590)]), Faults::NONE);
    assert_eq!(faults(&[(BATTERY_WARN, 3610)]), Faults::BATTERY_LOW);
    let cut = [(BATTERY_WARN, 3610), (BATTERY_CUTOFF, 3610)];
    assert_eq!(faults(&cut), Faults::BATTERY_LOW | Faults::BATTERY_CUTOFF);
    // 0 is off, however empty the cells are.
    let both = Faults::BATTERY_LOW | Faults::BATTERY_CUTOFF;
    let off: Changes = &[(BATTERY_WARN, 0), (BATTERY_CUTOFF, 0)];
    for (changes, found) in [(off, Faults::NONE), (&[], both)] {
        let mut bench = Bench::with(Mode::Normal, changes);
        bench.words = [500, 500];
        bench.ticks(49);
        assert_eq!(bench.robot.faults() & both, Faults::NONE);
        // Half a second: in this tick, not in the next.
        bench.tick();
        assert_eq!(bench.robot.faults() & both, found);
        bench.ticks(150);
        assert_eq!(bench.robot.faults() & both, found);
    }
}

// Requirement: WIRE-platform-11
#[test]
fn target_within_tolerance_is_reached() {
    let drives = |changes: Changes, command: &Command| {
        let mut bench = Bench::with(Mode::Normal, changes);
        for _ in 0..20 {
            bench.drive(command);
        }
        bench.robot.state() == State::Moving
    };
    let wide: Changes = &[(POSITION_TOLERANCE, 20_000), (ROTATION_TOLERANCE, 0x1000)];
    // 10 mm, and an 18th of a turn of which a 16th is allowed.
    for command in [go(10, 0), go(0, 5)] {
        assert!(drives(&[], &command), "{command:?}");
        assert!(!drives(wide, &command), "{command:?}");
    }
    assert!(drives(&[(POSITION_TOLERANCE, 20_000)], &go(0, 5)));
    assert!(drives(&[(ROTATION_TOLERANCE, 0x1000)], &go(10, 0)));
}

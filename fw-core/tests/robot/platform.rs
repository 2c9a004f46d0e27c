//! Every field of page 0x03 changes what the robot does, and how.
//!
//! Not here: `layout_version`, `layout_length` and `crc`, which say what the page is; `log_baud`, which the
//! registers obey; `bearings.right` and `bearings.left`, which only the Pi's map uses.

use crate::{duty, go, percent, Bench};
use fw_core::eeprom::{Platform, FIELDS};
use fw_core::robot::TickOutput;
use fw_core::types::{Faults, RangefinderId};
use fw_core::wire::{Command, Mode, Report, State};
use std::f64::consts::{PI, TAU};

type Change = fn(&mut Platform);

fn bench(mode: Mode, change: Change) -> Bench {
    Bench::new(mode, |config| change(&mut config.platform))
}

#[test]
fn platform_fields_are_all_tested() {
    let here = [
        "counts_per_turn",
        "wheel_diameter_left",
        "wheel_diameter_right",
        "track",
        "signs",
        "rangefinders",
        "bearings.front",
        "servo",
        "stop_deadline",
        "dead_zone_left",
        "dead_zone_right",
        "limit_left",
        "limit_right",
        "battery_warn",
        "battery_cutoff",
        "position_tolerance",
        "rotation_tolerance",
        "servo_travel",
    ];
    let elsewhere = [
        "layout_version",
        "layout_length",
        "bearings.right",
        "bearings.left",
        "log_baud",
        "gyro",
        "log_period",
    ];
    let mut names: Vec<_> = here.into_iter().chain(elsewhere).collect();
    let mut page: Vec<_> = FIELDS
        .iter()
        .filter(|field| field.address >= 0x0300)
        .map(|field| field.name)
        .collect();
    names.sort_unstable();
    page.sort_unstable();
    assert_eq!(names, page);
}

/// Where so many counts of both wheels lead from rest: millimetres along x, and radians.
fn rolled(change: Change, left: i32, right: i16) -> (f64, f64) {
    let mut bench = Bench::new(Mode::Normal, |config| {
        config.platform.encoder_left_reversed = false;
        config.platform.encoder_right_reversed = false;
        change(&mut config.platform);
    });
    for _ in 0..100 {
        bench.roll(left, right);
    }
    let pose = bench.frame(&Command::default()).pose;
    let turn = f64::from(pose.rotation) / 32_768.0;
    let turn = if turn > 0.5 { turn - 1.0 } else { turn };
    (f64::from(pose.x) / 1000.0, turn * TAU)
}

// Requirement: WIRE-platform-2
#[test]
fn geometry_fields_scale_the_pose() {
    let changes: [Change; 6] = [
        |_| {},
        |platform| platform.counts_per_turn = 1000,
        |platform| platform.wheel_diameter_left = 90_000,
        |platform| platform.wheel_diameter_right = 70_000,
        |platform| platform.track = 250_000,
        |platform| {
            platform.counts_per_turn = 60_000;
            (platform.wheel_diameter_left, platform.wheel_diameter_right) = (200_000, 300_000);
            platform.track = 1_000_000;
        },
    ];
    for (nth, change) in changes.into_iter().enumerate() {
        let mut platform = Platform::FIRST_BOARD;
        change(&mut platform);
        let way = |diameter: u32, counts: i16| {
            f64::from(diameter) / 1000.0 * PI * 100.0 * f64::from(counts)
                / f64::from(platform.counts_per_turn)
        };
        for (left, right) in [(3, 3), (-1, 1), (0, 1)] {
            let (one, other) = (
                way(platform.wheel_diameter_left, left),
                way(platform.wheel_diameter_right, right),
            );
            let (x, turn) = rolled(change, left.into(), right);
            let turned = (other - one) / (f64::from(platform.track) / 1000.0);
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

// Requirement: WIRE-platform-3
#[test]
fn sign_fields_reverse_encoders_and_motors() {
    let (ahead, _) = rolled(|_| {}, 3, 3);
    assert!(ahead > 19.0);
    let both: Change = |platform| {
        platform.encoder_left_reversed = true;
        platform.encoder_right_reversed = true;
    };
    let (back, _) = rolled(both, 3, 3);
    assert!((ahead + back).abs() < 0.001, "{back}");
    let (x, turn) = rolled(|platform| platform.encoder_left_reversed = true, 1, 1);
    assert!(x.abs() < 0.001 && turn > 0.1, "counter-clockwise: {turn}");
    let (x, turn) = rolled(|platform| platform.encoder_right_reversed = true, 1, 1);
    assert!(x.abs() < 0.001 && turn < -0.1, "clockwise: {turn}");

    let told = |change: Change| {
        let mut bench = bench(Mode::TuneRotate, change);
        bench.frame(&percent(40.0));
        let outputs = bench.tick();
        (duty(outputs.left), duty(outputs.right))
    };
    assert_eq!(told(|_| {}), (-4000, 4000));
    assert_eq!(
        told(|platform| platform.motor_left_reversed = true),
        (4000, 4000)
    );
    assert_eq!(
        told(|platform| platform.motor_right_reversed = true),
        (-4000, -4000)
    );
}

// Requirement: WIRE-platform-4
#[test]
fn fitted_rangefinders_are_triggered() {
    let changes: [Change; 4] = [
        |platform| platform.rangefinders = 0,
        |platform| platform.rangefinders = 1,
        |platform| platform.rangefinders = 2,
        |platform| platform.rangefinders = 3,
    ];
    for (fitted, change) in changes.into_iter().enumerate() {
        let mut bench = bench(Mode::Normal, change);
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
fn swept(change: Change) -> Vec<(u16, u16)> {
    let mut bench = Bench::new(Mode::GuardedSweep, |config| {
        config.platform.servo = true;
        change(&mut config.platform);
    });
    let (mut pulse, mut readings) = (0, Vec::new());
    while readings.len() < 10 {
        bench.frame(&Command::default());
        let TickOutput { servo, trigger, .. } = bench.tick();
        if let Some(which) = trigger {
            assert_eq!(which, RangefinderId::Front);
            let rise = bench.sample.now.after(500);
            bench.robot.on_echo(which, rise, rise.after(6_000));
            let mut report = Report::default();
            // The reply is one frame behind what it answers.
            for _ in 0..2 {
                report = bench.frame(&Command::default());
            }
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
    let plain = swept(|_| {});
    assert_eq!(plain[0], (1000, 0xC000));
    let step = plain[1].1.wrapping_sub(plain[0].1);
    // A pulse is whole microseconds.
    assert!(step.abs_diff(1820) < 20, "{step}");
    let turned = swept(|platform| platform.bearings[0] = 0x1000);
    let reversed = swept(|platform| platform.servo_reversed = true);
    for (nth, (pulse, bearing)) in plain.iter().enumerate() {
        assert_eq!(turned[nth], (*pulse, bearing.wrapping_add(0x1000)));
        assert_eq!(reversed[nth], (*pulse, bearing.wrapping_neg()));
    }
    let narrow = swept(|platform| platform.servo_travel = 0x4000);
    assert_eq!(narrow[0], (1000, 0xE000));
    assert_eq!(narrow[9], (2000, 0x2000));

    let pulses = |change: Change| {
        let mut bench = bench(Mode::Normal, change);
        bench.frame(&Command::default());
        (0..20)
            .filter_map(|_| bench.tick().servo)
            .collect::<Vec<_>>()
    };
    assert!(pulses(|_| {}).is_empty());
    assert_eq!(pulses(|platform| platform.servo = true), [1500; 10]);
}

// Requirement: WIRE-platform-8
#[test]
fn stop_deadline_field_sets_time() {
    for (ticks, change) in [
        (2, (|platform| platform.stop_deadline = 20) as Change),
        (25, |_| {}),
        (200, |platform| platform.stop_deadline = 2000),
    ] {
        let mut bench = bench(Mode::TuneMove, change);
        bench.frame(&percent(1.0));
        let stopped = (1..=400).find(|_| {
            bench.tick();
            bench.robot.state() == State::Stopped
        });
        assert_eq!(stopped, Some(ticks));
    }
}

/// What the motors are told in the first tick towards a target.
fn first_duties(change: Change, command: &Command) -> (i32, i32) {
    let mut bench = bench(Mode::Normal, change);
    bench.frame(command);
    let outputs = bench.tick();
    (duty(outputs.left), duty(outputs.right))
}

// Requirement: WIRE-platform-9, WIRE-eeprom-6
#[test]
fn dead_zone_and_limit_bound_the_duty() {
    let none: Change = |platform| (platform.dead_zone_left, platform.dead_zone_right) = (0, 0);
    let near = go(6, 0);
    let (left, right) = first_duties(none, &near);
    assert_eq!(left, right);
    assert!((100..6000).contains(&left), "{left}");
    let (raised, same) = first_duties(
        |platform| (platform.dead_zone_left, platform.dead_zone_right) = (3000, 0),
        &near,
    );
    assert!(
        raised > 3000 && (raised - left).abs_diff(3000) < 900,
        "{raised} {left}"
    );
    assert!(same.abs_diff(right) < 900, "{same} {right}");
    let (same, raised) = first_duties(
        |platform| (platform.dead_zone_left, platform.dead_zone_right) = (0, 3000),
        &near,
    );
    assert!(
        raised > 3000 && same.abs_diff(left) < 900,
        "{raised} {same}"
    );

    let far = go(3000, 0);
    let (left, right) = first_duties(none, &far);
    assert!(left > 9000 && right > 9000, "{left} {right}");
    for (change, limits) in [
        (
            (|platform| platform.limit_left = 4000) as Change,
            (4000, 10_000),
        ),
        (|platform| platform.limit_right = 5000, (10_000, 5000)),
    ] {
        let (left, right) = first_duties(change, &far);
        assert!(left <= limits.0 && right <= limits.1, "{left} {right}");
        let (left, right) = first_duties(change, &go(0, 50));
        assert!(
            left.abs() <= limits.0 && right.abs() <= limits.1,
            "{left} {right}"
        );
    }
}

// Requirement: WIRE-fault-3, WIRE-fault-4, WIRE-platform-10
#[test]
fn battery_fields_set_warning_and_cutoff() {
    // Two seconds of cells at 3.6 V.
    let faults = |change: Change| {
        let mut bench = bench(Mode::Normal, change);
        for _ in 0..200 {
            bench.tick();
        }
        bench.robot.faults() & (Faults::BATTERY_LOW | Faults::BATTERY_CUTOFF)
    };
    assert_eq!(faults(|_| {}), Faults::NONE);
    assert_eq!(
        faults(|platform| platform.battery_warn = 3590),
        Faults::NONE
    );
    assert_eq!(
        faults(|platform| platform.battery_warn = 3610),
        Faults::BATTERY_LOW
    );
    let cut = |platform: &mut Platform| {
        (platform.battery_warn, platform.battery_cutoff) = (3610, 3610);
    };
    assert_eq!(faults(cut), Faults::BATTERY_LOW | Faults::BATTERY_CUTOFF);
    // 0 is off, however empty the cells are.
    let mut off = bench(Mode::Normal, |platform| {
        (platform.battery_warn, platform.battery_cutoff) = (0, 0);
    });
    let mut on = bench(Mode::Normal, |_| {});
    for bench in [&mut off, &mut on] {
        bench.words = [500, 500];
        for _ in 0..200 {
            bench.tick();
        }
    }
    let both = Faults::BATTERY_LOW | Faults::BATTERY_CUTOFF;
    assert_eq!(
        (off.robot.faults() & both, on.robot.faults() & both),
        (Faults::NONE, both)
    );
}

// Requirement: WIRE-platform-11
#[test]
fn target_within_tolerance_is_reached() {
    let drives = |change: Change, command: &Command| {
        let mut bench = bench(Mode::Normal, change);
        for _ in 0..20 {
            bench.frame(command);
            bench.tick();
        }
        bench.robot.state() == State::Moving
    };
    let wide: Change = |platform| {
        (platform.position_tolerance, platform.rotation_tolerance) = (20_000, 0x1000);
    };
    // 10 mm, and an 18th of a turn of which a 16th is allowed.
    for command in [go(10, 0), go(0, 5)] {
        assert!(drives(|_| {}, &command), "{command:?}");
        assert!(!drives(wide, &command), "{command:?}");
    }
    assert!(drives(
        |platform| platform.position_tolerance = 20_000,
        &go(0, 5)
    ));
    assert!(drives(
        |platform| platform.rotation_tolerance = 0x1000,
        &go(10, 0)
    ));
}

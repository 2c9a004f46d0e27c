//! The tuning modes: the duty as the Pi says it, and what is measured, on the wire and in the log. And
//! the tuning of a cell.

use super::*;
use std::vec::Vec;

#[test]
fn percentage_rounds_to_nearest_hundredth() {
    for (value, hundredths) in [
        (0.0, 0),
        (0.0049, 0),
        (0.0051, 1),
        (-0.0049, 0),
        (-0.0051, -1),
        (33.333, 3333),
        (-66.666, -6667),
        (99.9949, 9999),
        (99.9951, 10_000),
        (100.0, 10_000),
        (-100.0, -10_000),
    ] {
        let duty = percent(Binary64(f64::to_bits(value)));
        assert_eq!(duty, Duty::saturating(hundredths), "{value}");
    }
}

// Requirement: WIRE-modes-2
#[test]
fn tuning_duty_sets_state_moving() {
    for mode in [Mode::TuneRotate, Mode::TuneMove] {
        let mut bench = Bench::new(mode);
        for (percent, state) in [
            (0.0, State::Ready),
            (-20.0, State::Moving),
            (0.0, State::Ready),
        ] {
            bench.drive(&tune(percent));
            assert_eq!(bench.robot.state(), state, "{percent}");
        }
    }
}

/// The second figure of the sample's line; the wheels are turned by hand.
fn sample(log: &str) -> f64 {
    let sample = |line| str::split_once(line, ": T 0.00 ");
    let (_, figure) = log.lines().find_map(sample).expect("a sample");
    let (_, decimals) = figure.split_once('.').expect("a point");
    assert_eq!(decimals.len(), 3);
    figure.parse().expect("a number")
}

// Requirement: DOC-5.2.2-2, WIRE-modes-3, WIRE-modes-4, WIRE-log-8, DOC-5.2.3-4
#[test]
fn tuning_measurement_is_in_reply_and_log() {
    // A count of both wheels of 80 mm at 3840 counts is 80·π/3840 mm, and against each other at a
    // track of 125 mm 80·360/(3840·125) = 0.06 degrees. The heading is exact; a tick's path is kept to
    // 2⁻¹⁶ mm.
    let millimetres = 80.0 * core::f64::consts::PI / 3840.0;
    for (mode, left, a_count, a_tick) in [
        (Mode::TuneRotate, -1, 0.06, 0.0),
        (Mode::TuneMove, 1, millimetres, 1.0 / 65_536.0),
    ] {
        let mut bench = Bench::new(mode);
        bench.frame(&tune(0.0));
        // 30 counts a tick, more than a turn one way and more than two the other.
        let mut counts = 0;
        for tick in 1..=700 {
            let ahead = if tick <= 220 { 30 } else { -30 };
            counts += i32::from(ahead);
            bench.roll(left * i32::from(ahead), ahead);
            bench.log = Log::new();
            bench.tick();
            let truth = f64::from(counts) * a_count;
            // A tenth of the last digit.
            let slack = 1e-4 + f64::from(tick) * a_tick;
            let replied = f64::from_bits(bench.frame(&tune(0.0)).measurement.0);
            assert!((replied - truth).abs() <= slack, "{replied} {truth}");
            // Cut off after the third decimal.
            let logged = sample(bench.log());
            let low = truth - logged;
            assert!((-slack..=0.001 + slack).contains(&low), "{logged} {truth}");
        }
    }
}

#[test]
fn stop_order_ends_tuning_duty() {
    let mut bench = Bench::new(Mode::GuardedTuneRotate);
    bench.frame(&tune(30.0));
    let stop = with_order(Order::Stop, tune(30.0));
    for (command, percent) in [(tune(30.0), "30.00"), (stop, "0.00"), (tune(30.0), "0.00")] {
        bench.log = Log::new();
        bench.drive(&command);
        // After a change of state there are two lines.
        let samples: Vec<&str> = bench.log().lines().filter(|l| l.contains(": T ")).collect();
        assert_eq!(samples.len(), 1);
        let sample = std::format!(": T {percent} 0.000");
        assert!(samples[0].ends_with(&sample), "{samples:?}");
    }
}

// Requirement: WIRE-deadline-5
#[test]
fn tune_move_after_stop_holds_the_new_heading() {
    let mut bench = Bench::new(Mode::TuneMove);
    bench.frame(&tune(30.0));
    bench.ticks(30);
    assert_eq!(bench.robot.state(), State::Stopped);
    // Turned by hand: against the motors' order it would turn back.
    bench.roll(0, -300);
    bench.tick();
    bench.frame(&tune(0.0));
    assert_eq!(motors(bench.drive(&tune(30.0))), [run(3000); 2]);
}

// Requirement: WIRE-status-2
#[test]
fn percentage_of_the_resuming_frame_is_driven() {
    let mut bench = Bench::new(Mode::GuardedTuneRotate);
    assert!(!runs(bench.drive(&with_order(Order::Stop, tune(0.0)))));
    let outputs = bench.drive(&with_order(Order::Resume, tune(30.0)));
    assert_eq!(outputs.right, run(3000));
}

/// The cell is at 3.9 V.
fn tune_cell(cell: u8) -> Command {
    let tune = CellCode { cell, voltage: 780 };
    Command {
        tune,
        ..Command::default()
    }
}

// Requirement: DOC-5.1.3-3, DOC-5.1.3-4, WIRE-battery-2
#[test]
fn tuned_cell_logs_its_upper_resistor() {
    let mut bench = Bench::new(Mode::Normal);
    bench.tick();
    // The pins' voltages; 3.9 V stand for one cell after the other.
    let pin = [3428.0, 3574.0].map(|word: f64| word / 4095.0 * 3.3);
    let cell = pin[0] * 43.0 / 33.0;
    for (tap, lower, below) in [(0_u8, 33_000.0, 0.0), (1, 22_000.0, cell)] {
        bench.log = Log::new();
        bench.frame(&Command::default());
        assert_eq!(bench.log(), "", "nothing to tune");
        bench.frame(&tune_cell(tap));
        let start = std::format!("I00000: tuned tap {}: upper resistor ", tap + 1);
        let ohm = bench.log().strip_prefix(&start).expect("a line");
        let ohm: f64 = ohm.strip_suffix(" ohm\n").unwrap().parse().unwrap();
        let truth = lower * ((below + 3.9) / pin[usize::from(tap)] - 1.0);
        // A step of the tap's voltage, 2⁻¹⁶ V, is 0.25 and 0.3 ohm.
        assert!((ohm - truth).abs() < 1.0, "{ohm} {truth}");
    }
}

// Requirement: WIRE-battery-2
#[test]
fn cell_is_tuned_in_every_mode_and_with_a_target() {
    for &mode in Mode::ALL {
        let mut bench = Bench::new(mode);
        bench.tick();
        bench.log = Log::new();
        let apply = matches!(mode, Mode::Normal | Mode::GuardedNormal);
        bench.frame(&Command {
            apply,
            ..tune_cell(0)
        });
        assert!(bench.log().contains("tuned tap 1"), "{mode:?}");
        // Also while it is stopped.
        bench.ticks(30);
        bench.log = Log::new();
        bench.frame(&tune_cell(1));
        assert!(bench.log().contains("tuned tap 2"), "{mode:?}");
    }
}

// Requirement: WIRE-log-3
#[test]
fn link_line_comes_between_tuning_lines() {
    let mut bench = Bench::new(Mode::GuardedTuneRotate);
    bench.frame(&tune(0.0));
    bench.ticks(2);
    assert!(bench.log().contains(": L "));
}

#[test]
fn unread_cell_logs_no_resistor() {
    let mut bench = Bench::new(Mode::Normal);
    bench.frame(&tune_cell(0));
    assert_eq!(bench.log(), "");
}

#[test]
fn measurement_beyond_its_type_keeps_its_sign() {
    for mode in [Mode::TuneRotate, Mode::TuneMove] {
        let mut bench = Bench::new(mode);
        for end in [i64::MAX, i64::MIN, 1 << 62] {
            bench.robot.measured = end;
            assert_eq!(bench.robot.thousandths() > 0, end > 0);
            let measured = f64::from_bits(bench.robot.measurement().0);
            assert!(measured.abs() > 1e9, "{measured}");
            assert_eq!(measured > 0.0, end > 0, "{measured}");
        }
    }
}

// Requirement: WIRE-log-7
#[test]
fn rotation_of_thousands_of_turns_is_logged() {
    let mut bench = Bench::new(Mode::TuneRotate);
    bench.robot.measured = -(10_000 << 32);
    assert_eq!(bench.robot.thousandths(), -3_600_000_000);
}

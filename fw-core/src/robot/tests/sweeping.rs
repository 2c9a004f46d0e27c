//! The servo of the sweep mode, as the robot moves it.

use super::*;
use std::vec::Vec;

/// Ticks with a frame every so many, 0 for none, and an echo for every trigger: the bearings that the
/// echoes were of, as the replies tell them, and the pulses.
fn swept(bench: &mut Bench, ticks: u32, frame_every: u32) -> (Vec<u16>, u32) {
    let (mut bearings, mut pulses) = (Vec::new(), 0);
    for tick in 0..ticks {
        if frame_every != 0 && tick % frame_every == 0 {
            bench.frame(&Command::default());
        }
        let outputs = bench.tick();
        pulses += u32::from(outputs.servo.is_some());
        if let Some(which) = outputs.trigger {
            assert_eq!(which, RangefinderId::Front);
            bench.echo(which, 1_000);
            bearings.push(bench.robot.report.bearing);
        }
    }
    (bearings, pulses)
}

fn sweeper() -> Bench {
    Bench::new(Mode::GuardedSweep)
}

// Requirement: DOC-2.2-3, WIRE-bearing-3
#[test]
fn servo_scan_swings_while_link_is_alive() {
    let mut bench = sweeper();
    assert_eq!(swept(&mut bench, 100, 0), (Vec::new(), 0), "no frame yet");
    let report = bench.frame(&Command::default());
    let front = (report.bearing, report.ranges[0]);
    assert_eq!(front, (0, DistanceCode::NONE), "no reading yet");
    // Half a second to get to the first end, then a bearing every 60 ms: 18 steps of 10° there, and
    // back again.
    let (bearings, pulses) = swept(&mut bench, 50 + 37 * 6, 10);
    assert_eq!(bearings.len(), 37);
    assert_eq!(pulses, 25 + 37 * 3);
    for (step, bearing) in (0_i32..).zip(bearings) {
        let degrees = f64::from(bearing.cast_signed()) * 360.0 / 65_536.0;
        let expected = 90 - (step - 18).abs() * 10;
        assert!((degrees - f64::from(expected)).abs() < 0.1, "{degrees}");
    }
}

// Requirement: WIRE-obstacle-4
#[test]
fn way_back_to_a_target_is_not_limited_in_length() {
    let mut bench = Bench::with(Mode::GuardedSweep, &[(fields::REVERSE_DISTANCE, 10)]);
    for _ in 0..40 {
        let duties = motors(bench.drive(&go(-500))).map(duty);
        assert!(duties.iter().all(|&duty| duty < -500), "{duties:?}");
        bench.roll(-8, -8);
    }
}

// Requirement: WIRE-servo-1
#[test]
fn servo_scan_rests_in_silence_and_when_faulted() {
    let mut bench = sweeper();
    let (first, _) = swept(&mut bench, 200, 10);
    assert!(!first.is_empty());
    // The last frame was 100 ms before: of the next ticks the fifteenth is 250 ms after it, and silent.
    let (_, pulses) = swept(&mut bench, 14, 0);
    assert_eq!(pulses, 7);
    assert_ne!(bench.robot.report.ranges[0], DistanceCode::NONE);
    // What it measured is forgotten in the tick in which it rests.
    assert_eq!(swept(&mut bench, 1, 0), (Vec::new(), 0), "silence");
    assert_eq!(bench.robot.report.ranges[0], DistanceCode::NONE);
    // Nor is it trusted to drive by.
    assert!(bench.robot.obstacle.track().ahead.is_some());
    assert_eq!(swept(&mut bench, 99, 0), (Vec::new(), 0), "silence");
    assert_eq!(bench.robot.obstacle.track().ahead, None);
    let (again, _) = swept(&mut bench, 200, 10);
    assert_eq!(again, first, "from its first end again");
    bench.raise(Faults::LEFT_STALLED);
    assert_ne!(bench.robot.report.ranges[0], DistanceCode::NONE);
    assert_eq!(swept(&mut bench, 1, 10), (Vec::new(), 0), "faulted");
    assert_eq!(bench.robot.report.ranges[0], DistanceCode::NONE);
    assert_eq!(swept(&mut bench, 99, 10), (Vec::new(), 0), "faulted");
}

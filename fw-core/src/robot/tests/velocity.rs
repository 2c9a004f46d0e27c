//! Mode 0x30: driven by velocity, the gyroscope's angle, the sweep, and the obstacle stop.

use super::*;
use crate::wire::GyroCode;
use std::vec::Vec;

fn drive(mm_s: i32) -> Command {
    let mut drive = turn(0);
    drive.velocity.forward = mm_s * 1000;
    drive
}

/// Where it stands.
fn turn(yaw_rate: i32) -> Command {
    let velocity = Velocity {
        forward: 0,
        yaw_rate,
    };
    Command {
        velocity,
        ..Command::default()
    }
}

/// A sixteenth of a turn a second.
fn spin() -> Command {
    turn(1 << 28)
}

/// Some ticks with a frame in each: whether the motors run, and the last report.
fn follow(bench: &mut Bench, command: &Command, ticks: u32) -> (bool, Report) {
    let mut last = (false, Report::default());
    for _ in 0..ticks {
        let report = bench.frame(command);
        last = (runs(bench.tick()), report);
    }
    last
}

// Requirement: WIRE-velocity-7
#[test]
fn velocity_counts_again_one_frame_after_resume() {
    let mut bench = Bench::new(Mode::GuardedVelocity);
    assert!(follow(&mut bench, &drive(80), 3).0);
    assert!(!follow(&mut bench, &with_order(Order::Stop, drive(80)), 1).0);
    assert!(!follow(&mut bench, &drive(80), 5).0);
    assert_eq!(bench.robot.state(), State::Stopped);
    assert!(!follow(&mut bench, &with_order(Order::Resume, drive(80)), 3).0);
    assert_eq!(bench.robot.state(), State::Ready);
    let (runs, report) = follow(&mut bench, &drive(80), 3);
    assert!(runs);
    assert_eq!(bench.robot.state(), State::Moving);
    assert_eq!(report.state, State::Moving);
    // A frame with an order is a command to stand.
    assert!(!follow(&mut bench, &with_order(Order::Resume, drive(80)), 30).0);
    // Nothing is left of a turn either.
    let mut bench = Bench::new(Mode::GuardedVelocity);
    assert!(follow(&mut bench, &spin(), 3).0);
    assert!(!follow(&mut bench, &with_order(Order::Stop, spin()), 2).0);
    assert!(!follow(&mut bench, &with_order(Order::Resume, spin()), 1).0);
    assert!(!follow(&mut bench, &drive(0), 1).0);
}

// Requirement: WIRE-deadline-1, WIRE-deadline-5
#[test]
fn velocity_without_frames_brakes_at_deadline() {
    let mut bench = Bench::new(Mode::GuardedVelocity);
    follow(&mut bench, &drive(80), 5);
    let running = (0..40).take_while(|_| runs(bench.tick())).count();
    assert_eq!(running, 23);
    assert_eq!(bench.robot.state(), State::Stopped);
    let outputs = bench.drive(&with_order(Order::Resume, drive(0)));
    assert_eq!(motors(outputs), BRAKE);
}

#[test]
fn velocity_is_motion_from_its_first_tick_until_wheels_are_held() {
    let mut bench = Bench::new(Mode::GuardedVelocity);
    for command in [spin(), drive(80)] {
        bench = Bench::new(Mode::GuardedVelocity);
        assert!(follow(&mut bench, &command, 1).0);
        assert_eq!(bench.robot.state(), State::Moving);
    }
    follow(&mut bench, &drive(80), 9);
    assert!(follow(&mut bench, &drive(0), 1).0);
    assert_eq!(bench.robot.state(), State::Moving);
}

#[test]
fn zero_velocity_holds_wheels_and_is_ready() {
    let mut bench = Bench::new(Mode::GuardedVelocity);
    for _ in 0..30 {
        assert_eq!(motors(bench.drive(&drive(0))), BRAKE);
        assert_eq!(bench.robot.state(), State::Ready);
    }
}

#[test]
fn yaw_rate_beyond_its_limit_is_clipped() {
    // A 256th of a turn a second.
    let mut bench = Bench::with(Mode::GuardedVelocity, &[(fields::MAX_YAW_RATE, 0x100)]);
    for (yaw_rate, clipped) in [(1 << 25, true), (1 << 24, false)] {
        let (_, report) = follow(&mut bench, &turn(yaw_rate), 5);
        assert_eq!(report.clipped, clipped);
    }
}

#[test]
fn obstacle_line_comes_with_the_report() {
    let mut bench = Bench::new(Mode::GuardedVelocity);
    follow(&mut bench, &drive(10), 6);
    bench.log = Log::new();
    for _ in 0..20 {
        bench.drive(&drive(150));
        let is_logged = bench.log().contains("obstacle: speed limited");
        assert_eq!(is_logged, bench.robot.report.obstacle_limited);
    }
    assert!(bench.robot.report.obstacle_limited);
}

// Requirement: WIRE-status-7, WIRE-obstacle-2, WIRE-obstacle-6
#[test]
fn blind_speed_is_reported_and_logged() {
    let mut bench = Bench::new(Mode::GuardedVelocity);
    bench.drive(&drive(150));
    let report = bench.frame(&drive(150));
    assert!(report.clipped, "by the first tick's acceleration");
    let (_, report) = follow(&mut bench, &drive(150), 3);
    assert!(report.obstacle_limited && report.clipped);
    assert!(bench.log().contains("obstacle: speed limited\n"));
    let (_, report) = follow(&mut bench, &drive(0), 90);
    assert!(!report.obstacle_limited && !report.clipped);
    assert!(!bench.log().contains("way free"));
    follow(&mut bench, &drive(0), 20);
    assert_eq!(bench.log().matches("obstacle: way free\n").count(), 1);
    follow(&mut bench, &drive(150), 3);
    let (_, report) = follow(&mut bench, &with_order(Order::Stop, drive(150)), 3);
    assert!(!report.obstacle_limited && !report.clipped, "standing");
}

// Requirement: WIRE-obstacle-2
#[test]
fn silent_front_sensor_is_blind_again() {
    let far = (Some(11_650), 150, false);
    // 2 m and no echo; 170 mm and beyond the range. Each together less than a stall takes.
    for phases in [
        &[far, (None, 150, true), far][..],
        &[(Some(985), 80, true), (Some(38_000), 80, false)],
    ] {
        let mut bench = Bench::new(Mode::GuardedVelocity);
        for &(echo_us, mm_s, limited) in phases {
            let mut report = Report::default();
            for _ in 0..30 {
                report = bench.frame(&drive(mm_s));
                if let (Some(which), Some(width)) = (bench.tick().trigger, echo_us) {
                    bench.echo(which, width);
                }
            }
            assert_eq!(report.obstacle_limited, limited, "{echo_us:?}");
        }
    }
}

/// Awaits the front sensor's trigger and answers it with an echo of this width, microseconds.
fn echo_ahead(bench: &mut Bench, width_us: u32) {
    assert!((0..100).any(|_| bench.tick().trigger == Some(RangefinderId::Front)));
    bench.echo(RangefinderId::Front, width_us);
}

// Requirement: WIRE-obstacle-2
#[test]
fn third_trigger_without_an_echo_voids_the_last() {
    let mut bench = Bench::new(Mode::GuardedVelocity);
    bench.frame(&drive(0));
    echo_ahead(&mut bench, 11_650);
    bench.ticks(2);
    let seen = bench.robot.obstacle.max_forward();
    while bench.robot.obstacle.max_forward() == seen {
        assert!(bench.robot.stats(RangefinderId::Front).missing <= 3);
        bench.tick();
    }
    // A time-out is no second miss of its trigger.
    assert_eq!(bench.robot.stats(RangefinderId::Front).missing, 3);
}

// Requirement: WIRE-obstacle-2
#[test]
fn echo_limits_the_second_tick_after_it() {
    let mut bench = Bench::new(Mode::GuardedVelocity);
    bench.frame(&drive(80));
    echo_ahead(&mut bench, 985);
    bench.drive(&drive(80));
    assert!(!bench.robot.report.obstacle_limited);
    bench.tick();
    assert!(bench.robot.report.obstacle_limited);
}

// Requirement: WIRE-obstacle-5
#[test]
fn pose_target_is_held_back_before_obstacle() {
    let mut bench = Bench::new(Mode::GuardedNormal);
    let apply = go(2000);
    let mut limited = 0;
    for _ in 0..200 {
        limited += u32::from(bench.frame(&apply).obstacle_limited);
        if let Some(which) = bench.tick().trigger {
            // 170 mm: overhang and stop distance.
            bench.echo(which, 985);
        }
    }
    assert!(limited > 150, "{limited}");
    assert_eq!(bench.robot.state(), State::Moving);
    assert!(!bench.robot.faults().intersects(Faults::BLOCKING));
    assert!(bench.log().contains("obstacle: speed limited\n"));
    for _ in 0..3 {
        bench.drive(&with_order(Order::Stop, apply));
    }
    assert!(!bench.frame(&apply).obstacle_limited, "standing");
}

// Requirement: WIRE-gyro-3
#[test]
fn robot_without_gyro_reports_no_angle() {
    let mut bench = Bench::new(Mode::GuardedVelocity);
    assert_eq!(follow(&mut bench, &drive(50), 50).1.gyro, GyroCode::NONE);
}

// Requirement: WIRE-obstacle-5
#[test]
fn target_held_is_left_with_the_present_limit() {
    let mut bench = Bench::with(Mode::GuardedNormal, &[(fields::BLIND_SPEED, 200)]);
    follow(&mut bench, &go(0), 10);
    let near = Some(crate::types::Millimetres::default());
    bench.robot.obstacle.on_range(0, near);
    follow(&mut bench, &go(0), 1);
    assert_eq!(bench.robot.state(), State::Ready);
    bench.roll(-300, -300);
    follow(&mut bench, &go(0), 1);
    assert!(bench.robot.report.obstacle_limited);
}

#[test]
fn sweep_without_echoes_keeps_its_cycle_and_homing_is_silent() {
    let sweep = Command {
        sweep: 0x4000,
        ..drive(0)
    };
    let mut bench = Bench::with(Mode::GuardedVelocity, &[(fields::SERVO, 1)]);
    let mut front = |ticks: core::ops::Range<u32>| {
        let is_front = |_: &u32| bench.drive(&sweep).trigger == Some(RangefinderId::Front);
        ticks.filter(is_front).collect::<Vec<_>>()
    };
    // From the third on, past the first end.
    let ticks = front(0..400);
    assert!(ticks.len() > 30 && ticks.windows(2).skip(2).all(|two| two[1] - two[0] == 9));
    assert!((0..100).any(|_| !front(0..1).is_empty()));
    bench.raise(Faults::LEFT_STALLED);
    bench.ticks(5);
    bench.frame(&clearing(Faults::LEFT_STALLED, sweep));
    for tick in 0..50 {
        assert_eq!(bench.drive(&sweep).trigger, None, "{tick}");
    }
}

#[test]
fn reversed_servo_is_triggered_at_the_same_times() {
    let ticks = [0, 1].map(|reversed| {
        let servo = [(fields::SERVO, 1), (fields::SERVO_REVERSED, reversed)];
        let mut bench = Bench::with(Mode::GuardedVelocity, &servo);
        let is_trigger = |tick: &u32| {
            let sweep = if *tick < 205 { 0x4000 } else { 0 };
            let outputs = bench.drive(&Command { sweep, ..drive(0) });
            outputs.trigger.is_some()
        };
        (0..400).filter(is_trigger).collect::<Vec<_>>()
    });
    assert_eq!(ticks[0], ticks[1]);
}

/// Every trigger of some seconds, all answered: sensor, tick, bearing of the reading in degrees.
fn triggers(sweep: u16, servo: u64, order: Order) -> Vec<(RangefinderId, u32, f64)> {
    let mut bench = Bench::with(Mode::GuardedVelocity, &[(fields::SERVO, servo)]);
    let mut all = Vec::new();
    for tick in 0..400 {
        let report = bench.frame(&Command {
            sweep,
            order,
            ..drive(0)
        });
        if let Some(which) = bench.tick().trigger {
            bench.echo(which, 4500);
            let bearing = report.bearing.cast_signed();
            all.push((which, tick, f64::from(bearing) * 360.0 / 65_536.0));
        }
    }
    all
}

// Requirement: WIRE-sweep-1
#[test]
fn sweep_keeps_commanded_width_and_every_sensor_cycle() {
    for (sweep, servo, order, width) in [
        (0, 1, Order::None, 0.0),
        (0x1555, 1, Order::None, 30.0),
        (0x1555, 1, Order::Stop, 30.0),
        (0xFFFF, 1, Order::None, 90.0),
        (0x1555, 0, Order::None, 0.0),
    ] {
        let all = triggers(sweep, servo, order);
        let (first, last) = (all[0].1, all[all.len() - 1].1);
        assert_eq!(all.len(), (last - first) as usize / 2 + 1, "every 20 ms");
        assert!(all.windows(2).all(|two| two[0].0 != two[1].0));
        for (sign, end) in [(-1.0, "right"), (1.0, "left")] {
            let sides = all.iter().map(|trigger| sign * trigger.2);
            let most = sides.fold(0.0, f64::max);
            assert!((most - width).abs() < 0.2, "{end}: {most}");
        }
    }
}

//! Faults of the drive: detected in time, and never without a cause.

use super::*;

/// Faults detected after `fault` on the way to a far target, and the seconds this takes.
fn detect(fault: impl Fn(&mut Robot)) -> (Faults, f64) {
    let mut robot = Robot::new(&first_board(), Params::default());
    robot.controller.set_target(pose(3000.0, 0.0, 0.0));
    robot.drive(200);
    robot.faults = Faults::NONE;
    let start = robot.world.time_s();
    fault(&mut robot);
    while robot.faults.is_empty() && robot.world.time_s() - start < 5.0 {
        robot.drive(1);
    }
    (robot.faults, robot.world.time_s() - start)
}

#[test]
fn drive_fault_is_detected_within_a_second() {
    type Fault = fn(&mut Robot);
    let stalled = Faults::LEFT_STALLED | Faults::RIGHT_STALLED;
    let cases: [(Fault, Faults, f64); 8] = [
        (
            |r| r.world.faults.jammed.left = true,
            Faults::LEFT_STALLED,
            1.0,
        ),
        (
            |r| r.world.faults.jammed.right = true,
            Faults::RIGHT_STALLED,
            1.0,
        ),
        (
            |r| r.world.faults.jammed = Sides::new(true, true),
            stalled,
            1.0,
        ),
        (
            |r| r.world.faults.dead_encoder.left = true,
            Faults::LEFT_STALLED,
            1.0,
        ),
        (
            |r| r.world.faults.dead_encoder.right = true,
            Faults::RIGHT_STALLED,
            1.0,
        ),
        (|r| r.rolled.1 += 500, Faults::ENCODER_JUMP, 0.015),
        (|r| r.rolled.1 -= 500, Faults::ENCODER_JUMP, 0.015),
        (|r| r.rolled.1 += 20_000, Faults::ENCODER_JUMP, 0.015),
    ];
    for (number, (fault, expected, within)) in cases.into_iter().enumerate() {
        let (faults, seconds) = detect(fault);
        assert!(
            faults.intersects(expected) && seconds <= within,
            "{number}: {faults:?} {seconds}"
        );
    }
}

#[test]
fn reversed_wheel_is_detected_at_the_first_motion() {
    for (left, expected) in [
        (true, Faults::LEFT_REVERSED),
        (false, Faults::RIGHT_REVERSED),
    ] {
        // The configuration contradicts the wiring.
        let config = config_with(&[
            (fields::MOTOR_LEFT_REVERSED, left.into()),
            (fields::MOTOR_RIGHT_REVERSED, (!left).into()),
        ]);
        let mut robot = Robot::new(&config, Params::default());
        for _ in 0..200 {
            let (pose, delta) = robot.tick();
            let duty = Duty::saturating(6000);
            robot.commands = robot.controller.tune_move(duty, &pose, &delta);
            if !robot.faults.is_empty() {
                break;
            }
        }
        assert!(robot.faults.intersects(expected), "{:?}", robot.faults);
    }
}

#[test]
fn reversals_and_tuning_steps_raise_no_fault() {
    for charge in [1.0, 0.02] {
        let mut params = Params::default();
        params.battery.charge = [charge; 2];
        let mut robot = Robot::new(&first_board(), params);
        for duty in [10_000, -10_000, 5000, -5000, 3000, -10_000, 2500, 0, 10_000] {
            for _ in 0..150 {
                let _ = robot.tick();
                robot.commands = robot.controller.tune_rotate(Duty::saturating(duty));
            }
        }
        assert_eq!(robot.faults, Faults::NONE);
    }
}

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
    let (left, right) = (Faults::LEFT_STALLED, Faults::RIGHT_STALLED);
    for (wheels, expected) in [
        (Sides::new(true, false), left),
        (Sides::new(false, true), right),
        (Sides::new(true, true), left | right),
    ] {
        let (faults, seconds) = detect(|robot| robot.world.faults.jammed = wheels);
        assert!(faults.intersects(expected) && seconds <= 1.0, "{seconds}");
        if expected != left | right {
            let (faults, seconds) = detect(|robot| robot.world.faults.dead_encoder = wheels);
            assert!(faults.intersects(expected) && seconds <= 1.0, "{seconds}");
        }
    }
    for counts in [500, -500, 20_000] {
        let (faults, seconds) = detect(|robot| robot.rolled.1 += counts);
        assert!(faults.intersects(Faults::ENCODER_JUMP) && seconds <= 0.015);
    }
}

#[test]
fn reversed_wheel_is_detected_at_the_first_motion() {
    for expected in [Faults::LEFT_REVERSED, Faults::RIGHT_REVERSED] {
        let left = expected == Faults::LEFT_REVERSED;
        // The configuration contradicts the wiring.
        let config = config_with(&[
            (fields::MOTOR_LEFT_REVERSED, left.into()),
            (fields::MOTOR_RIGHT_REVERSED, (!left).into()),
        ]);
        let mut robot = Robot::new(&config, Params::default());
        for _ in 0..200 {
            robot.tune_move(Duty::saturating(6000));
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

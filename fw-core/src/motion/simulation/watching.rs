//! What is noticed of broken parts, and that nothing is where none is.

use super::*;

/// What is noticed of a fault while driving to a far pose, and after how many seconds.
fn noticed(config: &Config, params: Params, spoil: impl Fn(&mut Robot)) -> (Faults, f64) {
    let mut robot = Robot::new(config, params);
    robot.controller.set_target(pose(3000.0, 0.0, 0.0));
    settle(&mut robot, 200);
    robot.faults = Faults::NONE;
    let start = robot.world.time_s();
    spoil(&mut robot);
    while robot.faults.is_empty() && robot.world.time_s() - start < 5.0 {
        robot.drive();
    }
    (robot.faults, robot.world.time_s() - start)
}

#[test]
fn a_blocked_wheel_and_a_dead_encoder_are_noticed_within_a_second() {
    type Spoil = fn(&mut Robot);
    let spoils: [(Spoil, Faults); 4] = [
        (|r| r.world.faults.jammed.left = true, Faults::LEFT_STALLED),
        (
            |r| r.world.faults.jammed.right = true,
            Faults::RIGHT_STALLED,
        ),
        (
            |r| r.world.faults.dead_encoder.left = true,
            Faults::LEFT_STALLED,
        ),
        (
            |r| r.world.faults.dead_encoder.right = true,
            Faults::RIGHT_STALLED,
        ),
    ];
    for (spoil, expected) in spoils {
        let (faults, seconds) = noticed(&first_board(), Params::default(), spoil);
        assert!(
            faults.intersects(expected) && seconds <= 1.0,
            "{faults:?} {seconds}"
        );
    }
}

#[test]
fn a_robot_against_a_wall_is_noticed_within_a_second() {
    let (faults, seconds) = noticed(&first_board(), Params::default(), |r| {
        r.world.faults.jammed = Sides::new(true, true);
    });
    assert!(!faults.is_empty() && seconds <= 1.0, "{faults:?} {seconds}");
}

#[test]
fn a_wheel_wired_backwards_is_noticed_at_the_first_move() {
    for left in [true, false] {
        let mut config = first_board();
        // The configuration says so, the wires do not.
        config.platform.motor_left_reversed = left;
        config.platform.motor_right_reversed = !left;
        let mut robot = Robot::new(&config, Params::default());
        let mut ticks = 0;
        while robot.faults.is_empty() && ticks < 200 {
            let (pose, delta) = robot.tick();
            robot.wheels = robot
                .controller
                .tune_move(Duty::saturating(6000), &pose, &delta);
            ticks += 1;
        }
        let expected = if left {
            Faults::LEFT_REVERSED
        } else {
            Faults::RIGHT_REVERSED
        };
        assert!(robot.faults.intersects(expected), "{:?}", robot.faults);
    }
}

#[test]
fn an_encoder_that_jumps_is_noticed_at_once() {
    for by in [500, -500, 20_000] {
        let (faults, seconds) = noticed(&first_board(), Params::default(), |r| {
            r.rolled.1 += by;
        });
        assert!(
            faults.intersects(Faults::ENCODER_JUMP) && seconds < 0.015,
            "{seconds}"
        );
    }
}

#[test]
fn full_reversals_and_all_tuning_steps_look_right_on_a_weak_battery_too() {
    for charge in [1.0, 0.02] {
        let mut params = Params::default();
        params.battery.charge = [charge; 2];
        let mut robot = Robot::new(&first_board(), params);
        for duty in [10_000, -10_000, 5000, -5000, 3000, -10_000, 2500, 0, 10_000] {
            for _ in 0..150 {
                let _ = robot.tick();
                robot.wheels = robot.controller.tune_rotate(Duty::saturating(duty));
            }
        }
        assert_eq!(robot.faults, Faults::NONE);
    }
}

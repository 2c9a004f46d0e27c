//! Holding, following, halting.

use super::*;

#[test]
fn it_holds_its_place_against_a_push_that_turns_the_wheels() {
    for (left, right) in [(60.0, 60.0), (-60.0, 60.0), (-300.0, -200.0), (0.0, 500.0)] {
        let mut robot = Robot::new(&first_board(), Params::default());
        assert_all_good(&[robot.go(300.0, 100.0, 30.0, 60.0)]);
        // A hand rolls it away: the wheels turn by these degrees, the encoders see it.
        for _ in 0..50 {
            robot.push(left / 50.0, right / 50.0);
            robot.tick();
        }
        robot.drive();
        assert!(!robot.controller.arrived(), "it did not notice");
        assert_all_good(&[robot.go(300.0, 100.0, 30.0, 60.0)]);
    }
}

#[test]
fn at_rest_it_brakes_and_stays() {
    let mut robot = Robot::new(&first_board(), Params::default());
    assert_all_good(&[robot.go(200.0, 0.0, 90.0, 60.0)]);
    let before = robot.world.pose();
    for _ in 0..6000 {
        robot.drive();
        assert!(robot.controller.arrived() && robot.wheels == MotorCommands::BRAKE);
    }
    assert_eq!(robot.world.pose(), before);
}

// Requirement: WIRE-modes-2
#[test]
fn the_same_target_again_changes_nothing_and_none_brakes() {
    let mut robot = Robot::new(&first_board(), Params::default());
    settle(&mut robot, 10);
    assert!(robot.wheels == MotorCommands::BRAKE && !robot.controller.moving());
    robot.controller.set_target(pose(500.0, 0.0, 0.0));
    for _ in 0..300 {
        // As frames do, 40 times a second and more.
        robot.controller.set_target(pose(500.0, 0.0, 0.0));
        robot.drive();
    }
    assert!(robot.controller.moving() && robot.world.pose().x_mm > 150.0);
    robot.controller.halt();
    settle(&mut robot, 1);
    assert_eq!(robot.wheels, MotorCommands::BRAKE);
    settle(&mut robot, 100);
    assert!(!robot.controller.arrived() && !robot.controller.moving());
    assert_all_good(&[robot.go(500.0, 0.0, 0.0, 60.0)]);
}

#[test]
fn a_target_that_moves_while_driving_is_followed() {
    let mut robot = Robot::new(&first_board(), Params::default());
    for k in 0..800 {
        let angle = f64::from(k) * 0.002;
        robot
            .controller
            .set_target(pose(700.0 * angle.sin(), 700.0 * (1.0 - angle.cos()), 0.0));
        robot.drive();
    }
    assert_all_good(&[robot.go(0.0, 700.0, 180.0, 60.0)]);
}

#[test]
fn no_limit_of_a_wheel_is_exceeded() {
    let mut config = first_board();
    config.platform.limit_left = 6000;
    config.platform.limit_right = 4500;
    let mut robot = Robot::new(&config, Params::default());
    robot.controller.set_target(pose(2000.0, 1000.0, 90.0));
    for _ in 0..3000 {
        robot.drive();
        let within = |drive: MotorCommand, limit: u16| match drive {
            MotorCommand::Run(duty) => duty.hundredths().unsigned_abs() <= limit,
            MotorCommand::Brake | MotorCommand::Coast => true,
        };
        assert!(within(robot.wheels.left, 6000) && within(robot.wheels.right, 4500));
    }
    assert!(robot.controller.arrived());
}

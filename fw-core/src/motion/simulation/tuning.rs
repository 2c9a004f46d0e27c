//! The tuning modes, and wheels wired backwards.

use super::*;

#[test]
fn tuning_the_rotation_sets_the_motors_against_each_other_and_nothing_else() {
    let mut robot = Robot::new(&first_board(), Params::default());
    for percent in [30, -60, 100] {
        let duty = Duty::saturating(percent * 100);
        let wheels = robot.controller.tune_rotate(duty);
        assert_eq!(wheels.right, MotorCommand::Run(duty));
        assert_eq!(
            wheels.left,
            MotorCommand::Run(Duty::saturating(-percent * 100))
        );
    }
    assert_eq!(
        robot.controller.tune_rotate(Duty::ZERO),
        MotorCommands::BRAKE
    );
}

// Requirement: DOC-5.2.3-1
#[test]
fn tuning_the_movement_keeps_the_angle_with_the_rotation_pid() {
    for percent in [40, 80, -60] {
        let mut robot = Robot::new(&first_board(), Params::default());
        for _ in 0..400 {
            let (pose, delta) = robot.tick();
            robot.wheels =
                robot
                    .controller
                    .tune_move(Duty::saturating(percent * 100), &pose, &delta);
        }
        let now = robot.world.pose();
        assert!(now.x_mm * f64::from(percent) > 2000.0, "{now:?}");
        assert!(now.heading_rad.to_degrees().abs() < 12.0, "{now:?}");
        let (pose, delta) = robot.tick();
        let wheels = robot.controller.tune_move(Duty::ZERO, &pose, &delta);
        assert_eq!(wheels, MotorCommands::BRAKE);
    }
}

// Requirement: WIRE-platform-3
#[test]
fn a_motor_that_is_wired_backwards_is_driven_backwards() {
    let mut config = first_board();
    config.platform.motor_left_reversed = true;
    let mut robot = Robot::new(&config, Params::default());
    let wheels = robot.controller.tune_rotate(Duty::saturating(5000));
    assert_eq!(wheels.left, wheels.right);
}

//! The tuning modes, to the hundredth.

use super::*;

fn run(left: i32, right: i32) -> MotorCommands {
    MotorCommands {
        left: MotorCommand::Run(Duty::saturating(left)),
        right: MotorCommand::Run(Duty::saturating(right)),
    }
}

// Requirement: DOC-5.2.2-1
#[test]
fn tuning_the_rotation_is_the_bare_duty_on_the_right_and_its_opposite_on_the_left() {
    let mut controller = controller(1.0, 1.0);
    controller.set_target(pose(1000.0, 0.0, 0.0));
    for duty in [1, -1, 3000, -10_000, 10_000] {
        let wheels = controller.tune_rotate(Duty::saturating(duty));
        assert_eq!(wheels, run(-duty, duty));
    }
    assert_eq!(controller.tune_rotate(Duty::ZERO), MotorCommands::BRAKE);
    // Nor is there a target any more.
    assert!(!controller.moving());
    assert_eq!(
        controller.drive(&Pose::default(), &STILL),
        MotorCommands::BRAKE
    );
}

// Requirement: DOC-5.2.3-1
#[test]
fn tuning_the_movement_holds_the_angle_at_which_it_began_until_it_is_told_zero() {
    // 1 % per degree.
    let mut controller = controller(1.0, 1.0);
    controller.set_target(pose(1000.0, 0.0, 0.0));
    let mut tune = |duty, degrees| {
        let here = pose(3.0, 4.0, degrees);
        controller.tune_move(Duty::saturating(duty), &here, &STILL)
    };
    assert_outputs(tune(4000, 179.0), 40.0, 0.0);
    // Across the wrap, either way, and the same going back.
    assert_outputs(tune(4000, -179.5), 40.0, -1.5);
    assert_outputs(tune(4000, 177.5), 40.0, 1.5);
    assert_outputs(tune(-4000, 177.5), -40.0, 1.5);
    assert_eq!(tune(0, 177.5), MotorCommands::BRAKE);
    assert_outputs(tune(4000, 177.5), 40.0, 0.0);
    // Another strategy in between ends it, too.
    let mut controller = PoseController::new(&gains(1.0, 1.0, 0.0));
    let duty = Duty::saturating(4000);
    let _ = controller.tune_move(duty, &pose(0.0, 0.0, 0.0), &STILL);
    let _ = controller.drive(&pose(0.0, 0.0, 0.0), &STILL);
    let wheels = controller.tune_move(duty, &pose(0.0, 0.0, 90.0), &STILL);
    assert_outputs(wheels, 40.0, 0.0);
}

#[test]
fn tuning_the_movement_damps_a_turn() {
    // 1 % per degree a tick, behind a filter of four ticks.
    let mut controller = PoseController::new(&gains(0.0, 0.0, 1.0));
    let mut filtered = 0.0;
    for _ in 0..30 {
        let here = Pose::default();
        let wheels = controller.tune_move(Duty::saturating(3000), &here, &rolling(0.0, 4.0));
        filtered += (4.0 - filtered) / 4.0;
        assert_outputs(wheels, 30.0, -filtered);
    }
}

//! Targets that are new, the same, or forgotten.

use super::*;

#[test]
fn without_a_target_it_brakes_wherever_it_is() {
    let mut controller = controller(1.0, 1.0);
    for here in [pose(0.0, 0.0, 0.0), pose(500.0, 20.0, 90.0)] {
        assert_eq!(
            controller.drive(&here, &rolling(1.0, 1.0)),
            MotorCommands::BRAKE
        );
        assert!(!controller.arrived() && !controller.moving());
    }
    controller.set_target(pose(0.0, 0.0, 0.0));
    assert!(controller.moving() && !controller.arrived());
    controller.halt();
    assert_eq!(
        controller.drive(&pose(500.0, 0.0, 0.0), &STILL),
        MotorCommands::BRAKE
    );
    assert!(!controller.arrived() && !controller.moving());
}

#[test]
fn the_same_target_again_changes_nothing_and_another_begins_anew() {
    let (target, other) = (pose(100.0, 50.0, -45.0), pose(100.0, 50.0, -45.1));
    for new in [target, other] {
        let mut controller = controller(1.0, 1.0);
        controller.set_target(target);
        for tick in 1..=8 {
            let _ = controller.drive(&target, &STILL);
            let arrives = if new == target { 5 } else { 8 };
            assert_eq!(controller.arrived(), tick >= arrives, "{tick}");
            if tick == 3 {
                controller.set_target(new);
            }
        }
        // Holding it is no target to start for either, and after a halt it is.
        controller.set_target(new);
        assert!(controller.arrived());
        controller.halt();
        controller.set_target(new);
        assert!(controller.moving());
    }
}

#[test]
fn after_a_halt_nothing_is_left_of_the_integrals() {
    let mut config = gains(0.1, 0.1, 0.0);
    config.forward.i = Binary64(0.5_f64.to_bits());
    config.rotation.i = Binary64(0.5_f64.to_bits());
    let (target, here) = (pose(30.0, 3.0, 10.0), pose(0.0, 0.0, 0.0));
    let mut fresh = PoseController::new(&config);
    fresh.set_target(target);
    let mut controller = fresh.clone();
    let first = fresh.drive(&here, &rolling(0.0, 0.0));
    for _ in 0..20 {
        let _ = controller.drive(&here, &rolling(0.0, 0.0));
    }
    assert_ne!(controller.drive(&here, &rolling(0.0, 0.0)), first);
    controller.halt();
    controller.set_target(target);
    assert_eq!(controller.drive(&here, &rolling(0.0, 0.0)), first);
}

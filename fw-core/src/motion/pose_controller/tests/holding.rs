//! At the target: how far a push must go to be answered.

use super::*;

/// Holding at the target, in the middle or where a try widened the tolerances.
fn holding(tries: u8) -> (PoseController, Pose) {
    let mut controller = controller(1.0, 1.0);
    let target = pose(500.0, -200.0, 170.0);
    controller.set_target(target);
    controller.tries = tries;
    for _ in 0..5 {
        let _ = controller.drive(&target, &STILL);
    }
    assert!(controller.arrived());
    (controller, target)
}

#[test]
fn a_push_beyond_1_and_5_eighths_of_the_places_tolerance_starts_again() {
    // 4.875 mm, to either side, and half as much more after a try that ended outside.
    for (tries, limit) in [(0, 4.875), (1, 7.3125)] {
        for bearing in [0.0, 37.0, 90.0, 180.0, -90.0] {
            for (pushed, answered) in [(limit - 0.03, false), (limit + 0.03, true)] {
                let (mut controller, _) = holding(tries);
                let (s, c) = f64::to_radians(bearing).sin_cos();
                let away = (pushed * c, pushed * s, 0.0);
                let here = seen_from((500.0, -200.0, 170.0), away);
                let _ = controller.drive(&here, &STILL);
                assert_eq!(!controller.arrived(), answered, "{bearing} {pushed}");
                assert_eq!(controller.moving(), answered);
            }
        }
    }
}

#[test]
fn a_turn_beyond_1_and_3_fifths_of_the_rotations_tolerance_starts_again() {
    // To the last unit: what is exactly as much holds.
    for (tries, tolerance) in [(0, TOLERANCE), (1, TOLERANCE / 2 * 3)] {
        let limit = tolerance / 5 * 8;
        for (turned, answered) in [(limit - 1, false), (limit, false), (limit + 1, true)] {
            for turned in [turned, -turned] {
                let (mut controller, mut here) = holding(tries);
                here.heading = Turns(here.heading.0.wrapping_add_signed(turned));
                let _ = controller.drive(&here, &STILL);
                assert_eq!(!controller.arrived(), answered, "{turned}");
            }
        }
    }
}

#[test]
fn what_is_not_answered_is_braked_and_the_next_arrival_has_the_old_tolerances_again() {
    let (mut controller, target) = holding(1);
    let aside = seen_from((500.0, -200.0, 170.0), (3.5, 0.0, 0.0));
    for _ in 0..10 {
        assert_eq!(controller.drive(&aside, &STILL), MotorCommands::BRAKE);
        assert!(controller.arrived());
    }
    let away = seen_from((500.0, -200.0, 170.0), (30.0, 0.0, 0.0));
    let _ = controller.drive(&away, &STILL);
    assert!(!controller.arrived() && controller.moving());
    let _ = controller.drive(&target, &rolling(0.0, 0.0));
    for _ in 0..6 {
        let _ = controller.drive(&aside, &STILL);
        assert!(!controller.arrived(), "3.5 mm are more than 3");
    }
}

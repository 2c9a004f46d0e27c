//! The turn to the final rotation, and when that is an arrival.

use super::*;

/// Set down so far before the target, with so many degrees missing.
fn set_down(config: &Config, before: f64, missing: f64) -> (PoseController, Pose) {
    let mut controller = PoseController::new(config);
    controller.set_target(pose(500.0, -200.0, 170.0));
    let (s, c) = f64::to_radians(170.0 - missing).sin_cos();
    let here = pose(500.0 - before * c, -200.0 - before * s, 170.0 - missing);
    (controller, here)
}

#[test]
fn it_turns_to_the_rotation_the_shorter_way_and_holds_the_place() {
    let config = gains(1.0, 1.0, 0.0);
    for missing in [0.6, 20.0, 90.0, 179.0] {
        for missing in [missing, -missing] {
            for before in [0.0, 2.0, -2.0, 5.9] {
                let (mut controller, here) = set_down(&config, before, missing);
                let wheels = controller.drive(&here, &rolling(0.0, 0.0));
                assert_outputs(wheels, before, missing.clamp(-50.0, 50.0));
                assert!(controller.moving() && !controller.arrived());
            }
        }
    }
}

#[test]
fn twice_the_tolerance_away_it_drives_there_anew() {
    let config = gains(1.0, 1.0, 0.0);
    for (before, anew) in [(5.95, false), (6.05, true), (45.0, true)] {
        for before in [before, -before] {
            let (mut controller, here) = set_down(&config, before, 20.0);
            let _ = controller.drive(&here, &rolling(0.0, 0.0));
            assert_eq!(controller.phase != Phase::Final, anew, "{before}");
        }
    }
}

#[test]
fn it_brakes_as_soon_as_it_would_stop_at_the_place_and_within_three_quarters_of_the_rotation() {
    let config = gains(1.0, 1.0, 0.0);
    // A braked wheel rolls on for four ticks of its speed: millimetres and a tick's, degrees and a
    // tick's.
    for (before, travel, missing, turn, brakes) in [
        (0.0, 0.0, 0.37, 0.0, true),
        (0.0, 0.0, 0.38, 0.0, false),
        (0.0, 0.0, 1.0, 0.16, true),
        (0.0, 0.0, 1.0, 0.15, false),
        (0.0, 0.0, 1.0, 0.34, true),
        (0.0, 0.0, 1.0, 0.35, false),
        (0.0, 0.0, -0.3, 0.1, false),
        (0.0, 0.0, 90.0, 0.0, false),
        (2.9, 0.0, 0.0, 0.0, true),
        (3.1, 0.0, 0.0, 0.0, false),
        (2.9, 1.4, 0.0, 0.0, true),
        (2.9, 1.5, 0.0, 0.0, false),
        (2.9, -0.1, 0.0, 0.0, false),
        // Not there yet, however it rolls.
        (3.1, 0.5, 0.0, 0.0, false),
    ] {
        for way in [1.0, -1.0] {
            for turned in [1.0, -1.0] {
                let (mut controller, here) = set_down(&config, before * way, missing * turned);
                let wheels = controller.drive(&here, &rolling(travel * way, turn * turned));
                assert_eq!(
                    wheels == MotorCommands::BRAKE,
                    brakes,
                    "{before} {travel} {missing} {turn}, {way} {turned}"
                );
            }
        }
    }
}

#[test]
fn an_arrival_is_50_ms_within_both_tolerances_and_at_rest() {
    let config = gains(1.0, 1.0, 0.0);
    for (before, missing) in [(0.0, 0.0), (2.9, 0.49), (-2.9, -0.49)] {
        let (mut controller, here) = set_down(&config, before, missing);
        for tick in 1..=5 {
            let _ = controller.drive(&here, &STILL);
            assert_eq!(controller.arrived(), tick == 5, "{tick}");
            assert_eq!(controller.moving(), tick < 5, "{tick}");
        }
        assert_eq!(controller.drive(&here, &STILL), MotorCommands::BRAKE);
    }
    // 0.51° is not within half a degree.
    let (mut controller, here) = set_down(&config, 0.0, 0.51);
    for _ in 0..20 {
        let _ = controller.drive(&here, &STILL);
        assert!(!controller.arrived());
    }
}

#[test]
fn a_count_of_either_wheel_is_rest_and_two_begin_the_50_ms_anew() {
    for (left, right, rests) in [
        (1, 1, true),
        (-1, 1, true),
        (-1, -1, true),
        (2, 0, false),
        (-2, 0, false),
        (0, 2, false),
        (0, -2, false),
        (-7, 7, false),
    ] {
        let (mut controller, here) = set_down(&gains(1.0, 1.0, 0.0), 0.0, 0.0);
        for tick in 1..=8 {
            let delta = if tick == 3 {
                Delta {
                    left,
                    right,
                    ..STILL
                }
            } else {
                STILL
            };
            let _ = controller.drive(&here, &delta);
            let arrives = if rests { 5 } else { 8 };
            assert_eq!(
                controller.arrived(),
                tick >= arrives,
                "{left} {right} {tick}"
            );
        }
    }
}

/// After a try that ended `before` the target; it starts the next from its place.
fn tried_once(before: f64) -> PoseController {
    let config = gains(1.0, 1.0, 0.0);
    let (mut controller, here) = set_down(&config, before, 0.0);
    for _ in 0..5 {
        assert!(controller.moving() && !matches!(controller.phase, Phase::Close { .. }));
        let _ = controller.drive(&here, &STILL);
    }
    // At rest and straight for 50 ms, but outside.
    assert!(matches!(controller.phase, Phase::Close { .. }), "{before}");
    controller
}

/// Whether it then settles so far before the target with so many degrees missing.
fn settles(controller: &PoseController, before: f64, missing: f64) -> bool {
    let mut controller = controller.clone();
    // To the place first.
    let (_, there) = set_down(&gains(1.0, 1.0, 0.0), 0.0, 0.0);
    let _ = controller.drive(&there, &rolling(0.0, 0.0));
    assert_eq!(controller.phase, Phase::Final);
    let (_, here) = set_down(&gains(1.0, 1.0, 0.0), before, missing);
    for _ in 0..5 {
        let _ = controller.drive(&here, &STILL);
    }
    controller.arrived()
}

#[test]
fn a_try_that_ends_outside_widens_the_tolerances_by_a_half_once() {
    for before in [3.1, -5.9] {
        let controller = tried_once(before);
        for (before, missing, is_there) in [
            (0.0, 0.0, true),
            (4.4, 0.0, true),
            (-4.4, 0.0, true),
            (4.6, 0.0, false),
            (0.0, 0.74, true),
            (0.0, -0.74, true),
            (0.0, 0.76, false),
        ] {
            assert_eq!(settles(&controller, before, missing), is_there, "{before}");
        }
        // Another such try widens them no further.
        let mut again = controller.clone();
        let (_, there) = set_down(&gains(1.0, 1.0, 0.0), 0.0, 0.0);
        let _ = again.drive(&there, &rolling(0.0, 0.0));
        let (_, outside) = set_down(&gains(1.0, 1.0, 0.0), 5.0, 0.0);
        for _ in 0..5 {
            let _ = again.drive(&outside, &STILL);
        }
        assert!(matches!(again.phase, Phase::Close { .. }));
        assert!(settles(&again, 4.4, 0.0) && !settles(&again, 4.6, 0.0));
    }
}

#[test]
fn tolerances_finer_than_the_encoders_are_1_mm_and_a_fifth_of_a_degree() {
    let mut config = gains(1.0, 1.0, 0.0);
    config.platform.position_tolerance = 0;
    config.platform.rotation_tolerance = 0;
    for (before, missing, is_there) in [
        (0.98, 0.0, true),
        (-0.98, 0.0, true),
        (1.02, 0.0, false),
        (0.0, 0.198, true),
        (0.0, -0.198, true),
        (0.0, 0.202, false),
    ] {
        let (mut controller, here) = set_down(&config, before, missing);
        for _ in 0..5 {
            let _ = controller.drive(&here, &STILL);
        }
        assert_eq!(controller.arrived(), is_there, "{before} {missing}");
    }
}

#[test]
fn the_derivative_counts_from_a_planned_turn() {
    // 1 % per degree a tick. The plan gathers a tenth of a degree a tick in each tick, to a thirtieth of
    // what is missing and 2° at most.
    for (missing, most) in [(150.0, 2.0), (30.0, 1.0), (-30.0, -1.0), (-150.0, -2.0)] {
        let (mut controller, here) = set_down(&gains(0.0, 0.0, 1.0), 0.0, missing);
        for tick in 1..=30 {
            let wheels = controller.drive(&here, &rolling(0.0, 0.0));
            let planned = (f64::from(tick) * 0.1).min(f64::abs(most)).copysign(most);
            assert_outputs(wheels, 0.0, planned);
        }
        // Turning as planned is not opposed, once the filter has seen it.
        for _ in 0..60 {
            let _ = controller.drive(&here, &rolling(0.0, most));
        }
        assert_outputs(controller.drive(&here, &rolling(0.0, most)), 0.0, 0.0);
    }
}

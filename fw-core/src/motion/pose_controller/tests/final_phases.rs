//! Final approach and final rotation: their thresholds, and the arrival.

use super::*;

/// In the final approach to `target`, begun at `from`.
fn final_approach(config: &Config, target: Pose, from: Pose) -> PoseController {
    let mut controller = aimed(config, target);
    let _ = controller.drive(&from, &rolling(0.0, 0.0));
    assert!(nears(&controller));
    controller
}

#[test]
fn final_approach_begins_at_40_mm() {
    for stand in STANDS {
        for bearing in [0.0, 90.0, 180.0, -60.0] {
            let (s, c) = f64::to_radians(bearing).sin_cos();
            for (distance, close) in [(100.0, false), (40.1, false), (39.9, true), (8.0, true)] {
                // From an approach, and as the first pose.
                for approaches in [true, false] {
                    let target = seen_from(stand, (distance * c, distance * s, bearing));
                    let mut controller = aimed(&gains(0.01, 1.0, 0.0), target);
                    if approaches {
                        let far = seen_from(stand, (-300.0 * c, -300.0 * s, 0.0));
                        let _ = controller.drive(&far, &rolling(0.0, 0.0));
                        assert!(matches!(controller.state.phase, Phase::Approach { .. }));
                    }
                    let _ = controller.drive(&on(stand), &rolling(0.0, 0.0));
                    let is_close = nears(&controller);
                    assert_eq!(is_close, close, "{stand:?} {bearing} {distance}");
                }
            }
        }
    }
}

#[test]
fn final_approach_holds_its_bearing_and_gates_at_8_degrees() {
    // 1 % per millimetre and per degree.
    let config = gains(1.0, 1.0, 0.0);
    for stand in STANDS {
        // 30 mm ahead and 10 mm to the left: 18.43°.
        let kept = (10.0f64 / 30.0).atan().to_degrees();
        let target = seen_from(stand, (30.0, 10.0, 50.0));
        let controller = final_approach(&config, target, on(stand));
        for (ahead, left, turned) in [
            (0.0, 0.0, 0.0),
            (0.0, 0.0, kept - 7.0),
            (0.0, 0.0, kept + 7.9),
            (0.0, 0.0, kept + 8.1),
            (0.0, 0.0, kept + 40.0),
            // Aside, where the bearing of the target differs.
            (10.0, -15.0, kept - 2.0),
            (20.0, 18.0, kept + 2.0),
            // Past the target.
            (45.0, 5.0, kept + 1.0),
        ] {
            let mut controller = controller.clone();
            let here = seen_from(stand, (ahead, left, turned));
            let commands = controller.drive(&here, &rolling(0.3, 0.0));
            let (s, c) = f64::to_radians(turned).sin_cos();
            let off = kept - turned;
            let distance = (30.0 - ahead) * c + (10.0 - left) * s;
            let expected = distance * (1.0 - off.abs() / 8.0).max(0.0);
            let (forward, rotation) = outputs(commands).expect("it is driven");
            let is_near = (forward - expected).abs() < 0.09;
            assert!(is_near, "{forward}, not {expected}");
            assert!((rotation - off).abs() < 0.02, "{rotation}, not {off}");
        }
    }
}

#[test]
fn final_approach_keeps_the_reverse_direction() {
    let mut controller = aimed(&gains(1.0, 1.0, 0.0), pose(-200.0, 0.0, 0.0));
    let _ = controller.drive(&pose(0.0, 0.0, 0.0), &rolling(0.0, 0.0));
    let commands = controller.drive(&pose(-170.0, 0.0, 0.0), &rolling(-0.3, 0.0));
    let heading = Turns(0);
    assert_eq!(controller.state.phase, Phase::FinalApproach { heading });
    assert_outputs(commands, -30.0, 0.0);
}

/// Whether the final approach ends `before` the target, mm, at this heading error, 2⁻³² turns, and
/// speed, mm a tick.
fn ends(config: &Config, before: f64, heading_error: i32, travel: f64) -> bool {
    let target = pose(1000.0, 0.0, 90.0);
    let mut controller = final_approach(config, target, pose(965.0, 0.0, 0.0));
    let mut here = pose(1000.0 - before, 0.0, 0.0);
    here.heading = Turns((heading_error as u32).wrapping_neg());
    let _ = controller.drive(&here, &rolling(travel, 0.0));
    controller.state.phase == Phase::FinalRotation
}

#[test]
fn final_approach_ends_aligned_slow_and_about_to_stop() {
    let config = gains(1.0, 1.0, 0.0);
    let fine = gains_with(1.0, 1.0, 0.0, &[(fields::POSITION_TOLERANCE, 1000)]);
    // A braked wheel rolls on for four ticks of its speed.
    for (config, before, travel, expected) in [
        (&config, 0.0, 0.0, true),
        (&config, 1.4, 0.0, true),
        (&config, 1.6, 0.0, false),
        (&config, 20.0, 0.0, false),
        (&config, 2.2, 0.2, true),
        (&config, 2.4, 0.2, false),
        (&config, 1.4, -0.1, false),
        (&config, 1.0, -0.1, true),
        (&config, -0.9, 0.19, false),
        // Too fast, though it would stop there.
        (&config, 0.8, 0.21, false),
        (&config, 4.0, 1.0, false),
        // Must be within a fine tolerance before it brakes.
        (&fine, 0.9, 0.15, true),
        (&fine, 1.1, 0.2, false),
    ] {
        for way in [1.0, -1.0] {
            for heading_error in [0, turns(7.0), turns(-7.0)] {
                let ends = ends(config, before * way, heading_error, travel * way);
                assert_eq!(ends, expected, "{before} {travel} {heading_error} {way}");
            }
        }
    }
    for (heading_error, expected) in [(8 * DEGREE - 1, true), (8 * DEGREE, false)] {
        assert_eq!(ends(&config, 0.0, heading_error, 0.0), expected);
        assert_eq!(ends(&config, 0.0, -heading_error, 0.0), expected);
    }
}

const TARGET: Stand = (500.0, -200.0, 170.0);

/// A pose so far before the target with this heading error, mm and degrees.
fn before_target(before: f64, heading_error: f64) -> Pose {
    let (x, y, heading) = TARGET;
    seen_from((x, y, heading - heading_error), (-before, 0.0, 0.0))
}

/// A controller that starts at that pose.
fn start(config: &Config, before: f64, heading_error: f64) -> (PoseController, Pose) {
    let here = before_target(before, heading_error);
    (aimed(config, on(TARGET)), here)
}

#[test]
fn final_rotation_turns_the_shorter_way_and_holds_the_position() {
    let config = gains(1.0, 1.0, 0.0);
    for error in [0.6, 20.0, 90.0, 179.0, -0.6, -20.0, -90.0, -179.0] {
        for before in [0.0, 2.0, -2.0, 5.9] {
            let (mut controller, here) = start(&config, before, error);
            let commands = controller.drive(&here, &rolling(0.0, 0.0));
            assert_outputs(commands, before, error.clamp(-50.0, 50.0));
            assert!(controller.moving() && !controller.arrived());
        }
    }
}

#[test]
fn final_rotation_beyond_twice_the_tolerance_approaches_again() {
    let config = gains(1.0, 1.0, 0.0);
    for (before, again) in [(5.95, false), (6.05, true), (45.0, true)] {
        for before in [before, -before] {
            let (mut controller, here) = start(&config, before, 20.0);
            let _ = controller.drive(&here, &rolling(0.0, 0.0));
            let rotates = controller.state.phase == Phase::FinalRotation;
            assert_eq!(rotates, !again, "{before}");
        }
    }
}

#[test]
fn final_rotation_brakes_when_about_to_stop_within_tolerance() {
    let config = gains(1.0, 1.0, 0.0);
    for (before, travel, error, turn, brakes) in [
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
        // It would stop there, but is not within the tolerance yet.
        (3.1, 0.5, 0.0, 0.0, false),
    ] {
        for (way, side) in [(1.0, 1.0), (1.0, -1.0), (-1.0, 1.0), (-1.0, -1.0)] {
            let (mut controller, here) = start(&config, before * way, error * side);
            let commands = controller.drive(&here, &rolling(travel * way, turn * side));
            let braked = commands == MotorCommands::BRAKE;
            assert_eq!(braked, brakes, "{before} {travel} {error} {turn} {way}");
        }
    }
}

#[test]
fn arrival_takes_50_ms_at_rest_within_both_tolerances() {
    let config = gains(1.0, 1.0, 0.0);
    let least = [
        (fields::POSITION_TOLERANCE, 200),
        (fields::ROTATION_TOLERANCE, 8),
    ];
    let finest = gains_with(1.0, 1.0, 0.0, &least);
    for (config, before, error, arrives) in [
        (&config, 0.0, 0.0, true),
        (&config, 2.9, 0.49, true),
        (&config, -2.9, -0.49, true),
        (&config, 0.0, 0.51, false),
        // The finest tolerances are 1 mm and a fifth of a degree.
        (&finest, 0.98, 0.0, true),
        (&finest, -0.98, 0.0, true),
        (&finest, 1.02, 0.0, false),
        (&finest, 0.0, 0.198, true),
        (&finest, 0.0, -0.198, true),
        (&finest, 0.0, 0.202, false),
    ] {
        let (mut controller, here) = start(config, before, error);
        for tick in 1..=5 {
            let _ = controller.drive(&here, &STILL);
            let arrived = arrives && tick == 5;
            assert_eq!(controller.arrived(), arrived, "{before} {error} {tick}");
            assert_eq!(controller.moving(), !arrived, "{before} {error} {tick}");
        }
        let braked = controller.drive(&here, &STILL) == MotorCommands::BRAKE;
        assert_eq!(braked, arrives);
    }
}

#[test]
fn arrival_one_count_is_rest_and_two_restart_the_50_ms() {
    for (left, right, arrival) in [
        (1, 1, 5),
        (-1, 1, 5),
        (-1, -1, 5),
        (2, 0, 8),
        (-2, 0, 8),
        (0, 2, 8),
        (0, -2, 8),
        (-7, 7, 8),
    ] {
        let (mut controller, here) = start(&gains(1.0, 1.0, 0.0), 0.0, 0.0);
        let moved = Delta::rolled(left, right);
        for tick in 1..=8 {
            let delta = if tick == 3 { moved } else { STILL };
            let _ = controller.drive(&here, &delta);
            assert_eq!(controller.arrived(), tick >= arrival, "{left} {right}");
        }
    }
}

#[test]
fn failed_attempt_widens_the_tolerances_by_half_once() {
    let config = gains(1.0, 1.0, 0.0);
    let rest = |controller: &mut PoseController, here: Pose| {
        for _ in 0..5 {
            assert!(!controller.arrived());
            let _ = controller.drive(&here, &STILL);
        }
    };
    let rotate = |controller: &mut PoseController| {
        let _ = controller.drive(&before_target(0.0, 0.0), &rolling(0.0, 0.0));
        assert_eq!(controller.state.phase, Phase::FinalRotation);
    };
    let arrives = |controller: &PoseController, before, error| {
        let mut controller = controller.clone();
        rotate(&mut controller);
        rest(&mut controller, before_target(before, error));
        controller.arrived()
    };
    for before in [3.1, -5.9] {
        // At rest and aligned, but outside the tolerance.
        let (mut controller, here) = start(&config, before, 0.0);
        rest(&mut controller, here);
        assert!(nears(&controller));
        for (before, error, expected) in [
            (0.0, 0.0, true),
            (4.4, 0.0, true),
            (-4.4, 0.0, true),
            (4.6, 0.0, false),
            (0.0, 0.74, true),
            (0.0, -0.74, true),
            (0.0, 0.76, false),
        ] {
            assert_eq!(arrives(&controller, before, error), expected, "{before}");
        }
        // A second failed attempt has no further effect.
        rotate(&mut controller);
        rest(&mut controller, before_target(5.0, 0.0));
        assert!(nears(&controller));
        assert!(arrives(&controller, 4.4, 0.0) && !arrives(&controller, 4.6, 0.0));
    }
}

#[test]
fn derivative_counts_from_the_planned_turn_rate() {
    // 1 % per degree a tick. The plan grows by 0.1° a tick, to a thirtieth of the error and at most 2°.
    for (error, most) in [(150.0, 2.0), (30.0, 1.0), (-30.0, -1.0), (-150.0, -2.0)] {
        let (mut controller, here) = start(&gains(0.0, 0.0, 1.0), 0.0, error);
        for tick in 1..=30 {
            let commands = controller.drive(&here, &rolling(0.0, 0.0));
            let planned = (f64::from(tick) * 0.1).min(f64::abs(most)).copysign(most);
            assert_outputs(commands, 0.0, planned);
        }
        // Another target is planned from rest.
        let mut other = controller.clone();
        other.set_target(seen_from(TARGET, (0.0, 0.0, 1.0)));
        let commands = other.drive(&here, &rolling(0.0, 0.0));
        assert_outputs(commands, 0.0, f64::copysign(0.1, most));
        // A turn as planned is not opposed, once the filter has settled.
        drive(&mut controller, &here, &rolling(0.0, most), 60);
        assert_outputs(controller.drive(&here, &rolling(0.0, most)), 0.0, 0.0);
    }
}

// Requirement: DOC-5.2.1-1
#[test]
fn settling_begins_anew_after_a_push() {
    let (mut controller, here) = start(&gains(1.0, 1.0, 0.0), 0.0, 0.0);
    for pose in [&here, &here, &here, &here, &before_target(6.05, 0.0), &here] {
        let _ = controller.drive(pose, &STILL);
    }
    assert_eq!(controller.state.phase, Phase::FinalRotation);
    for tick in 1..=5 {
        let _ = controller.drive(&here, &STILL);
        assert_eq!(controller.arrived(), tick == 5, "{tick}");
    }
}

/// Widened: 4.5 mm end the final rotation, but 6 mm still end the attempt.
// Requirement: DOC-5.2.1-1
#[test]
fn widened_tolerance_counts_for_the_stop_alone() {
    for (before, error, stops, again) in [
        (4.4, 0.0, true, false),
        (4.6, 0.0, false, false),
        (5.95, 20.0, false, false),
        (6.05, 20.0, false, true),
    ] {
        let (mut controller, here) = start(&gains(1.0, 1.0, 0.0), before, error);
        controller.state.widened = true;
        let commands = controller.drive(&here, &rolling(0.0, 0.0));
        assert_eq!(commands == MotorCommands::BRAKE, stops, "{before}");
        let rotates = controller.state.phase == Phase::FinalRotation;
        assert_eq!(rotates, !again, "{before}");
    }
}

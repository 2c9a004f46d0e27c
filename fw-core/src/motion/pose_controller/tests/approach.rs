//! Approach: nose or tail first, and the gate of the forward output.

use super::*;

/// The first tick's commands with a target seen from the stand.
fn first(controller: &PoseController, stand: Stand, target: Stand) -> MotorCommands {
    let mut controller = controller.clone();
    controller.set_target(seen_from(stand, target));
    controller.drive(&on(stand), &STILL)
}

fn towards(bearing: f64, distance: f64) -> (f64, f64) {
    let (s, c) = bearing.to_radians().sin_cos();
    (distance * c, distance * s)
}

/// Factor of the forward output.
fn gate(bearing: f64) -> f64 {
    (1.0 - bearing.abs() / 30.0).max(0.0)
}

#[test]
fn forward_begins_within_30_degrees_and_grows() {
    // 1 % per 100 mm and per degree.
    let controller = controller(0.01, 1.0);
    for stand in STANDS {
        for bearing in [0.0, 3.0, 10.0, 29.0, 29.95, 30.0, 30.5, 89.0, 150.0] {
            for bearing in [bearing, -bearing] {
                let (ahead, left) = towards(bearing, 2000.0);
                // A target heading along the way: reverse saves nothing.
                let commands = first(&controller, stand, (ahead, left, bearing));
                let forward = ahead / 100.0 * gate(bearing);
                assert_outputs(commands, forward, bearing.clamp(-50.0, 50.0));
            }
        }
    }
}

#[test]
fn reverse_is_chosen_for_less_turning_up_to_1500_mm() {
    let controller = controller(0.01, 1.0);
    for stand in STANDS {
        for (bearing, distance, rotation, reverse) in [
            (180.0, 1000.0, 0.0, true),
            (180.0, 1499.0, 0.0, true),
            (180.0, 1501.0, 0.0, false),
            (180.0, 1000.0, 89.0, true),
            (180.0, 1000.0, -89.0, true),
            // Turns of 150° and 10° forward, 30° and 170° in reverse.
            (150.0, 1000.0, 160.0, false),
            (150.0, 1000.0, 140.0, false),
            // 150° and 150°, 30° and 30°.
            (150.0, 1000.0, 0.0, true),
            (-150.0, 1000.0, 0.0, true),
            (-150.0, 1501.0, 0.0, false),
            // 20° and 170°, 160° and 10°.
            (20.0, 1000.0, -150.0, true),
            (20.0, 1000.0, 170.0, false),
            (-20.0, 1000.0, -170.0, false),
            // 89° and 90°, 91° and 90°.
            (89.0, 1000.0, -1.0, false),
            (91.0, 1000.0, 1.0, true),
        ] {
            let (ahead, left) = towards(bearing, distance);
            let commands = first(&controller, stand, (ahead, left, rotation));
            let (forward, turn) = outputs(commands).expect("it is driven");
            let turned: f64 = if reverse { bearing - 180.0 } else { bearing };
            let turned = (turned + 180.0).rem_euclid(360.0) - 180.0;
            assert!((forward - ahead / 100.0 * gate(turned)).abs() < ROUNDING);
            let mut off = turn - turned.clamp(-50.0, 50.0);
            if turned.abs() > 179.9 {
                // Half a turn may go either way.
                off = turn.abs() - 50.0;
            }
            assert!(off.abs() < ROUNDING, "{bearing} {distance} {rotation}");
        }
    }
}

#[test]
fn equal_turning_goes_nose_first() {
    // At the origin these turns are exact.
    let controller = controller(0.01, 1.0);
    for (target, forward, turn) in [
        ((0.0, 1000.0, 0.0), 0.0, 50.0),
        ((0.0, -1000.0, 0.0), 0.0, -50.0),
        ((1000.0, 0.0, 180.0), 10.0, 0.0),
        ((-1000.0, 0.0, 180.0), 0.0, -50.0),
    ] {
        assert_outputs(first(&controller, STANDS[0], target), forward, turn);
    }
}

#[test]
fn direction_of_travel_is_chosen_once() {
    let mut controller = aimed(&gains(0.01, 1.0, 0.0), pose(-1000.0, 0.0, 0.0));
    assert_outputs(controller.drive(&pose(0.0, 0.0, 0.0), &STILL), -10.0, 0.0);
    for (heading, turn) in [(20.0, -20.0), (100.0, -50.0), (-100.0, 50.0), (-20.0, 20.0)] {
        let commands = controller.drive(&pose(0.0, 0.0, heading), &rolling(0.0, 0.0));
        assert_eq!(controller.state.phase, Phase::Approach { reverse: true });
        let (_, rotation) = outputs(commands).expect("it is driven");
        assert!((rotation - turn).abs() < ROUNDING, "{heading}: {rotation}");
    }
}

#[test]
fn target_behind_is_approached_nose_first_without_a_reverse_speed() {
    for (back, reverse) in [(I16F16::ZERO, false), (-I16F16::DELTA, true)] {
        let mut controller = aimed(&gains(0.01, 1.0, 0.0), pose(-1000.0, 0.0, 0.0));
        controller.allowed.0 = back;
        let _ = controller.drive(&pose(0.0, 0.0, 0.0), &STILL);
        assert_eq!(controller.state.phase, Phase::Approach { reverse });
    }
}

#[test]
fn rotation_has_priority_up_to_half_duty() {
    let controller = controller(10.0, 10.0);
    for (bearing, forward, rotation) in [
        (0.0, 1e2, 0.0),
        (2.0, 8e1, 2e1),
        (1e1, 5e1, 5e1),
        (6e1, 0.0, 5e1),
    ] {
        for (bearing, rotation) in [(bearing, rotation), (-bearing, -rotation)] {
            let (ahead, left) = towards(bearing, 5000.0);
            let commands = first(&controller, STANDS[0], (ahead, left, bearing));
            assert_outputs(commands, forward, rotation);
        }
    }
}

#[test]
fn distance_saturates_at_10_metres() {
    // 1 % per 200 mm.
    let controller = controller(0.005, 1.0);
    for (distance, forward) in [
        (100.0, 0.5),
        (9900.0, 49.5),
        (10_000.0, 50.0),
        (10_100.0, 50.0),
        (8.0e6, 50.0),
    ] {
        for stand in [(0.0, 0.0, 0.0), (-4e6, 1000.0, 0.0)] {
            let commands = first(&controller, stand, (distance, 0.0, 0.0));
            assert_outputs(commands, forward, 0.0);
        }
    }
}

#[test]
fn distance_of_a_speed_is_its_damping_and_half_its_duty_over_p() {
    // 1 mm/s is 0.01 mm a tick; the first board's right wheel needs less: 77 % for 169 mm/s.
    for (p, expected_mm) in [
        (6.5088, (106.72 + 77.0 / 1.69 / 2.0) / 650.88),
        (0.001, 256.0),
    ] {
        let config = config_with(&[(fields::FORWARD_P, f64::to_bits(p))]);
        let found_mm = f64::from(distance_per_speed(&config)) / 65536.0;
        let off = found_mm / expected_mm - 1.0;
        assert!(off.abs() < 1e-4, "{found_mm} {expected_mm}");
    }
}

#[test]
fn planned_turn_rate_ends_during_the_approach() {
    let mut controller = aimed(&gains(0.0, 1.0, 10.0), pose(0.0, 0.0, 90.0));
    // A turn on the spot, a push, and the way back: the final approach begins without a turn.
    for (x, ticks) in [(0.0, 20), (-100.0, 50)] {
        drive(
            &mut controller,
            &pose(x, 0.0, 0.0),
            &rolling(0.0, 0.0),
            ticks,
        );
    }
    assert!(matches!(controller.state.phase, Phase::Approach { .. }));
    let commands = controller.drive(&pose(-30.0, 0.0, 0.0), &rolling(0.0, 0.0));
    assert_outputs(commands, 0.0, 0.0);
}

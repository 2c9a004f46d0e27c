//! The way there: which end goes first, and how far the nose opens it.

use super::*;

/// The first tick's outputs, the target so far ahead and to the left and turned by so many degrees.
fn first(
    controller: &PoseController,
    stand: (f64, f64, f64),
    target: (f64, f64, f64),
) -> MotorCommands {
    let mut controller = controller.clone();
    controller.set_target(seen_from(stand, target));
    let (x, y, heading) = stand;
    controller.drive(&pose(x, y, heading), &STILL)
}

#[test]
fn driving_begins_with_the_nose_within_30_degrees_and_grows_as_it_comes_round() {
    // 1 % per 100 mm and per degree.
    let controller = controller(0.01, 1.0);
    for stand in STANDS {
        for bearing in [
            0.0, 3.0, 10.0, 20.0, 29.0, 29.95, 30.0, 30.5, 45.0, 89.0, 150.0,
        ] {
            for bearing in [bearing, -bearing] {
                let (s, c) = f64::to_radians(bearing).sin_cos();
                // Turned as the way goes: nothing is gained by backing into it.
                let wheels = first(&controller, stand, (2000.0 * c, 2000.0 * s, bearing));
                let open = (1.0 - bearing.abs() / 30.0).max(0.0);
                assert_outputs(wheels, 20.0 * c * open, bearing.clamp(-50.0, 50.0));
            }
        }
    }
}

#[test]
fn it_backs_into_a_target_where_that_means_less_turning_and_only_from_within_a_metre_and_a_half() {
    let controller = controller(0.01, 1.0);
    for stand in STANDS {
        for (bearing, distance, rotation, backwards) in [
            // Straight behind.
            (180.0, 1000.0, 0.0, true),
            (180.0, 1499.0, 0.0, true),
            (180.0, 1501.0, 0.0, false),
            (180.0, 1000.0, 89.0, true),
            (180.0, 1000.0, -89.0, true),
            // 150° and 10° nose first, 30° and 170° tail first.
            (150.0, 1000.0, 160.0, false),
            (150.0, 1000.0, 140.0, false),
            // 150° and 150° against 30° and 30°.
            (150.0, 1000.0, 0.0, true),
            (-150.0, 1000.0, 0.0, true),
            (-150.0, 1501.0, 0.0, false),
            // Ahead, and then round: 20° and 170° against 160° and 10°.
            (20.0, 1000.0, -150.0, true),
            (20.0, 1000.0, 170.0, false),
            (-20.0, 1000.0, -170.0, false),
            // 89° and 90° against 91° and 90°, and the other way round.
            (89.0, 1000.0, -1.0, false),
            (91.0, 1000.0, 1.0, true),
        ] {
            let (s, c) = f64::to_radians(bearing).sin_cos();
            let (ahead, left) = (distance * c, distance * s);
            let wheels = first(&controller, stand, (ahead, left, rotation));
            let (forward, turn) = outputs(wheels).expect("it is driven");
            // What is ahead of the end that goes first.
            let turned: f64 = if backwards { bearing - 180.0 } else { bearing };
            let turned = (turned + 180.0).rem_euclid(360.0) - 180.0;
            let open = (1.0 - turned.abs() / 30.0).max(0.0);
            assert!((forward - ahead / 100.0 * open).abs() < 0.011);
            // Half a turn is as far either way.
            let (turn, turned) = if turned.abs() > 179.9 {
                (turn.abs(), turned.abs())
            } else {
                (turn, turned)
            };
            assert!(
                (turn - turned.clamp(-50.0, 50.0)).abs() < 0.011,
                "{bearing} {distance} {rotation}: {turn}"
            );
        }
    }
}

#[test]
fn where_both_ends_would_turn_alike_the_nose_goes_first() {
    // The rangefinders look ahead. In the origin these turns are exact.
    let controller = controller(0.01, 1.0);
    for (target, turn) in [
        ((0.0, 1000.0, 0.0), 50.0),
        ((0.0, -1000.0, 0.0), -50.0),
        ((1000.0, 0.0, 180.0), 0.0),
    ] {
        let (_, rotation) = outputs(first(&controller, STANDS[0], target)).expect("it is driven");
        assert!((rotation - turn).abs() < 0.011, "{target:?}: {rotation}");
    }
    let (forward, _) =
        outputs(first(&controller, STANDS[0], (-1000.0, 0.0, 180.0))).expect("it is driven");
    assert!(forward.abs() < 0.011, "it would back in: {forward}");
}

#[test]
fn the_end_that_goes_first_is_chosen_once() {
    let mut controller = controller(0.01, 1.0);
    controller.set_target(pose(-1000.0, 0.0, 0.0));
    assert_outputs(controller.drive(&pose(0.0, 0.0, 0.0), &STILL), -10.0, 0.0);
    // By now the nose would be nearer.
    for (heading, turn) in [(20.0, -20.0), (100.0, -50.0), (-100.0, 50.0), (-20.0, 20.0)] {
        let wheels = controller.drive(&pose(0.0, 0.0, heading), &rolling(0.0, 0.0));
        assert_eq!(controller.phase, Phase::Approach { backwards: true });
        let (_, rotation) = outputs(wheels).expect("it is driven");
        assert!((rotation - turn).abs() < 0.011, "{heading}: {rotation}");
    }
}

#[test]
fn rotation_takes_half_of_the_duty_at_most_and_forward_what_is_left() {
    let greedy = controller(10.0, 10.0);
    for (bearing, forward, rotation) in [
        (0.0, 100.0, 0.0),
        (2.0, 80.0, 20.0),
        (-2.0, 80.0, -20.0),
        (10.0, 50.0, 50.0),
        (-10.0, 50.0, -50.0),
        (60.0, 0.0, 50.0),
    ] {
        let (s, c) = f64::to_radians(bearing).sin_cos();
        let wheels = first(&greedy, STANDS[0], (5000.0 * c, 5000.0 * s, bearing));
        assert_outputs(wheels, forward, rotation);
    }
}

#[test]
fn farther_than_ten_metres_is_as_far() {
    // 1 % per 200 mm.
    let controller = controller(0.005, 1.0);
    for (distance, forward) in [
        (100.0, 0.5),
        (5000.0, 25.0),
        (9900.0, 49.5),
        (10_000.0, 50.0),
        (10_100.0, 50.0),
        (60_000.0, 50.0),
        (8.0e6, 50.0),
    ] {
        for stand in [(0.0, 0.0, 0.0), (-4e6, 1000.0, 0.0)] {
            let wheels = first(&controller, stand, (distance, 0.0, 0.0));
            assert_outputs(wheels, forward, 0.0);
        }
    }
}

#[test]
fn on_the_way_the_derivative_counts_from_rest() {
    // 1 % per degree a tick, behind a filter of four ticks.
    let mut controller = PoseController::new(&gains(0.0, 0.0, 1.0));
    controller.set_target(pose(0.0, 1000.0, 90.0));
    let mut filtered = 0.0;
    for _ in 0..40 {
        let wheels = controller.drive(&pose(0.0, 0.0, 0.0), &rolling(0.0, 2.0));
        filtered += (2.0 - filtered) / 4.0;
        assert_outputs(wheels, 0.0, -filtered);
    }
}

//! The last 40 mm.

use super::*;

#[test]
fn the_last_bit_begins_40_mm_from_the_target_whichever_side_that_is() {
    for stand in STANDS {
        for bearing in [0.0, 90.0, 180.0, -60.0] {
            let (s, c) = f64::to_radians(bearing).sin_cos();
            for (distance, close) in [(100.0, false), (40.1, false), (39.9, true), (8.0, true)] {
                let target = seen_from(stand, (distance * c, distance * s, bearing));
                let (x, y, heading) = stand;
                // Come from afar, and set down there.
                for from in [Some((300.0 * c, 300.0 * s)), None] {
                    let mut controller = controller(0.01, 1.0);
                    controller.set_target(target);
                    if let Some((ahead, left)) = from {
                        let far = seen_from(stand, (-ahead, -left, 0.0));
                        let _ = controller.drive(&far, &rolling(0.0, 0.0));
                        assert!(matches!(controller.phase, Phase::Approach { .. }));
                    }
                    let _ = controller.drive(&pose(x, y, heading), &rolling(0.0, 0.0));
                    let is_close = matches!(controller.phase, Phase::Close { .. });
                    assert_eq!(is_close, close, "{stand:?} {bearing} {distance}");
                }
            }
        }
    }
}

#[test]
fn there_the_bearing_is_kept_as_it_was_and_driven_along_with_the_nose_within_8_degrees_of_it() {
    // 1 % per millimetre and per degree.
    let config = gains(1.0, 1.0, 0.0);
    for stand in STANDS {
        // 30 mm ahead and 10 mm to the left: 18.43°.
        let kept = (10.0f64 / 30.0).atan().to_degrees();
        let target = seen_from(stand, (30.0, 10.0, 50.0));
        let here = seen_from(stand, (0.0, 0.0, 0.0));
        let controller = closing(&config, target, here);
        for (ahead, left, turned) in [
            (0.0, 0.0, 0.0),
            (0.0, 0.0, kept),
            (0.0, 0.0, kept - 7.0),
            (0.0, 0.0, kept + 7.9),
            (0.0, 0.0, kept + 8.1),
            (0.0, 0.0, kept + 40.0),
            // Aside, where the target's bearing is another.
            (10.0, -15.0, kept - 2.0),
            (20.0, 18.0, kept + 2.0),
            // Past it: back.
            (45.0, 5.0, kept + 1.0),
        ] {
            let mut controller = controller.clone();
            let here = seen_from(stand, (ahead, left, turned));
            let wheels = controller.drive(&here, &rolling(0.3, 0.0));
            let (s, c) = f64::to_radians(turned).sin_cos();
            let along = (30.0 - ahead) * c + (10.0 - left) * s;
            let off = kept - turned;
            let open = (1.0 - off.abs() / 8.0).max(0.0);
            let (forward, rotation) = outputs(wheels).expect("it is driven");
            assert!(
                (forward - along * open).abs() < 0.09 && (rotation - off).abs() < 0.02,
                "{ahead} {left} {turned}: {forward} {rotation}, not {} {off}",
                along * open
            );
        }
    }
}

#[test]
fn it_backs_into_the_last_bit_as_it_backed_there() {
    let mut controller = controller(1.0, 1.0);
    controller.set_target(pose(-200.0, 0.0, 0.0));
    let _ = controller.drive(&pose(0.0, 0.0, 0.0), &rolling(0.0, 0.0));
    let wheels = controller.drive(&pose(-170.0, 0.0, 0.0), &rolling(-0.3, 0.0));
    assert!(matches!(controller.phase, Phase::Close { heading } if heading == Turns(0)));
    assert_outputs(wheels, -30.0, 0.0);
}

/// Whether the last bit is done so many millimetres before the target, with so much of the heading
/// missing, 2⁻³² turns, and at so many millimetres a tick.
fn done(config: &Config, before: f64, missing: i32, travel: f64) -> bool {
    let target = pose(1000.0, 0.0, 90.0);
    let mut controller = closing(config, target, pose(965.0, 0.0, 0.0));
    let mut here = pose(1000.0 - before, 0.0, 0.0);
    here.heading = Turns((missing as u32).wrapping_neg());
    let _ = controller.drive(&here, &rolling(travel, 0.0));
    controller.phase == Phase::Final
}

#[test]
fn it_is_done_aimed_and_slow_and_about_to_stop_within_half_the_tolerance() {
    let config = gains(1.0, 1.0, 0.0);
    // A braked wheel rolls on for four ticks of its speed.
    for (before, travel, is_done) in [
        (0.0, 0.0, true),
        (1.4, 0.0, true),
        (1.6, 0.0, false),
        (20.0, 0.0, false),
        (2.2, 0.2, true),
        (2.4, 0.2, false),
        (1.4, -0.1, false),
        (1.0, -0.1, true),
        (-0.9, 0.19, false),
        // Too fast, though it would stop there.
        (0.8, 0.21, false),
        (4.0, 1.0, false),
    ] {
        // As far ahead going forward as behind going back.
        for way in [1.0, -1.0] {
            for missing in [0, turns(7.0), turns(-7.0)] {
                assert_eq!(
                    done(&config, before * way, missing, travel * way),
                    is_done,
                    "{before} mm before it at {travel} mm a tick, {missing} off, {way}"
                );
            }
        }
    }
    // At 8° exactly nothing drives any more: it still has to turn.
    for (missing, aimed) in [(8 * DEGREE - 1, true), (8 * DEGREE, false)] {
        assert_eq!(done(&config, 0.0, missing, 0.0), aimed);
        assert_eq!(done(&config, 0.0, -missing, 0.0), aimed);
    }
}

#[test]
fn with_a_fine_tolerance_it_must_have_come_within_it_however_far_it_rolls() {
    let mut config = gains(1.0, 1.0, 0.0);
    config.platform.position_tolerance = 1000;
    // Both would stop 0.3 mm before the target.
    for way in [1.0, -1.0] {
        assert!(done(&config, 0.9 * way, 0, 0.15 * way));
        assert!(!done(&config, 1.1 * way, 0, 0.2 * way));
    }
}

//! What the controller's tests do not reach: rounding and saturation.

use super::*;
use crate::motion::tests::pose;

#[test]
fn difference_is_exact_to_a_unit_and_saturates() {
    let unit = 1_i64 << (32 - FRACTION_BITS);
    let distances = [0, 1, unit - 1, unit, -1, -unit, 300 * unit + 5];
    for pose in [0, 1, unit - 1, 5 * unit, -7 * unit - 3, 1 << 60, -(1 << 61)] {
        for distance in distances.into_iter().chain([-(1 << 45), 1 << 54]) {
            let exact = distance.div_euclid(unit);
            let found = i64::from(difference(pose + distance, pose));
            // Halving may lose the last bit of a unit.
            assert!((exact - 1..=exact + 1).contains(&found), "{distance}");
        }
    }
    let end = 1 << 30;
    for (target, pose) in [
        (i64::MAX, i64::MIN),
        (i64::MAX, 0),
        (1 << 57, -(1 << 56)),
        (1 << 55, 0),
        (1 << 55, -1),
    ] {
        // The lowest bits are not saturated.
        let (most, least) = (difference(target, pose), difference(pose, target));
        assert!(((end - 256)..end).contains(&most), "{most}");
        assert!((-end..=256 - end).contains(&least), "{least}");
    }
}

#[test]
fn within_is_a_circle() {
    let units = |mm: f64| (mm * f64::from(1 << FRACTION_BITS)) as i32;
    for (longitudinal, lateral, within) in [
        (5.0, 0.0, true),
        (0.0, -5.0, true),
        (-4.0, 3.0, true),
        (5.01, 0.0, false),
        (0.0, 5.01, false),
        (-3.0, -4.01, false),
        (3.7, 3.7, false),
        (4.9, 0.99, true),
        (4.9, -1.01, false),
    ] {
        let error = TrackingError {
            longitudinal: units(longitudinal),
            lateral: units(lateral),
            heading: 0,
        };
        assert_eq!(error.within(5 << FRACTION_BITS), within, "{error:?}");
    }
    let far = TrackingError::new(&pose(-4.1e6, -4.1e6, 45.0), &pose(4.1e6, 4.1e6, 0.0));
    assert!(!far.within(1 << 30) && far.within(i32::MAX));
    // On the target no direction is defined.
    let there = TrackingError::new(&Pose::default(), &Pose::default());
    assert_eq!((there.bearing(true), there.bearing(false)), (0, 0));
}

#[test]
fn motion_beyond_every_bound_does_not_stop_within() {
    let error = |longitudinal| TrackingError {
        longitudinal,
        lateral: 0,
        heading: 0,
    };
    let moving = |travel, turn| Delta {
        travel: fixed::types::I16F16::from_bits(travel),
        turn,
        ..Delta::default()
    };
    let end = (i32::MAX >> (16 - FRACTION_BITS)) - 1;
    assert!(error(0).after_braking(&moving(i32::MAX, 0)) <= -end);
    assert!(error(0).after_braking(&moving(i32::MIN, 0)) >= end);
    assert!(error(i32::MIN).after_braking(&moving(i32::MAX, 0)) < 0);
    let (distance, angle) = (5 << FRACTION_BITS, 1 << 20);
    assert!(error(0).stops_within(&moving(0, 0), distance, angle));
    for turn in [i32::MIN, i32::MAX] {
        assert!(!error(0).stops_within(&moving(0, turn), distance, angle));
    }
}

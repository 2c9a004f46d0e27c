//! Against the same in binary64.

use super::*;
use crate::motion::simulation::pose;
use crate::types::Turns;

/// Millimetres.
fn mm(units: i32) -> f64 {
    f64::from(units) / f64::from(1 << FRACTION_BITS)
}

#[test]
fn tracking_error_is_the_target_in_the_robot_frame() {
    for (x, y, heading) in [
        (0.0, 0.0, 0.0),
        (100.0, -2000.5, 90.0),
        (-7.25, 3.125, 200.0),
        (-4e6, 4e6, -30.0),
    ] {
        for (tx, ty, rotation) in [
            (0.0, 0.0, 0.0),
            (1000.0, 0.0, 170.0),
            (-0.5, 12.0, -170.0),
            (-5000.0, -20_000.0, 90.0),
            (1e6, -4.1e6, 1.0),
        ] {
            let error = TrackingError::new(&pose(x, y, heading), &pose(tx, ty, rotation));
            let (s, c) = heading.to_radians().sin_cos();
            let (dx, dy) = (tx - x, ty - y);
            // Two units of 8 µm, and the sine's 5.8e-10.
            let bound = 2.0 * mm(1) + 1e-9 * dx.hypot(dy);
            assert!((mm(error.longitudinal) - (dx * c + dy * s)).abs() < bound);
            assert!((mm(error.lateral) - (dy * c - dx * s)).abs() < bound);
            let turned = f64::from(error.heading) / 4_294_967_296.0 * 360.0;
            let off = (turned - (rotation - heading)).rem_euclid(360.0);
            assert!(off.min(360.0 - off) < 1e-6, "{turned}");
        }
    }
}

#[test]
fn difference_is_exact_to_a_unit_and_saturates() {
    let unit = 1_i64 << (32 - FRACTION_BITS);
    for pose in [0, 1, unit - 1, 5 * unit, -7 * unit - 3, 1 << 60, -(1 << 61)] {
        for way in [
            0,
            1,
            unit - 1,
            unit,
            -1,
            -unit,
            300 * unit + 5,
            -(1 << 45),
            1 << 54,
        ] {
            let exact = way.div_euclid(unit);
            let found = i64::from(difference(pose + way, pose));
            // Halving may lose the last bit of a unit.
            assert!((exact - 1..=exact + 1).contains(&found), "{pose} {way}");
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

/// Millimetres and degrees.
fn error(longitudinal: f64, lateral: f64, heading: f64) -> TrackingError {
    let units = |mm: f64| (mm * f64::from(1 << FRACTION_BITS)) as i32;
    TrackingError {
        longitudinal: units(longitudinal),
        lateral: units(lateral),
        heading: (heading / 360.0 * 4_294_967_296.0) as i32,
    }
}

#[test]
fn within_is_a_circle() {
    for (longitudinal, lateral, within) in [
        (5.0, 0.0, true),
        (0.0, -5.0, true),
        (3.0, 4.0, true),
        (-4.0, 3.0, true),
        (5.01, 0.0, false),
        (0.0, 5.01, false),
        (-3.0, -4.01, false),
        (3.7, 3.7, false),
        (4.9, 0.99, true),
        (4.9, -1.01, false),
    ] {
        let error = error(longitudinal, lateral, 0.0);
        assert_eq!(error.within(5 << FRACTION_BITS), within, "{error:?}");
    }
    let far = TrackingError::new(&pose(-4.1e6, -4.1e6, 45.0), &pose(4.1e6, 4.1e6, 0.0));
    assert!(!far.within(1 << 30) && far.within(i32::MAX));
}

#[test]
fn stops_within_considers_four_ticks_of_braking() {
    let one_degree = error(0.0, 0.0, 1.0).heading;
    for (error, travel, turn, stops) in [
        (error(4.9, 0.0, 0.9), 0.0, 0.0, true),
        (error(4.9, 0.0, 1.1), 0.0, 0.0, false),
        (error(4.9, 0.0, 1.1), 0.0, 0.1, true),
        (error(4.9, 0.0, 1.1), 0.0, 0.6, false),
        (error(4.9, 0.0, -1.1), 0.0, 0.1, false),
        (error(5.1, 0.0, 0.0), 0.0, 0.0, false),
        // Not within the distance yet.
        (error(5.1, 0.0, 0.0), 0.5, 0.0, false),
        // Within it, but it rolls out of it.
        (error(4.9, 0.0, 0.0), -0.1, 0.0, false),
        (error(-4.9, 0.0, 0.0), 0.1, 0.0, false),
        (error(-4.9, 0.0, 0.0), -0.1, 0.0, true),
        (error(0.0, 4.9, 0.0), 1.2, 0.0, true),
        (error(0.0, 4.9, 0.0), 1.3, 0.0, false),
    ] {
        let delta = Delta {
            travel: fixed::types::I16F16::from_num(travel),
            turn: self::error(0.0, 0.0, turn).heading,
            ..Delta::default()
        };
        let found = error.stops_within(&delta, 5 << FRACTION_BITS, one_degree);
        assert_eq!(found, stops, "{error:?} {travel} {turn}");
        let remaining = mm(error.after_braking(&delta));
        let exact = mm(error.longitudinal) - 4.0 * travel;
        assert!((remaining - exact).abs() < 2.0 * mm(1), "{remaining}");
    }
}

#[test]
fn bearing_in_reverse_is_half_a_turn_off() {
    for (longitudinal, lateral, degrees) in [
        (10.0, 0.0, 0.0),
        (10.0, 10.0, 45.0),
        (0.0, 10.0, 90.0),
        (-10.0, 10.0, 135.0),
        (-10.0, -10.0, -135.0),
        (0.0, -10.0, -90.0),
        (5.0, -8.660_254, -60.0),
    ] {
        let error = error(longitudinal, lateral, 0.0);
        let nose = error.bearing(false);
        // 8 µm of 10 mm, and the direction's 0.003°.
        let off = f64::from(nose) / 4_294_967_296.0 * 360.0 - degrees;
        assert!(off.abs() < 0.06, "{off}");
        let tail = Turns(error.bearing(true) as u32);
        assert_eq!(tail.from_nearest(Turns(nose as u32)), i32::MIN);
    }
    let there = error(0.0, 0.0, 0.0);
    assert_eq!((there.bearing(true), there.bearing(false)), (0, 0));
}

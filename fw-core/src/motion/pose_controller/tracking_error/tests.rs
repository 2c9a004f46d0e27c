//! What the robot sees of its target, against the same by binary64.

use super::*;
use crate::motion::simulation::pose;
use crate::types::Turns;
use fixed::types::I16F16;

/// Millimetres.
fn mm(units: i32) -> f64 {
    f64::from(units) / f64::from(1 << UNIT)
}

#[test]
fn the_target_lies_ahead_and_to_the_left_of_the_robot() {
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
            let view = View::new(&pose(x, y, heading), &pose(tx, ty, rotation));
            let (s, c) = heading.to_radians().sin_cos();
            let (dx, dy) = (tx - x, ty - y);
            // Two units of 8 µm, and the sine's 5.8e-10.
            let bound = 2.0 * mm(1) + 1e-9 * dx.hypot(dy);
            assert!((mm(view.along) - (dx * c + dy * s)).abs() < bound);
            assert!((mm(view.across) - (dy * c - dx * s)).abs() < bound);
            let turned = f64::from(view.rotation) / 4_294_967_296.0 * 360.0;
            let off = (turned - (rotation - heading)).rem_euclid(360.0);
            assert!(off.min(360.0 - off) < 1e-6, "{turned}");
        }
    }
}

#[test]
fn a_way_is_the_difference_in_its_unit_and_stays_within_its_range() {
    let unit = 1_i64 << (32 - UNIT);
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
            let got = i64::from(super::way(pose + way, pose));
            // Of halves: what one of them loses may be the last of a unit.
            assert!(
                (exact - 1..=exact + 1).contains(&got),
                "{pose} {way}: {got}"
            );
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
        // The lowest bits stay the way's.
        let (most, least) = (way(target, pose), way(pose, target));
        assert!(((end - 256)..end).contains(&most), "{most}");
        assert!((-end..=256 - end).contains(&least), "{least}");
    }
}

/// Seen so far ahead and to the left, millimetres, and turned by so many degrees.
fn seen(along: f64, across: f64, rotation: f64) -> View {
    let units = |mm: f64| (mm * f64::from(1 << UNIT)) as i32;
    View {
        along: units(along),
        across: units(across),
        rotation: (rotation / 360.0 * 4_294_967_296.0) as i32,
    }
}

#[test]
fn a_distance_is_a_circle() {
    for (along, across, within) in [
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
        let distance = 5 << UNIT;
        assert_eq!(seen(along, across, 0.0).within(distance), within, "{along}");
    }
    // As far as a view reaches.
    let far = View::new(&pose(-4.1e6, -4.1e6, 45.0), &pose(4.1e6, 4.1e6, 0.0));
    assert!(!far.within(1 << 30) && far.within(i32::MAX));
}

#[test]
fn a_braked_robot_rolls_on_for_four_ticks_of_its_speed() {
    for along in [0.0, 10.0, -3.0] {
        for travel in [0.0, 1.0, -1.0, 0.25, -7.5] {
            let delta = Delta {
                travel: I16F16::from_num(travel),
                ..Delta::default()
            };
            let left = seen(along, 99.0, 0.0).left_ahead(&delta);
            assert!((mm(left) - (along - 4.0 * travel)).abs() < 1e-9, "{left}");
        }
    }
}

#[test]
fn it_stops_at_the_target_if_it_is_near_and_stays_so_and_is_straight_by_then() {
    let straight = seen(0.0, 0.0, 1.0).rotation;
    for (view, travel, turn, stops) in [
        (seen(4.9, 0.0, 0.9), 0.0, 0.0, true),
        (seen(4.9, 0.0, 1.1), 0.0, 0.0, false),
        (seen(4.9, 0.0, 1.1), 0.0, 0.1, true),
        (seen(4.9, 0.0, 1.1), 0.0, 0.6, false),
        (seen(4.9, 0.0, -1.1), 0.0, 0.1, false),
        (seen(5.1, 0.0, 0.0), 0.0, 0.0, false),
        // It will be near, but is not yet.
        (seen(5.1, 0.0, 0.0), 0.5, 0.0, false),
        // It is near, and will not stay so.
        (seen(4.9, 0.0, 0.0), -0.1, 0.0, false),
        (seen(-4.9, 0.0, 0.0), 0.1, 0.0, false),
        (seen(-4.9, 0.0, 0.0), -0.1, 0.0, true),
        (seen(0.0, 4.9, 0.0), 1.2, 0.0, true),
        (seen(0.0, 4.9, 0.0), 1.3, 0.0, false),
    ] {
        let delta = Delta {
            travel: I16F16::from_num(travel),
            turn: seen(0.0, 0.0, turn).rotation,
            ..Delta::default()
        };
        assert_eq!(
            view.stops(&delta, 5 << UNIT, straight),
            stops,
            "{view:?} {travel} {turn}"
        );
    }
}

#[test]
fn the_tail_points_where_the_nose_does_not() {
    for (along, across, degrees) in [
        (10.0, 0.0, 0.0),
        (10.0, 10.0, 45.0),
        (0.0, 10.0, 90.0),
        (-10.0, 10.0, 135.0),
        (-10.0, -10.0, -135.0),
        (0.0, -10.0, -90.0),
        (5.0, -8.660_254, -60.0),
    ] {
        let view = seen(along, across, 0.0);
        let nose = f64::from(view.bearing(false)) / 4_294_967_296.0 * 360.0;
        // 8 µm of 10 mm, and the direction's 0.003°.
        assert!((nose - degrees).abs() < 0.06, "{nose}");
        // Exactly half a turn apart.
        let tail = Turns(view.bearing(true) as u32);
        assert_eq!(
            tail.from_nearest(Turns(view.bearing(false) as u32)),
            i32::MIN
        );
    }
    // On the target nothing points anywhere.
    let there = seen(0.0, 0.0, 0.0);
    assert_eq!((there.bearing(true), there.bearing(false)), (0, 0));
}

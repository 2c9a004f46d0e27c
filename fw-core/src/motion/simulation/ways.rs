//! Every pose, from rest.

use std::println;
use std::vec::Vec;

use super::*;

/// Every way worth a test, each from rest at the origin with nothing learned yet.
fn all_ways(config: &Config, params: &Params) -> Vec<Trip> {
    let mut trips = Vec::new();
    for distance in [0.0, 10.0, 50.0, 200.0, 1000.0, 3000.0] {
        for bearing in [0.0f64, 45.0, 90.0, 180.0, -135.0] {
            for rotation in [0.0, 90.0, 180.0, -60.0] {
                let mut robot = Robot::new(config, params.clone());
                let (s, c) = bearing.to_radians().sin_cos();
                let trip = robot.go(distance * c, distance * s, rotation, 60.0);
                println!("{distance:6} {bearing:5} {rotation:4}: {trip:.2?}");
                trips.push(trip);
            }
        }
    }
    trips
}

#[test]
fn the_first_board_reaches_every_pose_within_5_mm_and_a_degree() {
    assert_all_good(&all_ways(&first_board(), &Params::default()));
}

#[test]
fn so_does_a_robot_whose_wheels_are_40_percent_apart() {
    assert_all_good(&all_ways(&first_board(), &apart(40.0)));
}

#[test]
fn so_does_the_first_board_with_its_battery_almost_empty() {
    let mut params = Params::default();
    params.battery.charge = [0.05, 0.05];
    assert_all_good(&all_ways(&first_board(), &params));
}

#[test]
fn the_default_rooms_tour_takes_less_than_five_minutes() {
    let mut robot = Robot::new(&first_board(), Params::default());
    for way in &Room::two_rooms().tour {
        let trip = robot.go(way.x_mm, way.y_mm, way.heading_rad.to_degrees(), 60.0);
        assert_all_good(&[trip]);
    }
    println!("{:.1} s", robot.world.time_s());
    assert!(robot.world.time_s() < 300.0);
}

#[test]
fn a_metre_with_any_rotation_takes_at_most_nine_seconds() {
    // Five of them at the weaker wheel's full speed. `tests/` compares with what the motors can do.
    for bearing in [0.0f64, 90.0, 180.0] {
        for rotation in [0.0, 90.0, 180.0, -90.0] {
            let mut robot = Robot::new(&first_board(), Params::default());
            let (s, c) = bearing.to_radians().sin_cos();
            let trip = robot.go(1000.0 * c, 1000.0 * s, rotation, 60.0);
            println!("{bearing} {rotation}: {trip:.2?}");
            assert!(trip.seconds.is_some_and(|s| s <= 9.0), "{trip:?}");
        }
    }
}

#[test]
fn straight_on_the_unequal_wheels_agree_within_eight_percent_after_a_second() {
    let mut robot = Robot::new(&first_board(), Params::default());
    robot.controller.set_target(pose(3000.0, 0.0, 0.0));
    settle(&mut robot, 100);
    for _ in 0..1000 {
        robot.drive();
        let plant::Sides { left, right } = robot.world.wheel_speeds_deg_s();
        assert!((left / right - 1.0).abs() < 0.08, "{left} {right}");
        assert!(robot.world.pose().y_mm.abs() < 10.0);
    }
}

#[test]
fn other_gains_do_as_well() {
    let double = |v: f64| crate::binary64::Binary64(v.to_bits());
    let mut config = first_board();
    (config.rotation.p, config.rotation.i) = (double(4.0), double(0.02));
    config.rotation.d = double(80.0);
    (config.forward.p, config.forward.i) = (double(4.0), double(0.02));
    config.forward.d = double(90.0);
    assert_all_good(&all_ways(&config, &Params::default()));
}

#[test]
fn wheels_that_stick_longer_than_is_known_arrive_even_without_an_integral() {
    // By 5 %: outputs below that move nothing, and only the push of a robot that rests grows.
    let none = crate::binary64::Binary64::default();
    let mut config = first_board();
    config.platform.dead_zone_left -= 500;
    config.platform.dead_zone_right -= 500;
    (config.rotation.i, config.forward.i) = (none, none);
    for (x, rotation) in [
        (10.0, 0.0),
        (10.0, 90.0),
        (50.0, -60.0),
        (-10.0, 0.0),
        (-50.0, 0.0),
        (-200.0, 180.0),
    ] {
        let mut robot = Robot::new(&config, Params::default());
        assert_all_good(&[robot.go(x, 0.0, rotation, 30.0)]);
    }
}

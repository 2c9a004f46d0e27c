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

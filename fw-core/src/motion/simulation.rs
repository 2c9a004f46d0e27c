//! The controller on the physical robot's models: closed loop at 100 Hz, odometry included.
#![allow(
    clippy::cast_precision_loss,
    reason = "the plant is binary64, and what is measured on it"
)]

extern crate std;

use std::f64::consts::{PI, TAU};
use std::{println, vec::Vec};

use plant::{MotorInput, MotorParams, Params, Room, Sides, World};

use super::controller::Controller;
use super::odometry::{Delta, Odometry};
use super::wheels::Wheels;
use crate::eeprom::{first_board, Config};
use crate::robot::Drive;
use crate::units::{Duty, Millimetres, Pose, Turns};
use fixed::types::I32F32;

/// One robot on an open floor.
struct Robot {
    world: World,
    odometry: Odometry,
    controller: Controller,
    wheels: Wheels,
    /// Counts that the wheels were rolled forward from outside.
    rolled: (i64, i64),
}

/// How a way went, from the truth.
#[derive(Clone, Copy, Debug)]
struct Trip {
    /// Seconds until it held, `None` if it did not.
    seconds: Option<f64>,
    /// Errors after a second of holding: mm, degrees.
    position: f64,
    rotation: f64,
    /// Farthest beyond the target in the direction of the way, and beside the line, mm.
    overshoot: f64,
    beside: f64,
    /// How often it left its hold.
    hunts: u32,
}

fn input(drive: Drive) -> MotorInput {
    match drive {
        Drive::Coast => MotorInput::COAST,
        Drive::Brake => MotorInput::BRAKE,
        Drive::Run(duty) => MotorInput::run(f64::from(duty.hundredths()) / 1e4),
    }
}

fn pose(x: f64, y: f64, degrees: f64) -> Pose {
    let fixed = |v: f64| Millimetres(I32F32::from_bits((v * 4_294_967_296.0) as i64));
    Pose {
        x: fixed(x),
        y: fixed(y),
        heading: Turns((degrees.rem_euclid(360.0) / 360.0 * 4_294_967_296.0) as u64 as u32),
    }
}

fn around(radians: f64) -> f64 {
    (radians + PI).rem_euclid(TAU) - PI
}

impl Robot {
    fn new(config: &Config, params: Params) -> Self {
        let world = World::new(params, Room::default(), plant::Pose::default(), 1);
        Self {
            world,
            odometry: Odometry::new(&config.platform, 0, 0),
            controller: Controller::new(config),
            wheels: Wheels::BRAKE,
            rolled: (0, 0),
        }
    }

    fn tick(&mut self) -> (Pose, Delta) {
        self.world
            .step(0.01, input(self.wheels.left), input(self.wheels.right));
        let (left, right) = self.world.wheel_counts();
        // The first board's encoders count down going forward.
        let (left, right) = (left - self.rolled.0, right - self.rolled.1);
        let delta = self.odometry.step(left as u32, right as u16);
        (self.odometry.pose(), delta)
    }

    /// Rolls the wheels by these degrees from outside.
    fn push(&mut self, left: f64, right: f64) {
        let counts = |degrees: f64| (degrees / 360.0 * 3840.0).round();
        self.rolled.0 += counts(left) as i64;
        self.rolled.1 += counts(right) as i64;
        let (left, right) = (counts(left) * 0.09375, counts(right) * 0.09375);
        let per_degree = 80.0 * PI / 360.0;
        let (l, r) = (left * per_degree, right * per_degree);
        let pose = self.world.pose().rolled(l, r, 125.0);
        let from = self.world.pose();
        let (s, c) = from.heading_rad.sin_cos();
        let (dx, dy) = (pose.x_mm - from.x_mm, pose.y_mm - from.y_mm);
        self.world.push(
            dx * c + dy * s,
            dy * c - dx * s,
            pose.heading_rad - from.heading_rad,
        );
    }

    fn drive(&mut self) {
        let (pose, delta) = self.tick();
        self.wheels = self.controller.drive(&pose, &delta);
    }

    /// To a pose in the world, from where it stands.
    fn go(&mut self, x: f64, y: f64, degrees: f64, patience: f64) -> Trip {
        let from = self.world.pose();
        let (dx, dy) = (x - from.x_mm, y - from.y_mm);
        let length = dx.hypot(dy).max(1e-9);
        let (ux, uy) = (dx / length, dy / length);
        self.controller.set_target(pose(x, y, degrees));
        let mut trip = Trip {
            seconds: None,
            position: 0.0,
            rotation: 0.0,
            overshoot: f64::MIN,
            beside: 0.0,
            hunts: 0,
        };
        let start = self.world.time_s();
        let mut held = 0;
        while self.world.time_s() - start < patience && held < 100 {
            self.drive();
            let now = self.world.pose();
            let (px, py) = (now.x_mm - x, now.y_mm - y);
            trip.overshoot = trip.overshoot.max(px * ux + py * uy);
            trip.beside = trip.beside.max((px * uy - py * ux).abs());
            if std::env::var_os("TRACE").is_some() {
                let (l, r) = self.world.wheel_speeds_deg_s();
                println!(
                    "{:.2} {:?} x {:.1} y {:.1} h {:.2} speeds {l:.0} {r:.0} {:?} shares {:?}",
                    self.world.time_s() - start,
                    self.controller,
                    now.x_mm,
                    now.y_mm,
                    now.heading_rad.to_degrees(),
                    self.wheels,
                    self.controller.mixer().shares()
                );
            }
            if self.controller.arrived() {
                held += 1;
                trip.seconds.get_or_insert(self.world.time_s() - start);
            } else if held > 0 {
                held = 0;
                trip.hunts += 1;
            }
        }
        let now = self.world.pose();
        trip.position = (now.x_mm - x).hypot(now.y_mm - y);
        trip.rotation = around(now.heading_rad - degrees.to_radians())
            .to_degrees()
            .abs();
        trip
    }
}

fn apart(percent: f64) -> Params {
    let mut params = Params::default();
    let scale = |m: MotorParams, by: f64| MotorParams {
        speeds_deg_s: m.speeds_deg_s.map(|s| s * by),
        ..m
    };
    let common = MotorParams::first_board_right();
    params.motors = Sides::new(scale(common, 1.0 - percent / 100.0), common);
    params
}

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

fn assert_all_good(trips: &[Trip]) {
    for trip in trips {
        assert!(trip.seconds.is_some(), "never arrived: {trip:?}");
        assert!(trip.position <= 5.0 && trip.rotation <= 1.0, "{trip:?}");
        assert!(trip.overshoot <= 30.0 && trip.hunts == 0, "{trip:?}");
    }
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

/// Ticks without a new target.
fn settle(robot: &mut Robot, ticks: u32) {
    for _ in 0..ticks {
        robot.drive();
    }
}

#[test]
fn it_holds_its_place_against_a_push_that_turns_the_wheels() {
    for (left, right) in [(60.0, 60.0), (-60.0, 60.0), (-300.0, -200.0), (0.0, 500.0)] {
        let mut robot = Robot::new(&first_board(), Params::default());
        assert_all_good(&[robot.go(300.0, 100.0, 30.0, 60.0)]);
        // A hand rolls it away: the wheels turn by these degrees, the encoders see it.
        for _ in 0..50 {
            robot.push(left / 50.0, right / 50.0);
            robot.tick();
        }
        robot.drive();
        assert!(!robot.controller.arrived(), "it did not notice");
        assert_all_good(&[robot.go(300.0, 100.0, 30.0, 60.0)]);
    }
}

#[test]
fn at_rest_it_brakes_and_stays() {
    let mut robot = Robot::new(&first_board(), Params::default());
    assert_all_good(&[robot.go(200.0, 0.0, 90.0, 60.0)]);
    let before = robot.world.pose();
    for _ in 0..6000 {
        robot.drive();
        assert!(robot.controller.arrived() && robot.wheels == Wheels::BRAKE);
    }
    assert_eq!(robot.world.pose(), before);
}

#[test]
fn the_same_target_again_changes_nothing_and_none_brakes() {
    let mut robot = Robot::new(&first_board(), Params::default());
    settle(&mut robot, 10);
    assert!(robot.wheels == Wheels::BRAKE && !robot.controller.moving());
    robot.controller.set_target(pose(500.0, 0.0, 0.0));
    for _ in 0..300 {
        // As frames do, 40 times a second and more.
        robot.controller.set_target(pose(500.0, 0.0, 0.0));
        robot.drive();
    }
    assert!(robot.controller.moving() && robot.world.pose().x_mm > 150.0);
    robot.controller.halt();
    settle(&mut robot, 1);
    assert_eq!(robot.wheels, Wheels::BRAKE);
    settle(&mut robot, 100);
    assert!(!robot.controller.arrived() && !robot.controller.moving());
    assert_all_good(&[robot.go(500.0, 0.0, 0.0, 60.0)]);
}

#[test]
fn a_target_that_moves_while_driving_is_followed() {
    let mut robot = Robot::new(&first_board(), Params::default());
    for k in 0..800 {
        let angle = f64::from(k) * 0.002;
        robot
            .controller
            .set_target(pose(700.0 * angle.sin(), 700.0 * (1.0 - angle.cos()), 0.0));
        robot.drive();
    }
    assert_all_good(&[robot.go(0.0, 700.0, 180.0, 60.0)]);
}

#[test]
fn tuning_the_rotation_sets_the_motors_against_each_other_and_nothing_else() {
    let mut robot = Robot::new(&first_board(), Params::default());
    for percent in [30, -60, 100] {
        let duty = Duty::saturating(percent * 100);
        let wheels = robot.controller.tune_rotate(duty);
        assert_eq!(wheels.right, Drive::Run(duty));
        assert_eq!(wheels.left, Drive::Run(Duty::saturating(-percent * 100)));
    }
    assert_eq!(robot.controller.tune_rotate(Duty::ZERO), Wheels::BRAKE);
}

#[test]
fn tuning_the_movement_keeps_the_angle_with_the_rotation_pid() {
    for percent in [40, 80, -60] {
        let mut robot = Robot::new(&first_board(), Params::default());
        for _ in 0..400 {
            let (pose, delta) = robot.tick();
            robot.wheels =
                robot
                    .controller
                    .tune_move(Duty::saturating(percent * 100), &pose, &delta);
        }
        let now = robot.world.pose();
        assert!(now.x_mm * f64::from(percent) > 2000.0, "{now:?}");
        assert!(now.heading_rad.to_degrees().abs() < 12.0, "{now:?}");
        let (pose, delta) = robot.tick();
        let wheels = robot.controller.tune_move(Duty::ZERO, &pose, &delta);
        assert_eq!(wheels, Wheels::BRAKE);
    }
}

#[test]
fn a_motor_that_is_wired_backwards_is_driven_backwards() {
    let mut config = first_board();
    config.platform.motor_left_reversed = true;
    let mut robot = Robot::new(&config, Params::default());
    let wheels = robot.controller.tune_rotate(Duty::saturating(5000));
    assert_eq!(wheels.left, wheels.right);
}

#[test]
fn no_limit_of_a_wheel_is_exceeded() {
    let mut config = first_board();
    config.platform.limit_left = 6000;
    config.platform.limit_right = 4500;
    let mut robot = Robot::new(&config, Params::default());
    robot.controller.set_target(pose(2000.0, 1000.0, 90.0));
    for _ in 0..3000 {
        robot.drive();
        let within = |drive: Drive, limit: u16| match drive {
            Drive::Run(duty) => duty.hundredths().unsigned_abs() <= limit,
            Drive::Brake | Drive::Coast => true,
        };
        assert!(within(robot.wheels.left, 6000) && within(robot.wheels.right, 4500));
    }
    assert!(robot.controller.arrived());
}

#[test]
fn no_pose_target_or_reading_overflows_whatever_the_configuration() {
    // With the test build's overflow checks on.
    let mut word = 0x1234_5678_9ABC_DEF1u64;
    let mut chance = move || {
        word ^= word << 13;
        word ^= word >> 7;
        word ^= word << 17;
        word
    };
    for round in 0..400u64 {
        let mut config = first_board();
        let double = |v: f64| crate::double::Double(v.to_bits());
        let gain = [0.0, 1e-9, 1.3, 1e4];
        for gains in [&mut config.forward, &mut config.rotation] {
            gains.p = double(gain[chance() as usize % 4]);
            gains.i = double(gain[chance() as usize % 4]);
            gains.d = double(gain[chance() as usize % 4]);
            gains.anti_windup = double(gain[chance() as usize % 4]);
        }
        config.platform.dead_zone_left = (chance() % 10_000) as u16;
        config.platform.limit_left = 1 + (chance() % 10_000) as u16;
        config.platform.limit_right = 1;
        config.platform.position_tolerance = 200 + (chance() % 65_000) as u16;
        config.platform.rotation_tolerance = 8 + (chance() % 0x1FF8) as u16;
        let mut controller = Controller::new(&config);
        let pick = |a: u64, b: u64| {
            let bits = match a % 5 {
                0 => i64::MIN,
                1 => i64::MAX,
                2 => 0,
                3 => b as i64,
                _ => (b as i64) >> (a >> 8 & 63),
            };
            Millimetres(I32F32::from_bits(bits))
        };
        for k in 0..200 {
            let mut random = || Pose {
                x: pick(chance(), chance()),
                y: pick(chance(), chance()),
                heading: Turns(chance() as u32),
            };
            let (here, target) = (random(), random());
            if k % 7 == round % 7 {
                controller.set_target(target);
            }
            let delta = Delta {
                left: (chance() % 65_537) as i32 - 32_768,
                right: (chance() % 65_537) as i32 - 32_768,
                travel: fixed::types::I16F16::from_bits(chance() as i32),
                turn: chance() as i32,
            };
            let _ = controller.drive(&here, &delta);
            if k % 50 == 0 {
                let duty = Duty::saturating((chance() % 20_001) as i32 - 10_000);
                let _ = controller.tune_move(duty, &here, &delta);
                let _ = controller.tune_rotate(duty);
            }
        }
    }
}

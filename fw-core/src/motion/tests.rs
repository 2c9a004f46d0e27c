//! Closed loop at 100 Hz on the model of the first board's body, odometry and drive monitor included.

mod faults;
mod velocity;

use std::f64::consts::{PI, TAU};
use std::println;

use fixed::types::I32F32;
use plant::{MotorInput, MotorParams, Params, Room, Sides, World};

use super::{DriveMonitor, Odometry, PoseController};
use crate::eeprom::{Config, config_with, fields, first_board};
use crate::types::{Delta, Duty, Faults, Millimetres, MotorCommand, MotorCommands, Pose, Turns};

/// A robot on an open floor.
struct Robot<C = PoseController> {
    world: World,
    odometry: Odometry,
    controller: C,
    commands: MotorCommands,
    monitor: DriveMonitor,
    faults: Faults,
    /// Counts that the wheels were rolled forward by force.
    rolled: (i64, i64),
}

/// A motion to a target, measured on the model.
#[derive(Clone, Copy, Debug, Default)]
struct Trip {
    /// Until the first arrival; `None` without one.
    seconds: Option<f64>,
    /// Errors after a second of holding: mm, degrees.
    position: f64,
    rotation: f64,
    /// Farthest beyond the target along the straight line, mm.
    overshoot: f64,
    /// Departures from the hold.
    hunts: u32,
}

/// Millimetres and degrees.
pub(super) fn pose(x: f64, y: f64, degrees: f64) -> Pose {
    let fixed = |v: f64| Millimetres(I32F32::from_bits((v * 4_294_967_296.0) as i64));
    Pose {
        x: fixed(x),
        y: fixed(y),
        heading: Turns((degrees.rem_euclid(360.0) / 360.0 * 4_294_967_296.0) as u64 as u32),
    }
}

/// The duty of a driven motor, hundredths of a percent.
#[track_caller]
pub(super) fn duty(command: MotorCommand) -> i32 {
    match command {
        MotorCommand::Run(duty) => duty.hundredths().into(),
        MotorCommand::Brake | MotorCommand::Coast => panic!("{command:?}"),
    }
}

impl Robot {
    fn new(config: &Config, params: Params) -> Self {
        Self::with(PoseController::new(config), config, params)
    }
}

impl<C> Robot<C> {
    fn with(controller: C, config: &Config, params: Params) -> Self {
        let world = World::new(params, Room::default(), plant::Pose2::default(), 1);
        Self {
            world,
            odometry: Odometry::new(config, 0, 0),
            controller,
            commands: MotorCommands::BRAKE,
            monitor: DriveMonitor::new(config),
            faults: Faults::NONE,
            rolled: (0, 0),
        }
    }

    fn tick(&mut self) -> (Pose, Delta) {
        let input = |command| match command {
            MotorCommand::Coast => MotorInput::COAST,
            MotorCommand::Brake => MotorInput::BRAKE,
            MotorCommand::Run(duty) => MotorInput::run(f64::from(duty.hundredths()) / 1e4),
        };
        let (left, right) = (input(self.commands.left), input(self.commands.right));
        self.world.step(0.01, left, right);
        let Sides { left, right } = self.world.wheel_counts();
        let (left, right) = (left - self.rolled.0, right - self.rolled.1);
        let delta = self.odometry.step(left as u32, right as u16);
        self.faults |= self.monitor.step(&self.commands, &delta);
        (self.odometry.pose(), delta)
    }

    /// Rolls the wheels by these degrees by force.
    fn push(&mut self, left: f64, right: f64) {
        let counts = |degrees: f64| (degrees / 360.0 * 3840.0).round();
        self.rolled.0 += counts(left) as i64;
        self.rolled.1 += counts(right) as i64;
        let mm = |degrees: f64| counts(degrees) / 3840.0 * 80.0 * PI;
        let step = plant::Pose2::default().advance_arc(mm(left), mm(right), 125.0);
        self.world.push(&step);
    }
}

impl Robot {
    fn drive(&mut self, ticks: u32) {
        for _ in 0..ticks {
            let (pose, delta) = self.tick();
            self.commands = self.controller.drive(&pose, &delta);
        }
    }

    fn tune_move(&mut self, duty: Duty) {
        let (pose, delta) = self.tick();
        self.commands = self.controller.tune_move(duty, &pose, &delta);
    }

    fn go(&mut self, x: f64, y: f64, degrees: f64) -> Trip {
        let from = self.world.pose();
        let (dx, dy) = (x - from.x_mm, y - from.y_mm);
        let length = dx.hypot(dy).max(1e-9);
        self.controller.set_target(pose(x, y, degrees));
        let mut trip = Trip {
            overshoot: f64::MIN,
            ..Trip::default()
        };
        let start = self.world.time_s();
        let mut held = 0;
        while self.world.time_s() - start < 60.0 && held < 100 {
            self.drive(1);
            let now = self.world.pose();
            let beyond = ((now.x_mm - x) * dx + (now.y_mm - y) * dy) / length;
            trip.overshoot = trip.overshoot.max(beyond);
            if self.controller.arrived() {
                held += 1;
                trip.seconds.get_or_insert(self.world.time_s() - start);
            } else if held > 0 {
                held = 0;
                trip.hunts += 1;
            }
        }
        assert_eq!(self.faults, Faults::NONE);
        let now = self.world.pose();
        trip.position = (now.x_mm - x).hypot(now.y_mm - y);
        let turned = now.heading_rad - degrees.to_radians() + PI;
        trip.rotation = (turned.rem_euclid(TAU) - PI).to_degrees().abs();
        trip
    }

    #[track_caller]
    fn assert_reaches(&mut self, x: f64, y: f64, degrees: f64) -> Trip {
        let trip = self.go(x, y, degrees);
        assert!(trip.seconds.is_some(), "never arrived: {trip:?}");
        assert!(trip.position <= 5.0 && trip.rotation <= 1.0, "{trip:?}");
        assert!(trip.overshoot <= 30.0 && trip.hunts == 0, "{trip:?}");
        trip
    }
}

/// From rest to targets all around; those a metre away within so many seconds.
fn assert_reaches_every_pose(config: &Config, params: &Params, metre_s: f64) {
    for distance in [0.0, 10.0, 50.0, 200.0, 1000.0, 3000.0] {
        for bearing in [0.0f64, 45.0, 90.0, 180.0, -135.0] {
            for rotation in [0.0, 90.0, 180.0, -60.0] {
                let mut robot = Robot::new(config, params.clone());
                let (s, c) = bearing.to_radians().sin_cos();
                let trip = robot.assert_reaches(distance * c, distance * s, rotation);
                println!("{distance:6} {bearing:5} {rotation:4}: {trip:.2?}");
                let seconds = trip.seconds.unwrap_or(f64::MAX);
                assert!((distance - 1000.0).abs() > 1.0 || seconds <= metre_s);
            }
        }
    }
}

// Requirement: DOC-5.2.1-1, DOC-6.0.2-2
#[test]
fn first_board_reaches_every_pose() {
    // Five seconds of a metre are at the weaker wheel's full speed.
    assert_reaches_every_pose(&first_board(), &Params::default(), 9.0);
}

#[test]
fn wheels_40_percent_apart_reach_every_pose() {
    let right = MotorParams::first_board_right();
    let left = MotorParams {
        speeds_deg_s: right.speeds_deg_s.map(|speed| speed * 0.6),
        ..right
    };
    let params = Params {
        motors: Sides::new(left, right),
        ..Params::default()
    };
    assert_reaches_every_pose(&first_board(), &params, 11.5);
}

#[test]
fn empty_battery_reaches_every_pose() {
    let mut params = Params::default();
    params.battery.charge = [0.05, 0.05];
    assert_reaches_every_pose(&first_board(), &params, 12.5);
}

#[test]
fn other_gains_reach_every_pose() {
    let config = config_with(&[
        (fields::ROTATION_P, 4.0_f64.to_bits()),
        (fields::ROTATION_I, 0.02_f64.to_bits()),
        (fields::ROTATION_D, 80.0_f64.to_bits()),
        (fields::FORWARD_P, 4.0_f64.to_bits()),
        (fields::FORWARD_I, 0.02_f64.to_bits()),
        (fields::FORWARD_D, 90.0_f64.to_bits()),
    ]);
    assert_reaches_every_pose(&config, &Params::default(), 9.0);
}

#[test]
fn stiction_above_the_dead_zone_is_overcome_without_integral() {
    // By 5 %: smaller outputs move nothing.
    let config = config_with(&[
        (fields::DEAD_ZONE_LEFT, 1600 - 500),
        (fields::DEAD_ZONE_RIGHT, 2300 - 500),
        (fields::ROTATION_I, 0),
        (fields::FORWARD_I, 0),
    ]);
    let targets = [(10.0, 0.0), (10.0, 90.0), (50.0, -60.0)];
    for (x, rotation) in targets
        .into_iter()
        .chain([(-10.0, 0.0), (-50.0, 0.0), (-200.0, 180.0)])
    {
        Robot::new(&config, Params::default()).assert_reaches(x, 0.0, rotation);
    }
}

#[test]
fn tour_of_the_default_room_takes_less_than_five_minutes() {
    let mut robot = Robot::new(&first_board(), Params::default());
    for way in &Room::two_rooms().tour {
        robot.assert_reaches(way.x_mm, way.y_mm, way.heading_rad.to_degrees());
    }
    println!("{:.1} s", robot.world.time_s());
    assert!(robot.world.time_s() < 300.0);
}

#[test]
fn unequal_wheels_agree_within_8_percent_after_a_second() {
    let mut robot = Robot::new(&first_board(), Params::default());
    robot.controller.set_target(pose(3000.0, 0.0, 0.0));
    robot.drive(100);
    for _ in 0..1000 {
        robot.drive(1);
        let Sides { left, right } = robot.world.wheel_speeds_deg_s();
        assert!((left / right - 1.0).abs() < 0.08, "{left} {right}");
        assert!(robot.world.pose().y_mm.abs() < 10.0);
    }
}

#[test]
fn hold_is_braked_and_a_push_is_answered() {
    for (left, right) in [(60.0, 60.0), (-60.0, 60.0), (-300.0, -200.0), (0.0, 500.0)] {
        let mut robot = Robot::new(&first_board(), Params::default());
        robot.assert_reaches(300.0, 100.0, 30.0);
        let before = robot.world.pose();
        for _ in 0..1000 {
            robot.drive(1);
            assert!(robot.controller.arrived() && robot.commands == MotorCommands::BRAKE);
        }
        assert_eq!(robot.world.pose(), before);
        for _ in 0..50 {
            robot.push(left / 50.0, right / 50.0);
            robot.tick();
        }
        robot.drive(1);
        assert!(!robot.controller.arrived());
        let back = robot.assert_reaches(300.0, 100.0, 30.0);
        assert!(back.seconds < Some(12.0), "{back:?}");
    }
}

#[test]
fn target_repeated_every_tick_is_reached_and_halt_brakes() {
    let mut robot = Robot::new(&first_board(), Params::default());
    robot.drive(10);
    assert!(robot.commands == MotorCommands::BRAKE && !robot.controller.moving());
    for _ in 0..300 {
        robot.controller.set_target(pose(500.0, 0.0, 0.0));
        robot.drive(1);
    }
    assert!(robot.controller.moving() && robot.world.pose().x_mm > 150.0);
    robot.controller.halt();
    robot.drive(1);
    assert_eq!(robot.commands, MotorCommands::BRAKE);
    robot.drive(100);
    assert!(!robot.controller.arrived() && !robot.controller.moving());
    robot.assert_reaches(500.0, 0.0, 0.0);
}

#[test]
fn moving_target_is_followed() {
    let mut robot = Robot::new(&first_board(), Params::default());
    for k in 0..800 {
        let angle = f64::from(k) * 0.002;
        let target = pose(700.0 * angle.sin(), 700.0 * (1.0 - angle.cos()), 0.0);
        robot.controller.set_target(target);
        robot.drive(1);
    }
    robot.assert_reaches(0.0, 700.0, 180.0);
}

// Requirement: DOC-5.2.3-1
#[test]
fn tune_move_keeps_the_heading() {
    for percent in [40, 80, -60] {
        let mut robot = Robot::new(&first_board(), Params::default());
        let duty = Duty::saturating(percent * 100);
        for _ in 0..400 {
            robot.tune_move(duty);
        }
        let now = robot.world.pose();
        assert!(now.x_mm * f64::from(percent) > 2000.0, "{now:?}");
        assert!(now.heading_rad.to_degrees().abs() < 12.0, "{now:?}");
    }
}

// Requirement: WIRE-platform-3
#[test]
fn reversed_motor_is_driven_backwards() {
    let config = config_with(&[(fields::MOTOR_LEFT_REVERSED, 1)]);
    let mut controller = PoseController::new(&config);
    let commands = controller.tune_rotate(Duty::saturating(5000));
    assert_eq!(commands.left, commands.right);
}

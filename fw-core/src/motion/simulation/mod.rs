//! The controller on the physical robot's models: closed loop at 100 Hz, odometry included.
#![allow(
    clippy::cast_precision_loss,
    reason = "the plant is binary64, and what is measured on it"
)]

extern crate std;

mod holding;
mod total;
mod tuning;
mod watching;
mod ways;

use std::f64::consts::{PI, TAU};

use plant::{MotorInput, MotorParams, Params, Room, Sides, World};

use super::drive_monitor::DriveMonitor;
use super::odometry::Odometry;
use super::pose_controller::PoseController;
use crate::eeprom::{first_board, Config};
use crate::types::{Delta, Duty, Faults, Millimetres, MotorCommand, MotorCommands, Pose, Turns};
use fixed::types::I32F32;

/// One robot on an open floor.
struct Robot {
    world: World,
    odometry: Odometry,
    controller: PoseController,
    wheels: MotorCommands,
    watch: DriveMonitor,
    /// Everything that looked wrong so far.
    faults: Faults,
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

fn input(drive: MotorCommand) -> MotorInput {
    match drive {
        MotorCommand::Coast => MotorInput::COAST,
        MotorCommand::Brake => MotorInput::BRAKE,
        MotorCommand::Run(duty) => MotorInput::run(f64::from(duty.hundredths()) / 1e4),
    }
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

fn around(radians: f64) -> f64 {
    (radians + PI).rem_euclid(TAU) - PI
}

impl Robot {
    fn new(config: &Config, params: Params) -> Self {
        let world = World::new(params, Room::default(), plant::Pose2::default(), 1);
        Self {
            world,
            odometry: Odometry::new(&config.platform, 0, 0),
            controller: PoseController::new(config),
            wheels: MotorCommands::BRAKE,
            watch: DriveMonitor::new(&config.platform),
            faults: Faults::NONE,
            rolled: (0, 0),
        }
    }

    fn tick(&mut self) -> (Pose, Delta) {
        self.world
            .step(0.01, input(self.wheels.left), input(self.wheels.right));
        let Sides { left, right } = self.world.wheel_counts();
        // The first board's encoders count down going forward.
        let (left, right) = (left - self.rolled.0, right - self.rolled.1);
        let delta = self.odometry.step(left as u32, right as u16);
        self.faults |= self.watch.step(&self.wheels, &delta);
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
        self.world
            .push(&plant::Pose2::default().advance_arc(l, r, 125.0));
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

/// Ticks without a new target.
fn settle(robot: &mut Robot, ticks: u32) {
    for _ in 0..ticks {
        robot.drive();
    }
}

fn assert_all_good(trips: &[Trip]) {
    for trip in trips {
        assert!(trip.seconds.is_some(), "never arrived: {trip:?}");
        assert!(trip.position <= 5.0 && trip.rotation <= 1.0, "{trip:?}");
        assert!(trip.overshoot <= 30.0 && trip.hunts == 0, "{trip:?}");
    }
}

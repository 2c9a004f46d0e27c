//! Where to go: exploration of an unknown room, and ways on a known map.
//!
//! ```
//! use geometry::{Point, Pose2};
//! use mapper::{Grid, PoseEstimate};
//! use navigator::{Action, Config, GoTo, Status};
//!
//! // A map of free floor; the robot stands at 0.5 m, 0.5 m and looks along x.
//! let (low, high) = (Point::new(0.0, 0.0), Point::new(2000.0, 1000.0));
//! let map = Grid::from_fn(25.0, low, high, |_| -4.0);
//! let pose = Pose2::new(500.0, 500.0, 0.0);
//! let mut goto = GoTo::new(Config { rest_every_s: 1e9, ..Config::default() }, Point::new(1500.0, 500.0));
//! let mut status = Status {
//!     time_s: 0.0,
//!     estimate: PoseEstimate { pose, ..PoseEstimate::default() },
//!     speed_mm_s: 0.0,
//!     ranges_mm: [Some(2000.0), None, None],
//!     front_bearing_rad: 0.0,
//!     obstacle_limited: false,
//!     stop: None,
//! };
//! // A robot that does at once what is commanded, 40 times per second.
//! while let Action::Drive(velocity) = goto.step(&map, &status) {
//!     let (along, turn) = (velocity.forward_mm_s / 40.0, velocity.yaw_rate_rad_s / 40.0);
//!     let pose = &mut status.estimate.pose;
//!     *pose = pose.advance_arc(along - turn * 50.0, along + turn * 50.0, 100.0);
//!     status.speed_mm_s = velocity.forward_mm_s;
//!     status.time_s += 0.025;
//! }
//! assert!(status.estimate.pose.position().distance_mm(Point::new(1500.0, 500.0)) < 60.0);
//! assert!(status.time_s < 30.0);
//! ```
//!
//! Give every frame to [`Explorer::step`] or [`GoTo::step`] and do what the [`Action`] says. Plans
//! are made seldom; most frames cost microseconds. Paths run along the walls' directions, where
//! an ultrasonic sensor sees smooth walls; before the robot drives where a slanted wall could not
//! have answered, it turns its sensors there.
//!
//! Lengths, angles and frames are those of [`geometry`]; everything is in the frame of the grid.
#![forbid(unsafe_code)]
#![cfg_attr(not(test), warn(clippy::disallowed_methods))]

mod cost_map;
mod driver;
mod explorer;
mod follower;
mod frontier;
mod goto;
mod manoeuvre;
mod planner;
mod sight;
mod tour;
mod trail;
mod walls;

pub use explorer::Explorer;
pub use goto::GoTo;

use geometry::Mount;
use mapper::PoseEstimate;

/// A velocity to drive at.
#[derive(Clone, Copy, Debug, Default, PartialEq)]
pub struct Velocity {
    /// Forward speed, mm/s; negative is back.
    pub forward_mm_s: f64,
    /// Yaw rate, rad/s counter-clockwise.
    pub yaw_rate_rad_s: f64,
    /// Half the width of the front sensor's sweep around straight ahead, radians; 0 looks straight
    /// ahead.
    pub sweep_half_width_rad: f64,
}

/// Why the robot has stopped.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum StopReason {
    /// A wheel does not turn though it is driven.
    Stall,
    /// The wheels and the gyroscope disagree.
    Slip,
    /// The stop deadline ran out: frames were lost.
    Link,
}

/// What the robot reports in a frame.
#[derive(Clone, Copy, Debug)]
pub struct Status {
    /// Time of the report, s.
    pub time_s: f64,
    /// Where the robot is in the frame of the grid.
    pub estimate: PoseEstimate,
    /// Forward speed as reported, mm/s.
    pub speed_mm_s: f64,
    /// Latest front, right and left range, mm; `None` is silence.
    pub ranges_mm: [Option<f64>; 3],
    /// Bearing of the front range, radians counter-clockwise from straight ahead.
    pub front_bearing_rad: f64,
    /// The obstacle stop holds the speed below the command.
    pub obstacle_limited: bool,
    /// A latched stop, if there is one.
    pub stop: Option<StopReason>,
}

impl Status {
    /// Whether the front sensor looks straight ahead, as far as the obstacle stop takes it to.
    fn looks_ahead(&self) -> bool {
        self.front_bearing_rad.abs() < AHEAD_RAD
    }

    /// The front range, mm, where it was measured straight ahead.
    fn range_ahead_mm(&self) -> Option<f64> {
        self.ranges_mm[0].filter(|_| self.looks_ahead())
    }
}

/// 15°, radians.
const AHEAD_RAD: f64 = 0.262;

/// What to do until the next frame.
#[derive(Clone, Copy, Debug, PartialEq)]
pub enum Action {
    /// Drive at this velocity.
    Drive(Velocity),
    /// Clear the fault and resume.
    Resume,
    /// Stand; there is nothing left to do.
    Done(Outcome),
}

/// How it ended.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Outcome {
    /// Everything reachable is known, or the target is reached; the explorer is back at its start.
    Complete,
    /// The time ran out before everything was known; the explorer is back at its start.
    TimeLimit,
    /// [`Explorer::recall`] came before everything was known; the explorer is back at its start.
    Recalled,
    /// No way leads to the target or back to the start, or the robot cannot leave the place of a stop.
    Unreachable,
}

/// What plans keep beside the body, mm.
const MAP_ERROR_MM: f64 = 20.0;
/// Half the width of a sweep that makes turns to look around unnecessary, radians.
const ASIDE_RAD: f64 = 0.6;

/// The robot's size, limits and habits.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Config {
    /// The rangefinders: front, right, left; `None` where none is fitted.
    pub mounts: [Option<Mount>; 3],
    /// Radius of the body around the middle of the axle, mm.
    pub body_mm: f64,
    /// Speed on known floor with ample clearance, mm/s.
    pub cruise_mm_s: f64,
    /// Speed beside unknown floor, mm/s.
    pub slow_mm_s: f64,
    /// Yaw rate of turns, rad/s.
    pub yaw_rate_rad_s: f64,
    /// Half the width of the front sensor's sweep, radians; 0 without a servo.
    pub sweep_half_width_rad: f64,
    /// Interval between rests for the gyro's bias, s …
    pub rest_every_s: f64,
    /// … and their length, s.
    pub rest_s: f64,
    /// A surface seen only from beyond this distance gets a closer look, mm.
    pub closer_look_mm: f64,
    /// Standard deviation of the position beyond which the robot returns to a known place, mm.
    pub lost_mm: f64,
    /// Time after which the explorer goes home, s.
    pub time_limit_s: f64,
}

impl Config {
    /// Clearance of the robot's middle that plans keep, mm: its radius and the map's error.
    pub(crate) fn inflation_mm(&self) -> f64 {
        self.body_mm + MAP_ERROR_MM
    }

    /// Whether the front sensor's sweep sees aside without a turn of the robot.
    pub(crate) fn sweeps_aside(&self) -> bool {
        self.sweep_half_width_rad >= ASIDE_RAD
    }
}

impl Default for Config {
    /// The first board without a servo.
    fn default() -> Self {
        Self {
            mounts: Mount::first_board().map(Some),
            body_mm: 100.0,
            cruise_mm_s: 170.0,
            slow_mm_s: 90.0,
            yaw_rate_rad_s: 1.2,
            sweep_half_width_rad: 0.0,
            rest_every_s: 45.0,
            rest_s: 1.5,
            closer_look_mm: 850.0,
            lost_mm: 80.0,
            time_limit_s: 3600.0,
        }
    }
}

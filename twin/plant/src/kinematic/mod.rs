//! A robot without firmware on the same imperfect world, for developing localisation and exploring
//! at hundreds of times real time.
//!
//! ```
//! use plant::kinematic::{KinematicRobot, VelocityInput};
//! use plant::{Imperfections, Room};
//!
//! let room = Room::two_rooms();
//! let start = room.start;
//! let mut robot = KinematicRobot::new(room, start, Imperfections::default(), 1);
//! let ahead = VelocityInput { forward_mm_s: 100.0, ..VelocityInput::default() };
//! for _ in 0..400 {
//!     robot.step(0.025, ahead);
//! }
//! let sample = robot.sample();
//! // Far on, and stopped before the wall; where it truly is differs from what its wheels counted.
//! assert!(sample.odometry.x_mm > 800.0 && robot.collisions().is_empty());
//! assert!(sample.odometry.distance_mm(&robot.true_pose().relative_to(&start)) > 0.1);
//! ```
//!
//! It replaces motors and firmware by their effect: wheels that follow the commanded velocity through
//! a lag and limits, odometry from counted encoder edges and the configured geometry, the gyroscope's
//! angle and the rangefinders' turns as mode 0x30 reports them, and the core's obstacle stop. Wheels,
//! floor, surfaces and errors are those of [`World`](crate::World).

mod gyro_angle;
mod obstacle_stop;
mod ranging;

use crate::collision::CollisionDetector;
use crate::floor::Floor;
use crate::imperfections::stream;
use crate::{Chassis, Collision, GyroParams, Imperfections, Params, Pose2, Rng, Room, Sides};
use gyro_angle::GyroAngle;
use obstacle_stop::ObstacleStop;
use ranging::Ranging;

/// Period of the control loop, s.
const TICK_S: f64 = 0.01;
/// Lag of the wheels' speed behind the command, s.
const LAG_S: f64 = 0.15;
/// Largest acceleration of a wheel, mm/s².
const ACCELERATION_MM_S2: f64 = 400.0;
/// Largest speed of a wheel, mm/s: the weaker motor at nominal supply.
const WHEEL_MM_S: f64 = 180.0;
/// Slower than this, a wheel without a command stands, mm/s.
const STANDSTILL_MM_S: f64 = 1.0;

/// A command of mode 0x30.
#[derive(Clone, Copy, Debug, Default, PartialEq)]
pub struct VelocityInput {
    /// Forward speed, mm/s.
    pub forward_mm_s: f64,
    /// Yaw rate, rad/s, counter-clockwise.
    pub yaw_rate_rad_s: f64,
    /// Half the width of the front sensor's sweep, radians; 0 looks straight ahead.
    pub sweep_half_width_rad: f64,
}

/// What a report of mode 0x30 carries.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct SensorSample {
    /// Seconds since the start.
    pub time_s: f64,
    /// The pose that the encoders and the configured geometry give, from the origin.
    pub odometry: Pose2,
    /// The gyroscope's own angle since the first bias, radians counter-clockwise; `None` before.
    pub gyro_rad: Option<f64>,
    /// The last readings, front, right, left; mm. `None`: out of range or not measured yet.
    pub ranges_mm: [Option<f64>; 3],
    /// Direction of the front reading, radians counter-clockwise from straight ahead.
    pub front_bearing_rad: f64,
    /// The obstacle stop limits the speed.
    pub obstacle_limited: bool,
}

/// A robot that follows velocities.
#[derive(Clone, Debug)]
pub struct KinematicRobot {
    room: Room,
    configured: Chassis,
    actual: Chassis,
    pose: Pose2,
    time_s: f64,
    /// Time passed that is less than a tick, s.
    rest_s: f64,
    odometry: Pose2,
    /// The wheels' speeds by the configured diameters, mm/s.
    speed_mm_s: Sides<f64>,
    /// The encoders' exact positions, counts.
    counts: Sides<f64>,
    floor: Floor,
    gyro: GyroAngle,
    ranging: Ranging,
    obstacle_stop: ObstacleStop,
    collision: CollisionDetector,
    path_mm: f64,
}

impl KinematicRobot {
    /// The first board's robot at rest at `start` (the room's frame), with the true figures that
    /// the seed draws.
    pub fn new(room: Room, start: Pose2, imperfections: Imperfections, seed: u64) -> Self {
        let actual = imperfections.draw(Params::default(), seed);
        let gyro = imperfections.draw_gyro(GyroParams::exact(), seed);
        Self {
            ranging: Ranging::new(&actual, &room, &imperfections, Rng::new(seed)),
            configured: Chassis::default(),
            actual: actual.chassis,
            pose: start,
            time_s: 0.0,
            rest_s: 0.0,
            odometry: Pose2::default(),
            speed_mm_s: Sides::default(),
            counts: Sides::default(),
            floor: Floor::new(&imperfections, seed),
            gyro: GyroAngle::new(gyro, Rng::stream(seed, stream::GYRO)),
            obstacle_stop: ObstacleStop::default(),
            collision: CollisionDetector::default(),
            path_mm: 0.0,
            room,
        }
    }

    /// Lets `dt_s` seconds pass under this command, in ticks of 10 ms; less than a tick waits for the
    /// next call.
    pub fn step(&mut self, dt_s: f64, command: VelocityInput) {
        self.rest_s += dt_s;
        // Half a nanosecond: sums of binary fractions.
        while self.rest_s > TICK_S - 5e-10 {
            self.rest_s -= TICK_S;
            self.tick(command);
        }
    }

    fn tick(&mut self, command: VelocityInput) {
        self.time_s += TICK_S;
        let before = self.counts.map(f64::floor);
        let turned = self.drive(command);
        let moved = self.counts.map(f64::floor).zip(before).map(|(b, a)| b - a);
        let mm_per_count = self.configured.travel(Sides::new(360.0, 360.0));
        let mm_per_count = mm_per_count.map(|mm| mm / self.configured.counts_per_turn);
        let way = moved.zip(mm_per_count).map(|(counts, mm)| counts * mm);
        let track_mm = self.configured.track_mm;
        self.odometry = self.odometry.advance_arc(way.left, way.right, track_mm);
        let forward = f64::midpoint(way.left, way.right);
        let turn = (way.right - way.left) / track_mm;
        self.obstacle_stop.moved(forward, turn);
        let stands = moved == Sides::default();
        self.gyro.tick(turned / TICK_S, self.time_s, stands);
        let sweep = command.sweep_half_width_rad;
        if let Some((bearing, range)) = self.ranging.tick(&self.pose, &self.room, sweep) {
            self.obstacle_stop.on_range(bearing, range);
        }
    }

    /// Moves the wheels and the robot; returns its turn, radians.
    fn drive(&mut self, command: VelocityInput) -> f64 {
        let half_track = self.configured.track_mm / 2.0;
        let forward = self.obstacle_stop.limit(command.forward_mm_s);
        // A saturated wheel costs forward speed, not yaw rate.
        let about = (command.yaw_rate_rad_s * half_track).clamp(-WHEEL_MM_S, WHEEL_MM_S);
        let most = WHEEL_MM_S - about.abs();
        let forward = forward.clamp(-most, most);
        let wanted = Sides::new(forward - about, forward + about);
        self.speed_mm_s = self.speed_mm_s.zip(wanted).map(|(speed, wanted)| {
            let change = (wanted - speed) * TICK_S / LAG_S;
            let most = ACCELERATION_MM_S2 * TICK_S;
            let speed = speed + change.clamp(-most, most);
            if wanted == 0.0 && speed.abs() < STANDSTILL_MM_S {
                0.0
            } else {
                speed
            }
        });
        if self.speed_mm_s == Sides::default() {
            return 0.0;
        }
        let way = self.speed_mm_s.map(|speed| speed * TICK_S);
        let degrees_per_mm = self.configured.travel(Sides::new(1.0, 1.0)).map(f64::recip);
        let turned = way.zip(degrees_per_mm).map(|(mm, per_mm)| mm * per_mm);
        let travel = self.floor.travel(self.actual.travel(turned));
        let next = self.actual.roll(&self.pose, travel);
        let (room, radius) = (&self.room, self.actual.radius_mm);
        if self
            .collision
            .blocks(room, radius, &self.pose, &next, TICK_S, self.time_s)
        {
            self.speed_mm_s = Sides::default();
            return 0.0;
        }
        self.floor
            .cross(room, &self.pose, &next, self.actual.track_mm);
        let turn = next.heading_rad - self.pose.heading_rad;
        self.path_mm += next.distance_mm(&self.pose);
        self.pose = next;
        let per_mm =
            degrees_per_mm.map(|degrees| degrees * self.configured.counts_per_turn / 360.0);
        let counted = way.zip(per_mm).map(|(mm, per_mm)| mm * per_mm);
        self.counts = self.counts.zip(counted).map(|(at, by)| at + by);
        turn
    }

    /// What the robot reports now.
    pub fn sample(&self) -> SensorSample {
        SensorSample {
            time_s: self.time_s,
            odometry: self.odometry,
            gyro_rad: self.gyro.angle_rad(),
            ranges_mm: self.ranging.ranges_mm,
            front_bearing_rad: self.ranging.front_bearing_rad,
            obstacle_limited: self.obstacle_stop.limits,
        }
    }

    /// The true pose in the room's frame: for the comparison after the run alone.
    pub fn true_pose(&self) -> Pose2 {
        self.pose
    }

    /// Length of the true path, mm.
    pub fn path_mm(&self) -> f64 {
        self.path_mm
    }

    /// The collisions so far.
    pub fn collisions(&self) -> &[Collision] {
        &self.collision.collisions
    }
}

#[cfg(test)]
mod tests;

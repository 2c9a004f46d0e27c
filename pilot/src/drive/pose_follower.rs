//! Drives to a pose by velocity: what the STM's pose controller does in the modes that carry a
//! target is done here in the mode that carries a velocity.
//!
//! The core's [response](Response) to a velocity is known. Each frame gets the velocity after which the robot,
//! commanded to stand from the next frame on, comes to rest at the target: the fastest way that does not
//! overshoot. Real motors differ from the prediction: the rest is corrected from standstill, and by how much they
//! go farther is learned.

mod response;

use super::{ArrivalCriteria, SpeedMeter};
use crate::mapping::mapper_pose;
use fw_core::eeprom::Config;
use host_link::pose::Pose;
use response::{Axes, BRAKED_MM_S, Limits, Response, is_zero};

/// Farthest target behind that is driven back to, mm.
const REVERSE_MM: f64 = 100.0;
/// A target farther aside than this is turned to, from rest and while driving, degrees.
const ASIDE_DEG: (f64, f64) = (5.0, 25.0);
/// Yaw rate of steering per degree aside, 1/s.
const STEERING: f64 = 2.5;
/// Nearer than this the target's bearing is no course to steer, mm.
const NEAR_MM: f64 = 40.0;
/// Slower than this it stands, mm/s and degrees/s.
const SLOW: f64 = 1.0;
/// Shares of a tolerance: within the first the robot stops, beyond the second it starts again.
const SHARES: (f64, f64) = (0.3, 0.7);
/// From a frame to the tick that takes its command, s.
const LATENCY_S: f64 = 0.007;
/// A command lasts so long at least, s: the core takes one each 10 ms, whatever the rate of the frames.
const SHORTEST_S: f64 = 0.015;
/// Longest time from frame to frame that is predicted, s.
const LONGEST_S: f64 = 0.5;
/// Largest overshoot that is learned, mm and degrees.
const OVERSHOOT: Axes = [3.0, 3.0];
/// Halvings in the search for a velocity.
const HALVINGS: u32 = 10;

/// What the robot does. It changes at rest alone: while a turn begins and ends, motors that differ move its
/// middle by millimetres, which it takes back.
#[derive(Clone, Copy, Debug, PartialEq)]
enum Phase {
    /// Stands, at the target as far as it can tell.
    Stand,
    /// Turns on the spot to this rotation, degrees.
    Turn(f64),
    /// Drives to the target, ahead or back.
    Drive { back: bool },
}

/// Follows one target.
pub struct PoseFollower {
    target: Pose,
    tolerance_mm: f64,
    tolerance_deg: f64,
    limits: Limits,
    response: Response,
    phase: Option<Phase>,
    /// What was last planned at rest, and the sign of its error then.
    planned: (Phase, f64),
    /// How much farther than predicted the motors move from rest to rest.
    overshoot: Axes,
    /// The last command, its time, s, and what it moves by the frame after it.
    last: (Axes, f64, Axes),
    speed: SpeedMeter,
    /// Time that a command lasts, s.
    period_s: f64,
    /// The core allows no way back any more.
    back_ended: bool,
}

impl PoseFollower {
    /// Follows `target` to within the configured tolerances, or the criteria's if they are tighter.
    pub fn new(target: Pose, criteria: &ArrivalCriteria, config: &Config) -> Self {
        let turns = f64::from(config.rotation_tolerance().0) / 4_294_967_296.0;
        Self {
            target,
            tolerance_mm: criteria
                .tolerance_mm
                .min(f64::from(config.position_tolerance().0) / 1000.0),
            tolerance_deg: criteria.tolerance_deg.min(turns * 360.0),
            limits: Limits::new(config),
            response: Response::default(),
            phase: None,
            planned: (Phase::Stand, 0.0),
            overshoot: [0.0; 2],
            last: ([0.0; 2], 0.0, [0.0; 2]),
            speed: SpeedMeter::default(),
            period_s: 0.025,
            back_ended: false,
        }
    }

    /// The forward speed, mm/s, and yaw rate, degrees/s, at a reported pose. `limited`: the obstacle stop
    /// holds the speed below the command; `still`: the robot rests.
    pub fn step(&mut self, time_s: f64, pose: Pose, limited: bool, still: bool) -> (f64, f64) {
        let (command, at_s, mut moved) = self.last;
        if self.phase.is_some() && time_s - at_s < SHORTEST_S {
            return command.into();
        }
        if time_s > at_s {
            self.period_s = (time_s - at_s).min(LONGEST_S);
            let moving = !self.response.stands();
            moved = self.response.run(command, self.period_s, &self.limits);
            // By the prediction it has come to rest: what is left is corrected when it has indeed. A command on top of
            // what is still under way would overshoot in turn for ever.
            if moving && self.response.stands() {
                self.phase = Some(Phase::Stand);
            }
        }
        let speed = self.speed.update(time_s, pose);
        if limited {
            if command[0] < 0.0 {
                self.back_ended = true;
                (self.response, self.phase) = (Response::default(), Some(Phase::Stand));
            }
            let ramp = &mut self.response.ramp[0];
            *ramp = ramp.clamp(speed.min(0.0), speed.max(0.0));
        }
        if self.phase.is_none() || still && self.response.stands() {
            self.learn(pose);
            let phase = self.plan(pose);
            self.planned = (phase, error_of(phase, pose, self.target).signum());
            self.phase = Some(phase);
        }
        let latency = self.response.second.map(|speed| speed * LATENCY_S);
        let ahead = Pose::new(moved[0] + latency[0], 0.0, moved[1] + latency[1]).in_frame_of(pose);
        let command = self.towards(ahead);
        self.last = (command, time_s, moved);
        command.into()
    }

    /// Whether no motion is commanded, and none under way.
    pub fn stands(&self) -> bool {
        is_zero(self.last.0) && self.response.stands()
    }

    /// Whether a pose is within the tolerances.
    pub fn reaches(&self, pose: Pose) -> bool {
        pose.distance_mm(self.target) <= self.tolerance_mm
            && pose.rotation_to_deg(self.target).abs() <= self.tolerance_deg
    }

    /// What to do next at rest.
    fn plan(&self, pose: Pose) -> Phase {
        if pose.distance_mm(self.target) <= SHARES.1 * self.tolerance_mm {
            let off = pose.rotation_to_deg(self.target).abs();
            return if off <= SHARES.1 * self.tolerance_deg {
                Phase::Stand
            } else {
                Phase::Turn(self.target.rotation_deg)
            };
        }
        let (ahead_mm, left_mm) = seen_from(pose, self.target);
        let may_reverse = !self.back_ended && self.limits.reverse_mm_s >= BRAKED_MM_S;
        let back = may_reverse && ahead_mm < 0.0 && ahead_mm.hypot(left_mm) < REVERSE_MM;
        let course = course_deg(ahead_mm, left_mm, back);
        if course.abs() > ASIDE_DEG.0 {
            Phase::Turn(pose.rotation_deg + course)
        } else {
            Phase::Drive { back }
        }
    }

    /// Learns at rest how much farther the motion went than it was meant to.
    fn learn(&mut self, pose: Pose) {
        let (phase, sign) = self.planned;
        let axis = match phase {
            Phase::Stand => return,
            Phase::Turn(_) => 1,
            Phase::Drive { .. } => 0,
        };
        let beyond = -sign * error_of(phase, pose, self.target);
        // What ends elsewhere was ended by something else.
        if beyond.abs() <= OVERSHOOT[axis] {
            let overshoot = self.overshoot[axis] + beyond;
            self.overshoot[axis] = overshoot.clamp(0.0, OVERSHOOT[axis]);
        }
    }

    /// How far to go for an error, half of it at least.
    fn aim(&self, axis: usize, error: f64) -> f64 {
        let less = self.overshoot[axis].min(error.abs() / 2.0);
        error - less.copysign(error)
    }

    /// The velocity for a robot that is at `pose` when it takes it.
    fn towards(&mut self, pose: Pose) -> Axes {
        let [way, turn] = self.response.rest([0.0; 2], 0.0, &self.limits);
        match self.phase {
            None | Some(Phase::Stand) => [0.0; 2],
            Some(phase @ Phase::Turn(_)) => {
                let error = self.aim(1, error_of(phase, pose, self.target));
                let ends = (error - turn).abs() <= SHARES.0 * self.tolerance_deg;
                let yaw = (!ends).then(|| self.speed_to(1, error, 0.0));
                [0.0, yaw.unwrap_or(0.0)]
            }
            Some(Phase::Drive { back }) => {
                let (ahead_mm, left_mm) = seen_from(pose, self.target);
                let far = ahead_mm.abs() > NEAR_MM;
                let near_mm = if back { -NEAR_MM } else { NEAR_MM };
                let course = course_deg(if far { ahead_mm } else { near_mm }, left_mm, back);
                if course.abs() > ASIDE_DEG.1 {
                    self.phase = Some(Phase::Turn(pose.rotation_deg + course));
                    return [0.0; 2];
                }
                let aim_mm = self.aim(0, ahead_mm);
                if (aim_mm - way).abs() <= SHARES.0 * self.tolerance_mm {
                    return [0.0; 2];
                }
                let fastest = self.limits.speed[1];
                let yaw = (STEERING * course).clamp(-fastest, fastest);
                let forward = self.speed_to(0, aim_mm, yaw);
                [forward, if forward == 0.0 { 0.0 } else { yaw }]
            }
        }
    }

    /// The speed on an axis, beside this yaw rate, after which the robot rests `error` farther.
    fn speed_to(&self, axis: usize, error: f64, yaw: f64) -> f64 {
        // Against its motion it is commanded to stand first: the core's response is known best from rest.
        if self.response.second[axis] * error.signum() < -SLOW {
            return 0.0;
        }
        let backward = axis == 0 && error < 0.0;
        let fastest = if backward {
            self.limits.reverse_mm_s
        } else {
            self.limits.speed[axis]
        };
        let overshoots = |speed: f64| {
            let mut command = [0.0, yaw];
            command[axis] = speed.copysign(error);
            let moved = self.response.rest(command, self.period_s, &self.limits);
            moved[axis] * error.signum() > error.abs()
        };
        // No more than the ramp reaches within the frame.
        let gained = self.limits.acceleration[axis] * self.period_s;
        let reached = self.response.ramp[axis] * error.signum() + gained;
        let (mut low, mut high) = (0.0, fastest.min(reached.max(0.0)));
        if !overshoots(high) {
            low = high;
        }
        for _ in 0..HALVINGS {
            let middle = f64::midpoint(low, high);
            if overshoots(middle) {
                high = middle;
            } else {
                low = middle;
            }
        }
        low.copysign(error)
    }
}

/// What is left of a phase at a pose, signed: mm ahead, or degrees.
fn error_of(phase: Phase, pose: Pose, target: Pose) -> f64 {
    match phase {
        Phase::Stand => 0.0,
        Phase::Turn(rotation_deg) => pose.rotation_to_deg(Pose::new(0.0, 0.0, rotation_deg)),
        Phase::Drive { .. } => seen_from(pose, target).0,
    }
}

/// How far to turn until something this far ahead and to the left is straight ahead, or straight behind,
/// degrees.
fn course_deg(ahead_mm: f64, left_mm: f64, back: bool) -> f64 {
    let sign = if back { -1.0 } else { 1.0 };
    (sign * left_mm).atan2(sign * ahead_mm).to_degrees()
}

/// How far ahead of a pose another one is, and how far to its left, mm.
fn seen_from(pose: Pose, other: Pose) -> (f64, f64) {
    let seen = mapper_pose(other).relative_to(&mapper_pose(pose));
    (seen.x_mm, seen.y_mm)
}

#[cfg(test)]
mod tests;

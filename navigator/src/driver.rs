//! What exploring and going to a point share: follows a path with regard to the map, rests, and
//! answers stops.

use std::collections::VecDeque;
use std::f64::consts::PI;

use geometry::{Point, Pose2, wrap_angle};
use mapper::{Cell, Grid};

use crate::cost_map::{CostMap, Node, STEP_MM};
use crate::follower::Follower;
use crate::manoeuvre::{Kind, Manoeuvre};
use crate::planner::{Reach, passable};
use crate::sight::Sight;
use crate::trail::Trail;
use crate::{Action, Config, Status, StopReason, Velocity, walls};

/// Interval between two looks at the map along the path, s.
const CHECK_S: f64 = 1.0;
/// The map is looked at this far ahead, mm, which is what the sensors reach, and within this of the path, mm: more
/// clearance changes nothing.
const AHEAD_MM: f64 = 2500.0;
const AROUND_MM: f64 = 400.0;
/// Farther ahead than this, mm, an echo that the map does not explain ends no path: it came from one place of its
/// arc, and the map will know which before the robot is there.
const DOUBT_MM: f64 = 300.0;
/// Delay of that look when something appears in front, s: the next echoes may refute it.
const APPEARED_S: f64 = 0.2;
/// Slanted walls are looked for this long before the reach of the last look ends, mm; the turn that shows
/// them, radians.
const SLANT: (f64, f64) = (130.0, 0.8);
/// The heading counts as along the walls within this, radians.
const ALIGNED_RAD: f64 = 0.3;
/// Way ahead that decides the speed, mm, and the deceleration that is counted on, mm/s².
const SPEED_AHEAD_MM: f64 = 350.0;
const DECELERATION: f64 = 200.0;
/// Speed per clearance beyond the inflation, 1/s, and the slowest, mm/s.
const BY_CLEARANCE: (f64, f64) = (1.2, 60.0);
/// Floor this near to unknown cells is driven slowly, mm.
const UNKNOWN_NEAR_MM: f64 = 110.0;
/// Driving below this speed, mm/s, for this time, s, though more is commanded, is blocked.
const BLOCKED: (f64, f64) = (12.0, 1.0);
/// Clearance that a path may lose as the map moves, mm.
const SHIFT_MM: f64 = 15.0;
/// A contact at this speed is a touch, mm/s: where the map leaves the body no room …
const TOUCH_MM_S: f64 = 18.0;
/// … and heading obliquely for a wall, where the beams lose it, within this of the plane of an echo, mm.
const OBLIQUE_MM: f64 = 170.0;
/// Speed per way to the contact with a close echo, 1/s, and the part of that way that is kept, mm.
const BY_CONTACT: (f64, f64) = (2.0, 15.0);
/// Way back after a stop, mm.
const BACK_MM: f64 = 150.0;
/// A stop within this of the last one, mm, is the same obstacle …
const SAME_PLACE_MM: f64 = 100.0;
/// … unless it is the same stop, still reported, s; then the robot turns about, by this much more each
/// time, radians, and drives away.
const SAME_STOP_S: f64 = 0.5;
const TURN_MORE_RAD: f64 = 0.7;
/// A mark is forgotten after this, s: what stopped the robot may have been an outlier.
const MARK_S: f64 = 400.0;

/// The outcome of a frame.
#[derive(Clone, Copy, Debug, PartialEq)]
pub(crate) enum Step {
    /// Do this.
    Act(Action),
    /// Nothing is left to do; the path's end was reached.
    Arrived,
    /// Nothing is left to do; the path has become impassable or ended at an obstacle.
    Interrupted,
}

/// The state of driving.
#[derive(Clone, Debug)]
pub(crate) struct Driver {
    pub config: Config,
    pub trail: Trail,
    pub sight: Sight,
    /// Motions that come before the path.
    pub queue: VecDeque<Manoeuvre>,
    pub follower: Option<Follower>,
    /// Clearance that the path keeps, mm.
    clearance_mm: f64,
    pub marks: Vec<(f64, Point)>,
    pub map: Option<CostMap>,
    checked_s: f64,
    pub rested_s: f64,
    moving_s: f64,
    interrupted: bool,
    /// Time and place of the last stop, and stops there before it.
    stopped: (f64, Point, u32),
    /// The robot has not left the place of the last stop.
    pub held: bool,
}

impl Driver {
    pub fn new(config: Config) -> Self {
        Self {
            config,
            trail: Trail::default(),
            sight: Sight::default(),
            queue: VecDeque::new(),
            follower: None,
            clearance_mm: config.inflation_mm(),
            marks: Vec::new(),
            map: None,
            checked_s: f64::NEG_INFINITY,
            rested_s: f64::NEG_INFINITY,
            moving_s: 0.0,
            interrupted: false,
            stopped: (f64::NEG_INFINITY, Point::new(0.0, 0.0), 0),
            held: false,
        }
    }

    /// The lattice of the grid as it is now.
    pub fn survey(&mut self, grid: &Grid, time_s: f64) -> CostMap {
        let (marks, driven) = self.obstacles(time_s);
        let driven = (&driven[..], self.config.body_mm);
        self.with_seen(CostMap::new(
            grid,
            walls::direction_rad(grid),
            &marks,
            driven,
        ))
    }

    /// The lattice around the next part of the path, with the grid as it is now.
    fn survey_ahead(&mut self, grid: &Grid, status: &Status) -> Option<CostMap> {
        let (marks, driven) = self.obstacles(status.time_s);
        let (follower, map) = (self.follower.as_ref()?, self.map.as_ref()?);
        let mut points = vec![status.estimate.pose.position()];
        let mut mm = 0.0;
        while mm <= AHEAD_MM {
            points.push(follower.ahead(mm)?);
            mm += STEP_MM;
        }
        let obstacles = (&marks[..], (&driven[..], self.config.body_mm));
        Some(self.with_seen(map.around(&points, AROUND_MM, grid, obstacles)))
    }

    /// The obstacles that are not in the map, and the driven way that what stopped the robot leaves open.
    fn obstacles(&mut self, time_s: f64) -> (Vec<Point>, Vec<Point>) {
        self.marks.retain(|&(since_s, _)| time_s - since_s < MARK_S);
        let mut marks: Vec<Point> = self.marks.iter().map(|&(_, point)| point).collect();
        let driven = self.trail.open(&marks, self.config.body_mm);
        marks.extend(self.sight.unexplained());
        (marks, driven)
    }

    /// Forgets the obstacles that are not in the map.
    pub fn forget_marks(&mut self) {
        self.marks.clear();
        self.sight.forget_unexplained();
    }

    fn with_seen(&self, mut map: CostMap) -> CostMap {
        for index in 0..map.nodes.len() {
            let passed = self.sight.seen_through(map.point(index));
            map.nodes[index].see(passed);
        }
        map
    }

    /// Follows the cheapest way to a reachable node.
    pub fn follow(&mut self, reach: &Reach, node: usize, time_s: f64) {
        self.follower = Some(Follower::new(reach.path(node)));
        self.clearance_mm = reach.inflation_mm;
        self.map = Some(reach.map.clone());
        (self.checked_s, self.moving_s) = (time_s, time_s);
    }

    /// Adds motions to be done before the path is followed.
    pub fn enqueue(&mut self, motions: impl IntoIterator<Item = Kind>) {
        self.queue.extend(motions.into_iter().map(Manoeuvre::from));
    }

    /// Takes a frame.
    pub fn step(&mut self, grid: &Grid, status: &Status) -> Step {
        let pose = status.estimate.pose;
        self.trail.observe(&pose);
        self.held &= distance_mm(&pose, self.stopped.1) < SAME_PLACE_MM;
        let walls_rad = self.walls_rad(&pose);
        if self.sight.observe(status, &self.config, grid, walls_rad) {
            self.checked_s = self.checked_s.min(status.time_s - CHECK_S + APPEARED_S);
        }
        if let Some(reason) = status.stop {
            // A plan may take longer than the stop deadline; that says nothing of the way.
            self.moving_s = status.time_s;
            if reason != StopReason::Link {
                self.recover(status);
            }
            return Step::Act(Action::Resume);
        }
        if self.queue.is_empty() && status.time_s - self.rested_s >= self.config.rest_every_s {
            self.rested_s = status.time_s;
            self.enqueue([Kind::Rest(self.config.rest_s)]);
        }
        let motion = self.next_motion(status);
        if let Some(velocity) = motion.or_else(|| self.follow_path(grid, status)) {
            return self.drive(velocity, &pose);
        }
        self.follower = None;
        if std::mem::take(&mut self.interrupted) {
            return Step::Interrupted;
        }
        Step::Arrived
    }

    /// The velocity of the first motion that has not ended.
    fn next_motion(&mut self, status: &Status) -> Option<Velocity> {
        let pose = &status.estimate.pose;
        let blocked = self.sight.is_blocked(pose, self.config.body_mm)
            || self.contact_limit(pose) < BLOCKED.0;
        while let Some(motion) = self.queue.front_mut() {
            let is_closed = match motion.kind {
                Kind::Straight(mm) if mm > 0.0 => blocked,
                // Nothing looks back: only over floor that was just driven.
                Kind::Straight(_) => self.trail.reversible_mm() <= 0.0,
                Kind::Rest(_) | Kind::Turn(_) => false,
            };
            let velocity = motion.step(status, self.trail.net_rad, &self.config);
            if let Some(velocity) = velocity.filter(|_| !is_closed) {
                self.moving_s = status.time_s;
                return Some(velocity);
            }
            self.queue.pop_front();
        }
        None
    }

    /// Drives at this velocity, slower before a contact; the turn goes on.
    fn drive(&self, velocity: Velocity, pose: &Pose2) -> Step {
        Step::Act(Action::Drive(Velocity {
            forward_mm_s: velocity.forward_mm_s.min(self.contact_limit(pose)),
            sweep_half_width_rad: self.config.sweep_half_width_rad,
            ..velocity
        }))
    }

    /// Speed that stops before the body reaches a close echo, mm/s.
    // Requirement: NAV-contact-1
    fn contact_limit(&self, pose: &Pose2) -> f64 {
        let way = |(way_mm, _): (f64, Point)| BY_CONTACT.0 * (way_mm - BY_CONTACT.1).max(0.0);
        let contact = self.sight.contact(pose, self.config.body_mm);
        let limit = contact.map_or(f64::INFINITY, way);
        let nears = |walls_rad| self.sight.nears_plane(pose, walls_rad, OBLIQUE_MM);
        if self.off_walls_rad(pose).abs() >= ALIGNED_RAD && nears(self.walls_rad(pose)) {
            return limit.min(TOUCH_MM_S);
        }
        limit
    }

    /// A direction of the walls; that of the heading before they are known.
    fn walls_rad(&self, pose: &Pose2) -> f64 {
        let map = self.map.as_ref();
        map.map_or(pose.heading_rad, CostMap::direction_rad)
    }

    /// The heading's offset from the nearest of the walls' directions, radians.
    fn off_walls_rad(&self, pose: &Pose2) -> f64 {
        pose.heading_rad - walls::nearest_rad(pose.heading_rad, self.walls_rad(pose))
    }

    fn follow_path(&mut self, grid: &Grid, status: &Status) -> Option<Velocity> {
        let pose = status.estimate.pose;
        let inflation_mm = self.clearance_mm;
        if status.time_s - self.checked_s >= CHECK_S {
            self.checked_s = status.time_s;
            let map = self.survey_ahead(grid, status)?;
            // What lies under the path has to stay passable, but for the last bit before the end.
            let follower = self.follower.as_ref()?;
            let mut mm = 100.0;
            while mm < AHEAD_MM.min(follower.remaining_mm() - 100.0) {
                let point = follower.ahead(mm)?;
                let is_free = map.at(point).is_some_and(|node| {
                    node.cell != Cell::Occupied && node.clearance_mm >= inflation_mm - SHIFT_MM
                        || passable(node, inflation_mm)
                });
                let is_doubted = || mm > DOUBT_MM && self.sight.doubts(point, inflation_mm);
                self.interrupted |= !is_free && !is_doubted();
                mm += 50.0;
            }
            self.map = Some(map);
            if self.interrupted {
                return None;
            }
        }
        let off_rad = self.off_walls_rad(&pose);
        let (Some(follower), Some(map)) = (&mut self.follower, &self.map) else {
            return None;
        };
        if off_rad.abs() < ALIGNED_RAD && !self.config.sweeps_aside() {
            let ahead = follower.ahead(self.sight.slant_reach_mm() - SLANT.0)?;
            let driven = map.at(ahead).is_some_and(|node| node.driven);
            if !driven && !self.sight.is_slant_seen(ahead) {
                let net_rad = self.trail.net_rad;
                let turn = -SLANT.1.copysign(net_rad) - off_rad;
                self.enqueue([Kind::Turn(net_rad + turn), Kind::Turn(net_rad)]);
                return self.next_motion(status);
            }
        }
        let fastest_mm_s = speed_limit(follower, map, &self.config);
        let is_clear = |node: &Node| node.is_seen() && passable(node, inflation_mm);
        let clear = |from: Point, to: Point| map.line(from, to, is_clear);
        let fastest = (fastest_mm_s, self.config.yaw_rate_rad_s);
        let velocity = follower.step(&pose, fastest, clear)?;
        let held = velocity.forward_mm_s > BLOCKED.0 && status.speed_mm_s < BLOCKED.0;
        if !held {
            self.moving_s = status.time_s;
        } else if status.time_s - self.moving_s > BLOCKED.1 {
            self.recover(status);
            return self.next_motion(status);
        }
        Some(velocity)
    }

    /// Drops the path, marks what stopped the robot, and goes back within what was just driven
    /// straight; where that was in vain, turns about and leaves.
    // Requirement: NAV-recovery-1
    fn recover(&mut self, status: &Status) {
        let pose = status.estimate.pose;
        let (last_s, place, times) = self.stopped;
        let repeat = distance_mm(&pose, place) < SAME_PLACE_MM && last_s > f64::NEG_INFINITY;
        let reported = repeat && status.time_s - last_s < SAME_STOP_S;
        let times = times * u32::from(repeat) + u32::from(repeat && !reported);
        self.stopped = (status.time_s, pose.position(), times);
        self.held = true;
        if reported {
            return;
        }
        self.queue.clear();
        self.follower = None;
        self.interrupted = true;
        // More than the contact would close a way beside it; what a wheel met was not seen.
        let marks = match self.obstacle(&pose) {
            Some(point) if status.stop.is_none() => vec![point],
            _ => [-50.0, 0.0, 50.0]
                .map(|aside| pose.point_at(self.config.inflation_mm(), aside))
                .to_vec(),
        };
        self.marks
            .extend(marks.into_iter().map(|point| (status.time_s, point)));
        let back_mm = self.trail.reversible_mm().min(BACK_MM);
        if times > 0 {
            self.leave(&pose, times - 1);
        } else if back_mm > 20.0 {
            self.enqueue([Kind::Straight(-back_mm)]);
        }
    }

    /// What the body would touch straight ahead.
    fn obstacle(&self, pose: &Pose2) -> Option<Point> {
        Some(self.sight.contact(pose, self.config.body_mm)?.1)
    }

    /// Turns about from what stopped the robot, further after so many turns in vain, and drives away.
    pub fn leave(&mut self, pose: &Pose2, in_vain: u32) {
        let bearing_rad = |point: Point| (point - pose.position()).angle_rad() - pose.heading_rad;
        let obstacle_rad = self.obstacle(pose).map_or(0.0, bearing_rad);
        let about = obstacle_rad + PI + TURN_MORE_RAD * f64::from(in_vain);
        let facing = self.trail.net_rad + wrap_angle(about);
        self.enqueue([Kind::Turn(facing), Kind::Straight(BACK_MM)]);
    }
}

/// Speed for what lies ahead on the path, mm/s.
// Requirement: NAV-contact-1
fn speed_limit(follower: &Follower, map: &CostMap, config: &Config) -> f64 {
    let at = |node: &Node| {
        if node.clearance_mm < config.inflation_mm() - SHIFT_MM {
            return TOUCH_MM_S;
        }
        let (gain, slowest) = BY_CLEARANCE;
        let spare_mm = (node.clearance_mm - config.inflation_mm()).max(0.0);
        let known = if node.is_seen() && node.known_mm > UNKNOWN_NEAR_MM {
            config.cruise_mm_s
        } else {
            config.slow_mm_s
        };
        (slowest + gain * spare_mm).min(known)
    };
    let mut limit = config.cruise_mm_s;
    let mut mm = 0.0;
    while mm <= SPEED_AHEAD_MM.min(follower.remaining_mm()) {
        if let Some(node) = follower.ahead(mm).and_then(|point| map.at(point)) {
            limit = limit.min(libm::hypot(at(node), (2.0 * DECELERATION * mm).sqrt()));
        }
        mm += 50.0;
    }
    limit
}

/// Distance of a pose to a point, mm.
pub(crate) fn distance_mm(pose: &Pose2, point: Point) -> f64 {
    pose.position().distance_mm(point)
}

#[cfg(test)]
pub(crate) mod tests;

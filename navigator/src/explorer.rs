//! Explores an unknown room: chooses what to look at next until nothing reachable is left, then
//! goes home.

use std::f64::consts::{FRAC_PI_2, FRAC_PI_4, TAU};

use geometry::{Point, Pose2, wrap_angle};
use mapper::{Cell, Grid};

use crate::cost_map::{CostMap, Node};
use crate::driver::{Driver, Step, distance_mm};
use crate::frontier::{Kind, Target, frontiers, unseen_surfaces};
use crate::manoeuvre::Kind as Motion;
use crate::planner::Reach;
use crate::tour::next_of_tour;
use crate::{Action, Config, Outcome, Status, Velocity, walls};

/// First rest: the gyro's first bias, s.
const FIRST_REST_S: f64 = 2.0;
/// At most this long until a sweep has come past straight ahead, s.
const SWEEP_S: f64 = 3.0;
/// First straight way, which calibrates wheels against the gyro, and the distance that it keeps from an echo, mm.
const FIRST_WAY_MM: (f64, f64) = (300.0, 300.0);
/// A look turns this far to both sides: three sensors at right angles see all but the way back.
const LOOK_RAD: f64 = 0.9;
/// Net rotation that is unwound at the next look, radians.
const UNWIND_RAD: f64 = 1.25 * TAU;
/// Targets nearer to each other than this are one, mm.
const SAME_MM: f64 = 250.0;
/// A target is given up after this many fruitless tries.
const TRIES: usize = 2;
/// A look that leaves more than this share of the gain was fruitless.
const FRUITLESS: f64 = 0.7;
/// A standing robot's sensors see to this far aside with a sweep, radians.
const FIELD_RAD: f64 = 1.75;
/// A robot that is held gives up after turning away so often.
const LEAVES: u32 = 4;
/// Interruptions of the way home after which the robot gives up, unless it came nearer by so much, mm.
const HOME_TRIES: u32 = 8;
const NEARER_MM: f64 = 100.0;
/// Spacing of the places to return to, mm, and time between two returns, s.
const ANCHORS: (f64, f64) = (300.0, 60.0);

/// What the explorer is about.
#[derive(Clone, Copy, Debug)]
enum Goal {
    /// Waits for the first ranges.
    Begin,
    /// Chooses the next target.
    Choose,
    /// Goes to a target …
    Approach(Target),
    /// … and looks at it.
    Look(Target),
    /// Goes through a gap that is narrower than the robot on the map.
    Pass(Target),
    /// Goes to a place where the position was well known.
    Return,
    /// Goes to the start.
    Home(Outcome),
    /// Turns to the heading of the start.
    Finish(Outcome),
}

/// Explores a room.
#[derive(Clone, Debug)]
pub struct Explorer {
    driver: Driver,
    goal: Goal,
    start: Option<Pose2>,
    /// The first way waits for a look straight ahead until then, s.
    sweep_until_s: f64,
    /// Targets that were looked at in vain, once per try.
    tries: Vec<Target>,
    /// Places on the way and the position's standard deviation there, mm.
    anchors: Vec<(Point, f64)>,
    returned_s: f64,
    targets: usize,
    /// The kind of the last target and when it was chosen, s.
    chosen: Option<(Kind, f64)>,
    /// Time spent for gaps, s, and where the robot stood to look at them.
    gaps_s: f64,
    gap_views: Vec<Point>,
    recalled: bool,
    /// Times that nothing was left to choose while a stop held the robot.
    leaves: u32,
    /// Times that the way home was interrupted without coming nearer, and how near it came, mm.
    homeward: (u32, f64),
}

impl Explorer {
    /// An explorer that starts where the first frame finds it.
    pub fn new(config: Config) -> Self {
        Self {
            driver: Driver::new(config),
            goal: Goal::Begin,
            start: None,
            sweep_until_s: 0.0,
            tries: Vec::new(),
            anchors: Vec::new(),
            returned_s: 0.0,
            targets: 0,
            chosen: None,
            gaps_s: 0.0,
            gap_views: Vec::new(),
            recalled: false,
            leaves: 0,
            homeward: (0, f64::INFINITY),
        }
    }

    /// Number of targets left when the last one was chosen.
    pub const fn targets(&self) -> usize {
        self.targets
    }

    /// Sends the robot home, once it has looked at the present target.
    pub const fn recall(&mut self) {
        self.recalled = true;
    }

    /// Takes a frame: the map as it is now and the robot's report.
    pub fn step(&mut self, grid: &Grid, status: &Status) -> Action {
        if self.start.is_none() {
            self.start = Some(status.estimate.pose);
            self.sweep_until_s = status.time_s + FIRST_REST_S + SWEEP_S;
            self.driver.enqueue([Motion::Rest(FIRST_REST_S)]);
        }
        self.record(status);
        if self.is_resolved() {
            self.driver.follower = None;
            self.goal = Goal::Choose;
        }
        for _ in 0..3 {
            match self.driver.step(grid, status) {
                Step::Act(action) => return action,
                Step::Arrived => self.arrived(grid, status),
                Step::Interrupted => self.interrupted(status),
            }
            if let Goal::Finish(outcome) = self.goal
                && self.driver.queue.is_empty()
            {
                return Action::Done(outcome);
            }
        }
        Action::Drive(Velocity::default())
    }

    /// Remembers where the position was well known.
    fn record(&mut self, status: &Status) {
        let pose = status.estimate.pose;
        let spaced = |&(last, _): &(Point, f64)| distance_mm(&pose, last) >= ANCHORS.0;
        if self.anchors.last().is_none_or(spaced) {
            self.anchors.push((pose.position(), deviation_mm(status)));
        }
    }

    /// Whether the target on the way has been seen meanwhile.
    fn is_resolved(&self) -> bool {
        match (self.goal, &self.driver.map) {
            (Goal::Approach(target), Some(map)) => match target.kind {
                Kind::Frontier => map
                    .at(target.centre)
                    .is_some_and(|node| node.cell != Cell::Unknown),
                // What it looks like from afar is no answer.
                Kind::Gap => false,
                Kind::Surface => self.driver.sight.is_seen_closely(target.centre),
            },
            _ => false,
        }
    }

    fn arrived(&mut self, grid: &Grid, status: &Status) {
        match self.goal {
            // A sweep comes past straight ahead.
            Goal::Begin if !status.looks_ahead() && status.time_s < self.sweep_until_s => {
                self.driver.enqueue([Motion::Rest(0.01)]);
            }
            Goal::Begin => {
                let (most_mm, margin_mm) = FIRST_WAY_MM;
                let range_mm = status.range_ahead_mm();
                let room_mm = range_mm.map_or(most_mm / 2.0, |range| range - margin_mm);
                if room_mm > 50.0 {
                    let way_mm = room_mm.min(most_mm);
                    self.driver
                        .enqueue([Motion::Straight(way_mm), Motion::Straight(-way_mm)]);
                }
                let turns = [FRAC_PI_2, -FRAC_PI_2, 0.0].map(Motion::Turn);
                self.driver
                    .enqueue([Motion::Rest(1.0)].into_iter().chain(turns));
                self.goal = Goal::Choose;
            }
            Goal::Choose | Goal::Look(_) => self.choose(grid, status),
            Goal::Approach(target) => {
                let at = status.estimate.pose.position();
                if target.kind == Kind::Gap {
                    self.gap_views.push(at);
                    self.tries.push(target);
                }
                let map = self.driver.survey(grid, status.time_s);
                let wide = |node: &Node| node.clearance_mm >= self.driver.config.inflation_mm();
                let clear = map.line(at, target.centre, wide);
                let is_tried = self.tries(target.centre, SAME_MM).next().is_some();
                if target.kind == Kind::Frontier && clear && is_tried {
                    self.enter(target.centre, status);
                } else {
                    self.look(Some(target.centre), status);
                }
                self.goal = Goal::Look(target);
            }
            Goal::Return | Goal::Pass(_) => {
                self.look(None, status);
                self.goal = Goal::Choose;
            }
            Goal::Home(outcome) => {
                let heading_rad = self.start.map_or(0.0, |start| start.heading_rad);
                let turn = wrap_angle(heading_rad - status.estimate.pose.heading_rad);
                let facing = Motion::Turn(self.driver.trail.net_rad + turn);
                self.driver.enqueue([facing, Motion::Rest(1.0)]);
                self.goal = Goal::Finish(outcome);
            }
            Goal::Finish(_) => {}
        }
    }

    fn interrupted(&mut self, status: &Status) {
        match self.goal {
            // What stands there is seen now.
            Goal::Pass(target) => {
                self.tries.push(target);
                self.look(Some(target.centre), status);
                self.goal = Goal::Look(target);
            }
            Goal::Approach(target) | Goal::Look(target) => {
                self.tries.push(target);
                // In vain: it gives gaps no time.
                self.chosen = self.chosen.filter(|&(kind, _)| kind == Kind::Gap);
                self.goal = Goal::Choose;
            }
            Goal::Return => self.goal = Goal::Choose,
            Goal::Home(outcome) => {
                let start = self.start.unwrap_or_default().position();
                let left_mm = start.distance_mm(status.estimate.pose.position());
                let (times, nearest_mm) = self.homeward;
                let comes_nearer = left_mm < nearest_mm - NEARER_MM;
                self.homeward = if comes_nearer {
                    (0, left_mm)
                } else {
                    (times + 1, nearest_mm)
                };
                self.goal = match outcome {
                    _ if self.homeward.0 <= HOME_TRIES => Goal::Choose,
                    Outcome::Complete => Goal::Finish(Outcome::Unreachable),
                    late => Goal::Finish(late),
                };
            }
            Goal::Begin | Goal::Choose | Goal::Finish(_) => {}
        }
    }

    /// Turns so that the three sensors see everything but the way back, and `centre`; with a wide sweep
    /// it stands for that, which is a rest for the gyro, too.
    fn look(&mut self, centre: Option<Point>, status: &Status) {
        let pose = status.estimate.pose;
        let net_rad = self.driver.trail.net_rad;
        let unwind = -net_rad.signum();
        let is_wound = net_rad.abs() > UNWIND_RAD;
        let back_rad = if is_wound { unwind * TAU } else { 0.0 };
        let walls_rad = self.driver.map.as_ref().map_or(0.0, CostMap::direction_rad);
        let aligned_rad = walls::nearest_rad(pose.heading_rad, walls_rad);
        let mut base_rad = net_rad + back_rad + wrap_angle(aligned_rad - pose.heading_rad);
        let bearing = |centre: Point| (centre - pose.position()).angle_rad();
        let off_rad = centre.map_or(0.0, |centre| wrap_angle(bearing(centre) - aligned_rad));
        if self.driver.config.sweeps_aside() {
            if off_rad.abs() > FIELD_RAD {
                base_rad += FRAC_PI_2.copysign(off_rad);
            }
            self.driver.rested_s = status.time_s;
            let rest = Motion::Rest(self.driver.config.rest_s);
            self.driver.enqueue([Motion::Turn(base_rad), rest]);
            return;
        }
        if off_rad.abs() > 3.0 * FRAC_PI_4 {
            base_rad += unwind * FRAC_PI_2;
        }
        let turns = [base_rad + unwind * LOOK_RAD, base_rad - unwind * LOOK_RAD];
        self.driver.enqueue(turns.map(Motion::Turn));
    }

    /// Drives straight to unknown floor that no look could clear, as far as the front sensor lets it,
    /// and looks from there: beside an edge or in a narrow passage the echoes come from the sides.
    fn enter(&mut self, centre: Point, status: &Status) {
        let pose = status.estimate.pose;
        let bearing = (centre - pose.position()).angle_rad();
        let facing = self.driver.trail.net_rad + wrap_angle(bearing - pose.heading_rad);
        self.driver.enqueue([
            Motion::Turn(facing),
            Motion::Rest(0.3),
            Motion::Straight(distance_mm(&pose, centre)),
            Motion::Turn(facing + LOOK_RAD),
            Motion::Turn(facing - LOOK_RAD),
        ]);
    }

    /// The fruitless looks within a radius of a place.
    fn tries(&self, centre: Point, radius_mm: f64) -> impl Iterator<Item = &Target> {
        let near = move |tried: &&Target| tried.centre.distance_mm(centre) < radius_mm;
        self.tries.iter().filter(near)
    }

    /// Chooses the next target, or goes home.
    // Requirement: NAV-explore-1
    fn choose(&mut self, grid: &Grid, status: &Status) {
        let (pose, config) = (status.estimate.pose, self.driver.config);
        let map = self.driver.survey(grid, status.time_s);
        let reach = Reach::new(&map, &pose, config.inflation_mm());
        let deviation_mm = deviation_mm(status);
        // Requirement: NAV-explore-2
        if deviation_mm > config.lost_mm && status.time_s - self.returned_s > ANCHORS.1 {
            self.returned_s = status.time_s;
            let well = |&&(_, then_mm): &&(Point, f64)| then_mm < 0.5 * deviation_mm;
            let known = self.anchors.iter().filter(well);
            let nodes = known.filter_map(|&(point, _)| reach.nearest(point, SAME_MM));
            if let Some(node) = nodes.min_by_key(|&node| reach.cost(node)) {
                self.driver.follow(&reach, node, status.time_s);
                self.goal = Goal::Return;
                return;
            }
        }
        let mut targets = frontiers(&reach);
        targets.extend(unseen_surfaces(&reach, grid, &self.driver.sight));
        if let Some((kind, since_s)) = self.chosen.take() {
            let spent_s = status.time_s - since_s;
            let sign = if kind == Kind::Gap { 1.0 } else { -1.0 };
            self.gaps_s = (self.gaps_s + sign * spent_s).max(0.0);
        }
        let same = |a: Point, b: Point| a.distance_mm(b) < SAME_MM;
        if let Goal::Look(last) = self.goal {
            let left = |target: &Target| {
                target.kind == last.kind
                    && same(target.centre, last.centre)
                    && target.gain > FRUITLESS * last.gain
            };
            if targets.iter().any(left) {
                self.tries.push(last);
            }
        }
        let fresh = |target: &Target| self.tries(target.centre, SAME_MM).count() < TRIES;
        targets.retain(fresh);
        if let Goal::Look(last) = self.goal
            && last.kind == Kind::Gap
            && self.pass(last, &targets, &reach, status)
        {
            return;
        }
        if targets.is_empty() {
            targets = self.gaps(&pose, &reach);
        }
        self.targets = targets.len();
        let late = (status.time_s > config.time_limit_s).then_some(Outcome::TimeLimit);
        let late = late.or(self.recalled.then_some(Outcome::Recalled));
        let start = self.start.unwrap_or(pose).position();
        let home = reach.nearest(start, SAME_MM);
        let next = next_of_tour(&reach, &targets, home);
        if let Some(target) = next.filter(|_| late.is_none()) {
            self.driver.follow(&reach, target.view, status.time_s);
            self.leaves = 0;
            self.chosen = Some((target.kind, status.time_s));
            self.goal = Goal::Approach(target);
            return;
        }
        // Requirement: NAV-recovery-1
        let held = self.driver.held;
        self.leaves += u32::from(held);
        if held && late.is_none() && self.leaves <= LEAVES {
            self.driver.leave(&pose, self.leaves - 1);
            self.goal = Goal::Choose;
            return;
        }
        // Elsewhere the way home may lead out.
        let at_start = distance_mm(&pose, start) < SAME_MM;
        let stuck = held && (at_start || self.leaves > 2 * LEAVES);
        self.goal = match home.filter(|_| !stuck) {
            Some(node) => {
                self.driver.follow(&reach, node, status.time_s);
                Goal::Home(late.unwrap_or(Outcome::Complete))
            }
            None => Goal::Finish(Outcome::Unreachable),
        };
    }
}

/// Standard deviation of the position, mm.
fn deviation_mm(status: &Status) -> f64 {
    let covariance = &status.estimate.covariance;
    (covariance[0][0] + covariance[1][1]).max(0.0).sqrt()
}

mod gaps;
#[cfg(test)]
mod tests;

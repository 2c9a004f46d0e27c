//! A drive through every part of a room with the localiser on board, on the robot without firmware.
//!
//! The way is planned on the true room and followed by the true pose: what is judged is the
//! localiser, not a navigator.

use std::collections::BinaryHeap;

use mapper::evaluation::{best_alignment, in_estimate_frame, pose_errors};
use mapper::{Localiser, LocaliserConfig, MapScore, Observation, Point, Pose2, Segment, map_iou};
use plant::kinematic::{KinematicRobot, VelocityInput};
use plant::{Imperfections, Room};

/// Width of the plan's cells, mm.
const CELL_MM: f64 = 50.0;
/// Way from obstacles that is kept, and that is preferred, mm.
const KEEP_MM: f64 = 170.0;
const PREFER_MM: f64 = 260.0;
/// What lies this near to the way is covered, mm.
const SEEN_MM: f64 = 450.0;
/// Period of the frames, s.
pub const FRAME_S: f64 = 0.025;

/// The floor as a lattice of points.
struct Floor<'a> {
    room: &'a Room,
    low: Point,
    columns: usize,
    clearance: Vec<f64>,
}

impl<'a> Floor<'a> {
    #[allow(
        clippy::cast_possible_truncation,
        clippy::cast_sign_loss,
        clippy::cast_precision_loss
    )]
    fn new(room: &'a Room) -> Self {
        let (low, high) = room.bounds();
        let columns = ((high.x_mm - low.x_mm) / CELL_MM).ceil() as usize;
        let rows = ((high.y_mm - low.y_mm) / CELL_MM).ceil() as usize;
        let mut floor = Self {
            room,
            low,
            columns,
            clearance: Vec::new(),
        };
        let clearance = (0..columns * rows).map(|cell| room.clearance_mm(floor.point(cell)));
        floor.clearance = clearance.collect();
        floor
    }

    #[allow(clippy::cast_precision_loss)]
    fn point(&self, cell: usize) -> Point {
        let (column, row) = (cell % self.columns, cell / self.columns);
        let at = |low: f64, number: usize| low + (number as f64 + 0.5) * CELL_MM;
        Point::new(at(self.low.x_mm, column), at(self.low.y_mm, row))
    }

    fn step(&self, cell: usize, direction: usize) -> Option<usize> {
        let column = cell % self.columns;
        let next = match direction {
            0 if column + 1 < self.columns => cell + 1,
            1 => cell + self.columns,
            2 if column > 0 => cell - 1,
            3 => cell.checked_sub(self.columns)?,
            _ => return None,
        };
        (next < self.clearance.len() && self.clearance[next] > KEEP_MM).then_some(next)
    }

    /// The cheapest way from a cell to one that `wanted` accepts: few turns, away from obstacles.
    fn way(&self, from: usize, wanted: impl Fn(usize) -> bool) -> Option<Vec<usize>> {
        let mut cost = vec![u32::MAX; self.clearance.len() * 4];
        let mut origin = vec![usize::MAX; cost.len()];
        let mut queue = BinaryHeap::new();
        for direction in 0..4 {
            cost[from * 4 + direction] = 0;
            queue.push((std::cmp::Reverse(0), from * 4 + direction));
        }
        while let Some((std::cmp::Reverse(so_far), state)) = queue.pop() {
            if so_far > cost[state] {
                continue;
            }
            let (cell, direction) = (state / 4, state % 4);
            if so_far > 0 && wanted(cell) {
                let mut way = vec![cell];
                let mut at = state;
                while origin[at] != usize::MAX {
                    at = origin[at];
                    way.push(at / 4);
                }
                way.reverse();
                return Some(way);
            }
            for turn in [0, 1, 3] {
                let heading = (direction + turn) % 4;
                let Some(next) = self.step(cell, heading) else {
                    continue;
                };
                let narrow = if self.clearance[next] < PREFER_MM {
                    3
                } else {
                    0
                };
                let total = so_far + 1 + narrow + if turn == 0 { 0 } else { 12 };
                let state_next = next * 4 + heading;
                if total < cost[state_next] {
                    cost[state_next] = total;
                    origin[state_next] = state;
                    queue.push((std::cmp::Reverse(total), state_next));
                }
            }
        }
        None
    }

    /// Way-points through everything reachable, and back to the start.
    fn tour(&self) -> Vec<Point> {
        let start = self.room.start.position();
        let by_distance = |&a: &usize, &b: &usize| {
            self.point(a)
                .distance_mm(start)
                .total_cmp(&self.point(b).distance_mm(start))
        };
        let open = |cell: &usize| self.clearance[*cell] > KEEP_MM;
        let home = (0..self.clearance.len())
            .filter(open)
            .min_by(by_distance)
            .unwrap();
        let mut seen = vec![false; self.clearance.len()];
        let mut cells = vec![home];
        loop {
            let at = *cells.last().unwrap();
            let latest = &cells[cells.len().saturating_sub(200)..];
            for (cell, seen) in seen.iter_mut().enumerate() {
                let near = |&at: &usize| self.point(cell).distance_mm(self.point(at)) < SEEN_MM;
                *seen |= latest.iter().any(near);
            }
            let wanted = |cell: usize| !seen[cell] && self.clearance[cell] > PREFER_MM;
            let Some(way) = self.way(at, wanted) else {
                break;
            };
            cells.extend(&way[1..]);
        }
        cells.extend(
            self.way(cells[cells.len() - 1], |cell| cell == home)
                .unwrap_or_default(),
        );
        let straight = |a: usize, b: usize, c: usize| {
            c > b && b > a && c - b == b - a || c < b && b < a && b - c == a - b
        };
        let mut corners: Vec<usize> = Vec::new();
        for (nth, &cell) in cells.iter().enumerate() {
            let inner = nth > 0 && nth + 1 < cells.len();
            if !(inner && straight(cells[nth - 1], cell, cells[nth + 1])) {
                corners.push(cell);
            }
        }
        corners.dedup();
        corners.into_iter().map(|cell| self.point(cell)).collect()
    }
}

/// The result of a drive.
pub struct Drive {
    pub localiser: Localiser,
    pub robot: KinematicRobot,
    /// Frames until the localiser was located.
    pub search_frames: usize,
    /// By frame, relative to the start: estimate, truth, odometry.
    pub poses: Vec<[Pose2; 3]>,
    /// Squared errors in units of the reported covariance, one per second.
    pub nees: Vec<f64>,
}

impl Drive {
    /// A robot at the room's start.
    pub fn new(room: &Room, world: Imperfections, seed: u64, config: LocaliserConfig) -> Self {
        Self {
            localiser: Localiser::new(config),
            robot: KinematicRobot::new(room.clone(), room.start, world, seed),
            search_frames: 0,
            poses: Vec::new(),
            nees: Vec::new(),
        }
    }

    pub fn observation(robot: &KinematicRobot) -> Observation {
        let sample = robot.sample();
        Observation {
            time_s: sample.time_s,
            odometry: sample.odometry,
            gyro_rad: sample.gyro_rad,
            ranges_mm: sample.ranges_mm,
            front_bearing_rad: Some(sample.front_bearing_rad),
        }
    }

    fn drive_frame(&mut self, start: &Pose2, command: VelocityInput) {
        self.robot.step(FRAME_S, command);
        let observation = Self::observation(&self.robot);
        self.localiser.observe(&observation);
        self.search_frames += usize::from(!self.localiser.is_located());
        let truth = self.robot.true_pose().relative_to(start);
        let estimate = self.localiser.estimate();
        self.poses
            .push([estimate.pose, truth, observation.odometry]);
        if self.poses.len().is_multiple_of(40) {
            let covariance = nalgebra::Matrix3::from_fn(|r, c| estimate.covariance[r][c]);
            let off = nalgebra::Vector3::new(
                estimate.pose.x_mm - truth.x_mm,
                estimate.pose.y_mm - truth.y_mm,
                truth.turn_to_rad(&estimate.pose),
            );
            if let Some(inverse) = covariance.try_inverse() {
                self.nees.push((off.transpose() * inverse * off)[0]);
            }
        }
    }

    /// Drives through the whole room, at most for `longest_s`, the front sensor swept by this half
    /// width.
    pub fn tour(&mut self, room: &Room, sweep_half_width_rad: f64, longest_s: f64) {
        let (mut rest, mut next_rest) = (2.0, 45.0);
        let mut goals = Floor::new(room).tour().into_iter();
        let mut goal = goals.next();
        let mut turning = false;
        while let Some(target) = goal {
            let mut command = VelocityInput {
                sweep_half_width_rad,
                ..VelocityInput::default()
            };
            let pose = self.robot.true_pose();
            let towards = Pose2::new(target.x_mm, target.y_mm, 0.0).relative_to(&pose);
            let away = towards.x_mm.hypot(towards.y_mm);
            let off = towards.y_mm.atan2(towards.x_mm);
            let time_s = self.robot.sample().time_s;
            if rest > 0.0 {
                rest -= FRAME_S;
            } else if away < 30.0 {
                goal = goals.next();
                if time_s > next_rest {
                    (rest, next_rest) = (1.5, time_s + 45.0);
                }
            } else {
                turning = off.abs() > if turning { 0.05 } else { 0.4 };
                if turning {
                    command.yaw_rate_rad_s = (3.0 * off).clamp(-0.9, 0.9);
                } else {
                    command.forward_mm_s = 150f64.min(60.0 + away);
                    command.yaw_rate_rad_s = (2.0 * off).clamp(-0.6, 0.6);
                }
            }
            if time_s > longest_s {
                return;
            }
            self.drive_frame(&room.start, command);
        }
    }
}

/// The figures of a drive, map and poses compared after the best rigid alignment of the way.
#[derive(Clone, Copy, Debug)]
pub struct Figures {
    pub map: MapScore,
    pub median_mm: f64,
    pub worst_mm: f64,
    pub heading_deg: f64,
    pub raw_worst_mm: f64,
    pub nees: f64,
    pub minutes: f64,
}

impl Drive {
    /// Estimated (0), true (1) or raw (2) poses, in order.
    pub fn column(&self, which: usize) -> Vec<Pose2> {
        self.poses.iter().map(|poses| poses[which]).collect()
    }

    /// The map's frame in that of the start, by the best rigid alignment of the way.
    pub fn frame(&self) -> Pose2 {
        best_alignment(&self.column(0), &self.column(1))
    }

    /// The room's visible surfaces in the map's frame, by the best rigid alignment of the way.
    pub fn walls(&self, room: &Room) -> Vec<Segment> {
        let walls = room.relative_to_start().visible_surfaces();
        in_estimate_frame(&walls, &self.frame())
    }

    #[allow(clippy::cast_precision_loss)]
    pub fn result(&self, room: &Room) -> Figures {
        let (estimate, truth, raw) = (self.column(0), self.column(1), self.column(2));
        let errors = pose_errors(&estimate, &truth, &self.frame());
        let raw_frame = best_alignment(&raw, &truth);
        Figures {
            map: map_iou(self.localiser.grid(), &self.walls(room), 100.0),
            median_mm: errors.position_mm_median,
            worst_mm: errors.position_mm_max,
            heading_deg: errors.heading_deg_max,
            raw_worst_mm: pose_errors(&raw, &truth, &raw_frame).position_mm_max,
            nees: self.nees.iter().sum::<f64>() / self.nees.len() as f64,
            minutes: self.robot.sample().time_s / 60.0,
        }
    }
}

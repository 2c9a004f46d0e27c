//! Explores a room with the robot without firmware, with the true pose, and compares with the truth afterwards.

use geometry::{Point, Pose2};
use mapper::evaluation::coverage;
use mapper::{Grid, Mount, PoseEstimate, map_iou};
use navigator::{Action, Config, Explorer, Outcome, Status, StopReason, Velocity};
use plant::kinematic::{KinematicRobot, SensorSample, VelocityInput};
use plant::{Collision, Imperfections, Room};

/// Seconds of a frame.
const FRAME_S: f64 = 0.025;

/// What a run was.
struct Run {
    outcome: Option<Outcome>,
    /// Stops that were cleared.
    resumed: u32,
    collisions: Vec<Collision>,
    coverage: f64,
    iou: f64,
    minutes: f64,
    /// Where it ended, in the frame of the start.
    end: Pose2,
    path_mm: f64,
}

/// The true pose, and a map from it with the readings that the true room explains: what a perfect
/// localisation and rejection of multi-path echoes would give.
struct IdealMapper {
    grid: Grid,
    pose: Pose2,
    ranges_mm: [Option<f64>; 3],
    /// Whether the position's deviation grows with the way, and shrinks where it was smaller before.
    drifts: bool,
    /// The way, and the deviation there, mm.
    way: Vec<(Point, f64)>,
}

impl IdealMapper {
    fn new(drifts: bool) -> Self {
        Self {
            grid: Grid::new(25.0),
            pose: Pose2::default(),
            ranges_mm: [None; 3],
            drifts,
            way: Vec::new(),
        }
    }

    fn estimate(&self) -> PoseEstimate {
        let deviation = self.way.last().map_or(0.0, |last| last.1);
        let variance = if self.drifts {
            deviation * deviation
        } else {
            100.0
        };
        PoseEstimate {
            pose: self.pose,
            covariance: [[variance, 0.0, 0.0], [0.0, 100.0, 0.0], [0.0, 0.0, 1e-4]],
        }
    }

    fn observe(&mut self, room: &Room, pose: &Pose2, sample: &SensorSample) {
        self.pose = *pose;
        let mut mounts = Mount::first_board();
        mounts[0].bearing_rad = sample.front_bearing_rad;
        for (nth, mount) in mounts.iter().enumerate() {
            let range = sample.ranges_mm[nth];
            let sensor = mount.sensor_pose(pose);
            let is_silent = range.is_none() && sample.time_s > 0.2;
            if is_silent || range != self.ranges_mm[nth] {
                self.enter(room, &sensor, range);
            }
            self.ranges_mm[nth] = range;
        }
        self.drift(pose.position());
    }

    /// Clears a narrow cone up to the true surfaces, no farther than the range, and enters those that answered.
    fn enter(&mut self, room: &Room, sensor: &Pose2, range_mm: Option<f64>) {
        let true_mm = |ray: &Pose2| room.cast(ray).map_or(4000.0, |hit| hit.distance_mm);
        let has_answered = range_mm.is_some_and(|range| (range - true_mm(sensor)).abs() < 40.0);
        let (reach_mm, free) = range_mm.map_or((800.0, -0.06), |range| (range, -0.3));
        for off in -10..=10 {
            let ray = sensor.facing(sensor.heading_rad + 0.012 * f64::from(off));
            let surface_mm = true_mm(&ray);
            let mut away_mm = 0.0;
            while away_mm < reach_mm.min(surface_mm) - 60.0 {
                self.grid.add_at(ray.point_at(away_mm, 0.0), free);
                away_mm += 25.0;
            }
            if has_answered {
                self.grid.add_at(ray.point_at(surface_mm, 0.0), 0.6);
            }
        }
    }

    fn drift(&mut self, at: Point) {
        let last = self.way.last().copied().unwrap_or((at, 0.0));
        let step_mm = last.0.distance_mm(at);
        if step_mm < 20.0 && !self.way.is_empty() {
            return;
        }
        // What was passed a metre ago counts as met again.
        let before = self.way[..self.way.len().saturating_sub(50)]
            .iter()
            .filter(|(point, _)| point.distance_mm(at) < 300.0);
        let deviations = before.map(|&(_, deviation)| deviation);
        let deviation = deviations.fold(last.1 + 0.01 * step_mm, f64::min);
        self.way.push((at, deviation));
    }
}

/// Drives in the default room until `navigate` is done.
fn drive(
    seed: u64,
    mapping: &mut IdealMapper,
    mut navigate: impl FnMut(&Grid, &Status) -> Action,
) -> Run {
    let room = Room::two_rooms();
    let (start, imperfections) = (Pose2::default(), Imperfections::default());
    let mut robot = KinematicRobot::new(room.clone(), start, imperfections, seed);
    let (mut outcome, mut resumed) = (None, 0);
    let mut velocity = Velocity::default();
    let mut last = robot.sample().odometry;
    while outcome.is_none() && robot.sample().time_s < 1800.0 {
        robot.step(
            FRAME_S,
            VelocityInput {
                forward_mm_s: velocity.forward_mm_s,
                yaw_rate_rad_s: velocity.yaw_rate_rad_s,
                sweep_half_width_rad: velocity.sweep_half_width_rad,
            },
        );
        let sample = robot.sample();
        mapping.observe(&room, &robot.true_pose(), &sample);
        let status = Status {
            time_s: sample.time_s,
            estimate: mapping.estimate(),
            speed_mm_s: sample.odometry.relative_to(&last).x_mm / FRAME_S,
            ranges_mm: sample.ranges_mm,
            front_bearing_rad: sample.front_bearing_rad,
            obstacle_limited: sample.obstacle_limited,
            stop: None,
        };
        last = sample.odometry;
        match navigate(&mapping.grid, &status) {
            Action::Drive(command) => velocity = command,
            Action::Resume => {
                velocity = Velocity::default();
                resumed += 1;
            }
            Action::Done(how) => outcome = Some(how),
        }
    }
    let floor = room.reachable_floor();
    Run {
        outcome,
        resumed,
        collisions: robot.collisions().to_vec(),
        coverage: coverage(&mapping.grid, &floor, &start),
        iou: map_iou(&mapping.grid, &room.visible_surfaces(), 100.0).iou,
        minutes: robot.sample().time_s / 60.0,
        end: robot.true_pose(),
        path_mm: robot.path_mm(),
    }
}

// Requirement: NAV-explore-1
#[test]
fn default_room_is_explored_and_robot_comes_home() {
    let mut explorer = Explorer::new(Config::default());
    let navigate = |grid: &Grid, status: &Status| explorer.step(grid, status);
    let run = drive(101, &mut IdealMapper::new(false), navigate);
    let figures = (run.coverage, run.iou);
    assert_eq!(run.outcome, Some(Outcome::Complete));
    assert_eq!(run.collisions, []);
    assert!(run.coverage > 0.99 && run.iou > 0.95, "{figures:?}");
    let minutes = run.minutes;
    assert!(minutes < 13.0 && run.path_mm > 20_000.0, "{minutes}");
    assert!(run.end.x_mm.hypot(run.end.y_mm) < 80.0, "{:?}", run.end);
    let turned = run.end.turn_to_rad(&Pose2::default());
    assert!(turned.abs() < 0.1, "{turned}");
}

// Requirement: NAV-explore-2
#[test]
fn uncertain_robot_returns_to_known_place() {
    let mut explorer = Explorer::new(Config {
        lost_mm: 25.0,
        ..Config::default()
    });
    let mut mapping = IdealMapper::new(true);
    let navigate = |grid: &Grid, status: &Status| explorer.step(grid, status);
    let run = drive(106, &mut mapping, navigate);
    assert_eq!(run.outcome, Some(Outcome::Complete));
    // Seeds 100 to 107: 57 to 128 mm, 159 to 258 without a return.
    let worst_mm = mapping.way.iter().map(|at| at.1).fold(0.0, f64::max);
    assert!(worst_mm < 140.0, "worst {worst_mm}");
}

// Requirement: NAV-recovery-1
#[test]
fn stops_of_every_kind_are_cleared_and_exploring_completes() {
    let reasons = [StopReason::Stall, StopReason::Link, StopReason::Slip];
    let mut reasons = reasons.into_iter().cycle();
    let mut explorer = Explorer::new(Config::default());
    let (mut count, mut latched) = (0, None);
    let navigate = |grid: &Grid, status: &Status| {
        // Latched for a frame more: the resume is on its way.
        let mut stop = latched.take();
        if status.time_s > 35.0 * f64::from(count + 1) {
            latched = reasons.next();
            stop = latched;
            count += 1;
        }
        explorer.step(grid, &Status { stop, ..*status })
    };
    let run = drive(102, &mut IdealMapper::new(false), navigate);
    assert_eq!(run.outcome, Some(Outcome::Complete));
    assert_eq!((run.collisions.len(), run.resumed), (0, 2 * count));
    assert!(
        count > 12 && run.coverage > 0.97,
        "{count} {}",
        run.coverage
    );
}

// Requirement: NAV-recovery-1
#[test]
fn robot_that_cannot_leave_its_start_does_not_complete() {
    let mut explorer = Explorer::new(Config::default());
    let mut pushed = 0;
    let navigate = |grid: &Grid, status: &Status| {
        // Its wheels stall a second after each command.
        let stop = (pushed == 40).then_some(StopReason::Stall);
        match explorer.step(grid, &Status { stop, ..*status }) {
            Action::Drive(velocity) => {
                let turns = velocity.forward_mm_s.abs() + velocity.yaw_rate_rad_s.abs() > 0.0;
                pushed = if turns { pushed + 1 } else { 0 };
                Action::Drive(Velocity::default())
            }
            action => {
                pushed = 0;
                action
            }
        }
    };
    let run = drive(107, &mut IdealMapper::new(false), navigate);
    assert_eq!(run.outcome, Some(Outcome::Unreachable));
    assert!(run.resumed > 4 && run.path_mm < 1.0, "{}", run.resumed);
}

//! Explores a room with the robot without firmware, and compares with the truth afterwards.

use geometry::Pose2;
use mapper::evaluation::{best_alignment, coverage, in_estimate_frame};
use mapper::{Grid, PoseEstimate, map_iou};
use navigator::{Action, Config, Explorer, Outcome, Status, StopReason, Velocity};
use plant::kinematic::{KinematicRobot, SensorSample, VelocityInput};
use plant::{Collision, Imperfections, Room};

/// Seconds of a frame.
const FRAME_S: f64 = 0.025;

/// What a run was.
#[derive(Clone, Debug)]
pub struct Run {
    pub outcome: Option<Outcome>,
    /// Stops that were cleared.
    pub resumed: u32,
    pub collisions: Vec<Collision>,
    pub coverage: f64,
    pub iou: f64,
    pub minutes: f64,
    /// Where it ended, in the frame of the start.
    pub end: Pose2,
    pub path_mm: f64,
    pub grid: Grid,
    pub truth: Vec<Pose2>,
    pub estimate: Vec<Pose2>,
}

/// What knows the pose and makes the map.
pub trait Mapping {
    fn observe(&mut self, room: &Room, truth: &Pose2, sample: &SensorSample);
    fn estimate(&self) -> PoseEstimate;
    fn grid(&self) -> &Grid;
}

/// Explores. `stop` gives the stops that are latched at a time.
pub fn explore(
    room: &Room,
    seed: u64,
    config: Config,
    mapping: &mut dyn Mapping,
    stop: impl FnMut(f64) -> Option<StopReason>,
) -> Run {
    let mut explorer = Explorer::new(config);
    let navigate = |grid: &Grid, status: &Status| explorer.step(grid, status);
    drive(room, seed, navigate, mapping, stop)
}

/// Drives until `navigate` is done.
pub fn drive(
    room: &Room,
    seed: u64,
    mut navigate: impl FnMut(&Grid, &Status) -> Action,
    mapping: &mut dyn Mapping,
    mut stop: impl FnMut(f64) -> Option<StopReason>,
) -> Run {
    let room = room.relative_to_start();
    let mut robot = KinematicRobot::new(
        room.clone(),
        Pose2::default(),
        Imperfections::default(),
        seed,
    );
    let mut run = Run {
        outcome: None,
        resumed: 0,
        collisions: Vec::new(),
        coverage: 0.0,
        iou: 0.0,
        minutes: 0.0,
        end: Pose2::default(),
        path_mm: 0.0,
        grid: Grid::new(25.0),
        truth: Vec::new(),
        estimate: Vec::new(),
    };
    let mut velocity = Velocity::default();
    let mut last = robot.sample().odometry;
    while run.outcome.is_none() && robot.sample().time_s < 1800.0 {
        robot.step(
            FRAME_S,
            VelocityInput {
                forward_mm_s: velocity.forward_mm_s,
                yaw_rate_rad_s: velocity.yaw_rate_rad_s,
                sweep_half_width_rad: velocity.sweep_half_width_rad,
            },
        );
        let sample = robot.sample();
        let truth = robot.true_pose();
        mapping.observe(&room, &truth, &sample);
        let status = Status {
            time_s: sample.time_s,
            estimate: mapping.estimate(),
            speed_mm_s: sample.odometry.relative_to(&last).x_mm / FRAME_S,
            ranges_mm: sample.ranges_mm,
            front_bearing_rad: sample.front_bearing_rad,
            obstacle_limited: sample.obstacle_limited,
            stop: stop(sample.time_s),
        };
        last = sample.odometry;
        run.truth.push(truth);
        run.estimate.push(status.estimate.pose);
        match navigate(mapping.grid(), &status) {
            Action::Drive(command) => velocity = command,
            Action::Resume => {
                velocity = Velocity::default();
                run.resumed += 1;
            }
            Action::Done(outcome) => run.outcome = Some(outcome),
        }
    }
    run.minutes = robot.sample().time_s / 60.0;
    run.collisions = robot.collisions().to_vec();
    run.path_mm = robot.path_mm();
    run.end = robot.true_pose();
    let aligned = best_alignment(&run.estimate, &run.truth);
    let floor = room.reachable_floor();
    run.coverage = coverage(mapping.grid(), &floor, &aligned);
    let walls = in_estimate_frame(&room.visible_surfaces(), &aligned);
    run.iou = map_iou(mapping.grid(), &walls, 100.0).iou;
    run.grid = mapping.grid().clone();
    run
}

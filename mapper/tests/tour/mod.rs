//! A drive along a room's tour with the localiser on board, on the robot without firmware.
//!
//! The true pose follows the way: what is judged is the localiser, not a navigator.

use mapper::{Localiser, LocaliserConfig, Observation, Pose2};
use plant::kinematic::{KinematicRobot, VelocityInput};
use plant::{Imperfections, Room};

/// Period of the frames, s.
const FRAME_S: f64 = 0.025;

/// The result of a drive.
pub struct Drive {
    pub localiser: Localiser,
    pub robot: KinematicRobot,
    /// Frames until the localiser was located.
    pub search_frames: usize,
    /// By frame, relative to the start: estimate, truth, odometry.
    pub poses: Vec<[Pose2; 3]>,
    /// By frame.
    pub observations: Vec<Observation>,
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
            observations: Vec::new(),
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
        self.observations.push(observation);
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

    /// Drives to so many poses of the room's tour from the `first` on, round and round, at most for `longest_s`.
    pub fn tour(&mut self, room: &Room, first: usize, count: usize, longest_s: f64) {
        let (mut rest, mut next_rest) = (2.0, 45.0);
        let mut goals = room.tour.iter().cycle().skip(first).take(count);
        let mut goal = goals.next();
        let mut turning = false;
        while let Some(target) = goal {
            let mut command = VelocityInput::default();
            let pose = self.robot.true_pose();
            let towards = target.relative_to(&pose);
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

    /// Estimated (0), true (1) or raw (2) poses, in order.
    pub fn column(&self, which: usize) -> Vec<Pose2> {
        self.poses.iter().map(|poses| poses[which]).collect()
    }
}

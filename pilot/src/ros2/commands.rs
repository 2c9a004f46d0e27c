//! What the subscribed topics ask of the robot: checked messages become requests of the server.

use crate::ros_messages::{PoseStamped, Twist};
use crate::serve::protocol::{Request, within};
use host_link::pose::MAX_COORDINATE_MM;
use std::f64::consts::PI;
use std::time::{Duration, Instant};

/// Lease of a velocity and of a goal, ms: a publisher of velocities that is silent for so long does not
/// drive any more.
pub const LEASE_MS: u32 = 500;
/// Time between two renewals of a goal's lease.
const KEEP: Duration = Duration::from_millis(150);
/// Largest speed, m/s, and yaw rate, rad/s; the configuration limits them further.
const MAX_TWIST: (f64, f64) = (1.0, PI);
/// How far an orientation may be from a unit turn about z.
const QUATERNION_ERROR: f64 = 0.01;

/// The state of the node's commands. `P` identifies a publisher.
#[derive(Debug)]
pub struct Commands<P> {
    /// Who drives by `/cmd_vel`, and since when it is silent.
    driver: Option<(P, Instant)>,
    /// When the goal's lease was renewed.
    goal: Option<Instant>,
    /// `/estop` is set.
    stopped: bool,
}

impl<P> Default for Commands<P> {
    fn default() -> Self {
        Self {
            driver: None,
            goal: None,
            stopped: false,
        }
    }
}

impl<P: PartialEq> Commands<P> {
    /// `/cmd_vel`: a velocity, for as long as its publisher does not fall silent.
    ///
    /// # Errors
    /// Names the field, or why the publisher does not drive.
    // Requirement: SERVE-ros2-2, SERVE-ros2-3
    pub fn velocity(&mut self, from: P, twist: &Twist, now: Instant) -> Result<Request, String> {
        let Twist { linear, angular } = twist;
        let (speed, yaw) = MAX_TWIST;
        for (field, value, most) in [
            ("linear.x", linear.x, speed),
            ("linear.y", linear.y, 0.0),
            ("linear.z", linear.z, 0.0),
            ("angular.x", angular.x, 0.0),
            ("angular.y", angular.y, 0.0),
            ("angular.z", angular.z, yaw),
        ] {
            within(field, value, 0.0 - most..=most)?;
        }
        self.ensure_released()?;
        let silence = Duration::from_millis(LEASE_MS.into());
        let mut driver = self.driver.iter();
        if driver.any(|(driver, at)| *driver != from && now.duration_since(*at) < silence) {
            return Err("another publisher drives; it has to fall silent first".into());
        }
        (self.driver, self.goal) = (Some((from, now)), None);
        Ok(Request::Drive {
            forward_mm_s: linear.x * 1000.0,
            yaw_rate_deg_s: angular.z.to_degrees(),
            lease_ms: LEASE_MS,
        })
    }

    /// `/goal_pose`: a point in the frame `map`, which the robot plans its way to, or a pose in the frame
    /// `odom`.
    ///
    /// # Errors
    /// Names the field, or why the robot does not move.
    // Requirement: SERVE-ros2-3
    pub fn goal(&mut self, goal: &PoseStamped, now: Instant) -> Result<Request, String> {
        let (position, turn) = (goal.pose.position, goal.pose.orientation);
        let (most, error) = (MAX_COORDINATE_MM / 1000.0, QUATERNION_ERROR);
        let (length, unit) = (turn.z.hypot(turn.w), 1.0 - error..=1.0 + error);
        for (field, value, accepted) in [
            ("pose.position.x", position.x, -most..=most),
            ("pose.position.y", position.y, -most..=most),
            ("pose.orientation.x", turn.x, -error..=error),
            ("pose.orientation.y", turn.y, -error..=error),
            ("pose.orientation's length", length, unit),
        ] {
            within(field, value, accepted)?;
        }
        let rotation_deg = match goal.header.frame_id.as_str() {
            "map" => None,
            "odom" => Some(turn.degrees()),
            other => {
                let accepted = "accepted is `map` or `odom`";
                return Err(format!("header.frame_id = {other:?}: {accepted}"));
            }
        };
        self.ensure_released()?;
        (self.driver, self.goal) = (None, Some(now));
        Ok(Request::Goto {
            x_mm: position.x * 1000.0,
            y_mm: position.y * 1000.0,
            rotation_deg,
            lease_ms: LEASE_MS,
        })
    }

    /// `/estop`: true stops the robot, whichever client drives it, and refuses commands until it is false.
    // Requirement: SERVE-ros2-2
    pub fn stop(&mut self, stopped: bool) -> Option<Request> {
        self.stopped = stopped;
        stopped.then(|| {
            (self.driver, self.goal) = (None, None);
            Request::Stop
        })
    }

    /// What renews the lease of a goal, if that is due.
    pub fn keep(&mut self, now: Instant) -> Option<Request> {
        let renewed = self.goal.as_mut()?;
        let due = now.duration_since(*renewed) >= KEEP;
        due.then(|| {
            *renewed = now;
            Request::Keep
        })
    }

    /// The goal was refused, or its lease cannot be renewed: the robot is there, or was stopped.
    pub fn end_goal(&mut self) {
        self.goal = None;
    }

    fn ensure_released(&self) -> Result<(), String> {
        if self.stopped {
            return Err("/estop is set; publish false to release it".into());
        }
        Ok(())
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::ros_messages::{Header, Point, Vector3};
    use host_link::pose::Pose;

    fn twist(x: f64, yaw: f64) -> Twist {
        let mut twist = Twist::default();
        (twist.linear.x, twist.angular.z) = (x, yaw);
        twist
    }

    fn axis<'a>(Twist { linear, angular }: &'a mut Twist, field: &str) -> &'a mut f64 {
        let (vector, axis) = field.split_once('.').unwrap();
        let Vector3 { x, y, z } = if vector == "linear" { linear } else { angular };
        match axis {
            "x" => x,
            "y" => y,
            _ => z,
        }
    }

    fn goal(frame: &str) -> PoseStamped {
        PoseStamped {
            header: Header::of(0, frame),
            pose: Pose::new(1500.0, -500.0, 90.0).into(),
        }
    }

    // Requirement: SERVE-ros2-3
    #[test]
    fn command_outside_its_range_is_refused_by_field() {
        let (mut commands, now) = (Commands::default(), Instant::now());
        for value in [f64::NAN, f64::INFINITY, -4.0] {
            for field in [
                "linear.x",
                "linear.y",
                "linear.z",
                "angular.x",
                "angular.y",
                "angular.z",
            ] {
                let mut wrong = twist(0.1, 0.1);
                *axis(&mut wrong, field) = value;
                let refused = commands.velocity(1, &wrong, now).unwrap_err();
                assert!(refused.starts_with(field), "{refused}");
            }
            let mut refused = |field: &str, wrong: PoseStamped| {
                let refused = commands.goal(&wrong, now).unwrap_err();
                assert!(refused.starts_with(field), "{refused}");
            };
            for field in ["pose.position.x", "pose.position.y"] {
                let mut wrong = goal("odom");
                let Point { x, y, .. } = &mut wrong.pose.position;
                *if field.ends_with('x') { x } else { y } = value * 1e9;
                refused(field, wrong);
            }
            let mut wrong = goal("map");
            wrong.pose.orientation.x = value;
            refused("pose.orientation.x", wrong);
            let mut wrong = goal("map");
            wrong.pose.orientation.w = value;
            refused("pose.orientation's length", wrong);
            refused("header.frame_id = \"base_link\"", goal("base_link"));
        }
        assert_eq!(commands.keep(now + Duration::from_secs(1)), None);
        for (x, yaw, good) in [(-1.0, PI, true), (1.001, 0.0, false), (0.0, -3.15, false)] {
            assert_eq!(commands.velocity(1, &twist(x, yaw), now).is_ok(), good);
        }
        for (x, length, good) in [
            (0.009, 0.991, true),
            (-0.011, 1.0, false),
            (0.0, 0.989, false),
            (0.0, 1.011, false),
        ] {
            let mut tilted = goal("map");
            let turn = &mut tilted.pose.orientation;
            (turn.x, turn.z, turn.w) = (x, 0.0, length);
            assert_eq!(commands.goal(&tilted, now).is_ok(), good, "{x} {length}");
        }
    }

    // Requirement: SERVE-ros2-2
    #[test]
    fn second_publisher_drives_once_first_is_silent() {
        let (mut commands, begun) = (Commands::default(), Instant::now());
        let at = |ms| begun + Duration::from_millis(ms);
        let drive = Request::Drive {
            forward_mm_s: 200.0,
            yaw_rate_deg_s: -90.0,
            lease_ms: LEASE_MS,
        };
        let twist = twist(0.2, -PI / 2.0);
        assert_eq!(commands.velocity("a", &twist, at(0)), Ok(drive.clone()));
        assert!(commands.velocity("b", &twist, at(100)).is_err());
        assert_eq!(commands.velocity("a", &twist, at(200)), Ok(drive.clone()));
        assert!(commands.velocity("b", &twist, at(699)).is_err());
        assert_eq!(commands.velocity("b", &twist, at(700)), Ok(drive.clone()));
        assert_eq!(commands.stop(false), None);
        assert!(commands.velocity("a", &twist, at(800)).is_err());
        assert_eq!(commands.stop(true), Some(Request::Stop));
        for from in ["a", "b"] {
            let refused = commands.velocity(from, &twist, at(9000)).unwrap_err();
            assert!(refused.contains("/estop"), "{refused}");
        }
        assert!(commands.goal(&goal("map"), at(9000)).is_err());
        assert_eq!(commands.stop(false), None);
        assert_eq!(commands.velocity("a", &twist, at(9000)), Ok(drive));
    }

    #[test]
    fn goal_is_kept_until_it_ends_or_a_velocity_follows() {
        let (mut commands, begun) = (Commands::default(), Instant::now());
        let at = |ms| begun + Duration::from_millis(ms);
        for (frame, rotation) in [("map", None), ("odom", Some(90.0))] {
            let Ok(Request::Goto {
                x_mm,
                y_mm,
                rotation_deg,
                ..
            }) = commands.goal(&goal(frame), at(0))
            else {
                panic!("{frame}");
            };
            assert_eq!((x_mm, y_mm), (1500.0, -500.0));
            assert_eq!(rotation_deg.map(f64::round), rotation);
        }
        assert_eq!(commands.keep(at(149)), None);
        commands.stop(false);
        assert_eq!(commands.keep(at(150)), Some(Request::Keep));
        assert_eq!(commands.keep(at(299)), None);
        assert_eq!(commands.keep(at(300)), Some(Request::Keep));
        commands.end_goal();
        assert_eq!(commands.keep(at(900)), None);
        commands.goal(&goal("map"), at(0)).unwrap();
        commands.velocity(1, &twist(0.1, 0.0), at(10)).unwrap();
        assert_eq!(commands.keep(at(900)), None);
        // A goal takes the place of who drives; a stop that of both.
        commands.goal(&goal("map"), at(20)).unwrap();
        commands.velocity(2, &twist(0.1, 0.0), at(30)).unwrap();
        commands.goal(&goal("map"), at(40)).unwrap();
        commands.stop(true);
        assert_eq!(commands.keep(at(900)), None);
    }
}

//! What a frame of the server says, as messages.

use crate::mapping::{mapper_pose, odom_in_map};
use crate::ros_messages::{
    DiagnosticArray, Header, Odometry, RANGE_FRAMES, TfMessage, TransformStamped, Twist,
};
use crate::serve::protocol::Frame;
use host_link::pose::Pose;

/// Longest time between two poses that is a velocity, microseconds.
const MAX_STEP_US: u64 = 1_000_000;

/// The pose since the STM's reset, and the velocity since the pose before, on the board's clock.
// Requirement: SERVE-ros2-1
pub fn odometry(us: u64, (now_us, pose): (u64, Pose), last: Option<(u64, Pose)>) -> Odometry {
    let mut message = Odometry {
        header: Header::of(us, "odom"),
        child_frame_id: "base_link".into(),
        ..Odometry::default()
    };
    message.pose.pose = pose.into();
    if let Some((last_us, last)) = last.filter(|&(at, _)| at + MAX_STEP_US > now_us && at < now_us)
    {
        #[allow(clippy::cast_precision_loss)] // up to a second
        let seconds = (now_us - last_us) as f64 / 1e6;
        let (here, there) = (mapper_pose(pose), mapper_pose(last));
        let step = here.relative_to(&there);
        let Twist { linear, angular } = &mut message.twist.twist;
        linear.x = step.x_mm / 1000.0 / seconds;
        angular.z = there.turn_to_rad(&here) / seconds;
    }
    message
}

/// `map` → `odom` where the server localises, `odom` → `base_link`, and where the rangefinders look.
pub fn transforms(us: u64, frame: &Frame) -> TfMessage {
    let mut transforms = Vec::new();
    if let Some(pose) = frame.robot.pose {
        let transform = TransformStamped::of(us, "odom", "base_link", pose);
        if let Some(estimate) = frame.estimate {
            let odom = odom_in_map(&mapper_pose(estimate.pose), &mapper_pose(pose));
            transforms.push(TransformStamped::of(us, "map", "odom", odom));
        }
        transforms.push(transform);
    }
    let swept = [frame.robot.bearing_deg, None, None];
    for ((child, fitted), swept) in RANGE_FRAMES.iter().zip(frame.rangefinders).zip(swept) {
        if let Some(mut sensor) = fitted {
            sensor.rotation_deg = swept.unwrap_or(sensor.rotation_deg);
            transforms.push(TransformStamped::of(us, "base_link", child, sensor));
        }
    }
    TfMessage { transforms }
}

/// Faults and link; a robot that cannot be reached is an error, advice a warning.
// Requirement: SERVE-ros2-1
pub fn diagnostics(us: u64, frame: &Frame) -> DiagnosticArray {
    let mut message = DiagnosticArray::of(us, &frame.robot);
    for status in &mut message.status {
        if let Some(error) = &frame.error {
            (status.level.0, status.message) = (2, error.clone());
        } else if status.level.0 == 0 && !frame.advice.is_empty() {
            (status.level.0, status.message) = (1, frame.advice.join("; "));
        }
    }
    message
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::serve::protocol::{Activity, Estimate};
    use fw_core::eeprom::{Config, Image};
    use host_link::snapshot::Snapshot;

    // Requirement: SERVE-ros2-1
    #[test]
    fn frame_is_transformed_and_diagnosed() {
        let mut robot = Snapshot::new(&Config::decode(&Image::FIRST_BOARD).unwrap());
        (robot.pose, robot.bearing_deg) = (Some(Pose::new(100.0, 0.0, 0.0)), Some(30.0));
        let (pose, deviation_mm) = (Pose::new(1000.0, 500.0, 90.0), 1.0);
        let mut frame = Frame {
            robot,
            estimate: Some(Estimate { pose, deviation_mm }),
            activity: Activity::Idle,
            driver: None,
            targets: 0,
            advice: vec!["charge".into()],
            error: None,
            clients: 1,
            rangefinders: [Some(Pose::new(80.0, 0.0, 0.0)), None, None],
            stop_deadline_ms: 250,
        };
        let mm_and_degrees = |one: &TransformStamped| {
            let at = one.transform.translation;
            [at.x * 1e3, at.y * 1e3, one.transform.rotation.degrees()].map(f64::round)
        };
        let [odom, base, front] = &transforms(7, &frame).transforms[..] else {
            panic!("too few");
        };
        let found = [odom, base, front].map(mm_and_degrees);
        let expected = [[1000.0, 400.0, 90.0], [100.0, 0.0, 0.0], [80.0, 0.0, 30.0]];
        assert_eq!(found, expected);
        for (error, level, text) in [(None, 1, "charge"), (Some("silent"), 2, "silent")] {
            frame.error = error.map(Into::into);
            let status = &diagnostics(7, &frame).status[0];
            assert_eq!((status.level.0, &*status.message), (level, text));
        }
    }

    // Requirement: SERVE-ros2-1
    #[test]
    fn velocity_is_that_between_two_poses() {
        let close = |a: f64, b: f64| (a - b).abs() < 1e-3;
        let (last, now) = (Pose::new(100.0, 200.0, 359.0), Pose::new(100.0, 200.0, 1.0));
        let turned = odometry(7, (1_100_000, now), Some((1_000_000, last)));
        assert!(close(turned.twist.twist.angular.z, 20_f64.to_radians()));
        let (last, now) = (Pose::new(100.0, 200.0, 90.0), Pose::new(100.0, 195.0, 90.0));
        let backwards = odometry(7, (1_025_000, now), Some((1_000_000, last)));
        assert!(close(backwards.twist.twist.linear.x, -0.2));
        assert!(close(backwards.pose.pose.position.y, 0.195));
        // The same report again, a board that was reset, and a report of long ago.
        for last_us in [1_025_000, 9_000_000, 20_000] {
            let still = odometry(7, (1_025_000, now), Some((last_us, last)));
            assert!(still.twist.twist.linear.x.abs() < 1e-9, "{last_us}");
        }
    }
}

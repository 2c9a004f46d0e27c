use super::*;
use crate::{FRONT, RIGHT};

fn robot(room: &str, imperfections: Imperfections, seed: u64) -> KinematicRobot {
    let room = Room::parse(room).unwrap();
    let start = room.start;
    KinematicRobot::new(room, start, imperfections, seed)
}

fn drive(robot: &mut KinematicRobot, seconds: f64, forward_mm_s: f64, yaw_deg_s: f64) {
    let command = VelocityInput {
        forward_mm_s,
        yaw_rate_rad_s: yaw_deg_s.to_radians(),
        sweep_half_width_rad: 0.0,
    };
    robot.step(seconds, command);
}

#[test]
fn ideal_robot_drives_and_reports_commanded_velocity() {
    let mut robot = robot("", Imperfections::none(), 1);
    drive(&mut robot, 10.0, 120.0, 9.0);
    let (truth, sample) = (robot.true_pose(), robot.sample());
    assert!((sample.time_s - 10.0).abs() < 1e-9);
    // The ramp costs about the lag and half of the time that the acceleration takes.
    let turned = truth.heading_rad.to_degrees();
    assert!((turned - 87.5).abs() < 1.0, "{truth:?}");
    let path_mm = robot.path_mm();
    assert!((path_mm - 1180.0).abs() < 20.0, "{path_mm}");
    assert!(sample.odometry.distance_mm(&truth) < 0.2);
    assert_eq!((sample.gyro_rad, sample.ranges_mm), (None, [None; 3]));
    drive(&mut robot, 3.0, 0.0, 0.0);
    assert!(robot.sample().gyro_rad.unwrap().abs() < 1e-9, "from zero");
    let truth = robot.true_pose();
    drive(&mut robot, 10.0, 0.0, 45.0);
    drive(&mut robot, 1.0, 0.0, 0.0);
    let turned = robot.true_pose().heading_rad - truth.heading_rad;
    assert!((robot.sample().gyro_rad.unwrap() - turned).abs() < 0.02);
}

#[test]
fn wheel_saturation_keeps_yaw_rate() {
    let mut robot = robot("", Imperfections::none(), 1);
    drive(&mut robot, 5.0, 500.0, 60.0);
    let before = robot.true_pose();
    drive(&mut robot, 1.0, 500.0, 60.0);
    let turned = robot.true_pose().heading_rad - before.heading_rad;
    assert!((turned.to_degrees() - 60.0).abs() < 0.5, "{turned}");
}

#[test]
fn obstacle_stop_leaves_its_distance_and_reverse_its_way() {
    let wall = "wall 1000 -900 1000 900";
    let mut robot = robot(wall, Imperfections::none(), 1);
    drive(&mut robot, 2.0, 180.0, 0.0);
    assert!(!robot.sample().obstacle_limited);
    drive(&mut robot, 10.0, 180.0, 0.0);
    assert!(robot.sample().obstacle_limited && robot.collisions().is_empty());
    // The face is 80 mm ahead of the axle, the front edge 20 mm more.
    let left = 1000.0 - 100.0 - robot.true_pose().x_mm;
    assert!((125.0..160.0).contains(&left), "{left}");
    let stopped = robot.true_pose();
    drive(&mut robot, 3.0, -400.0, 0.0);
    let backed = stopped.distance_mm(&robot.true_pose());
    assert!((130.0..150.0).contains(&backed), "50 mm/s: {backed}");
    drive(&mut robot, 20.0, -400.0, 0.0);
    let backed = stopped.distance_mm(&robot.true_pose());
    assert!((295.0..310.0).contains(&backed), "{backed}");
}

#[test]
fn unseen_wall_is_hit_once_with_its_speed() {
    let wall = "wall 600 -900 600 900\nstart 0 0 50";
    let mut robot = robot(wall, Imperfections::default(), 1);
    drive(&mut robot, 20.0, 150.0, 0.0);
    assert_eq!(robot.collisions().len(), 1, "an oblique wall is silent");
    let speed = robot.collisions()[0].speed_mm_s;
    assert!((140.0..160.0).contains(&speed), "{speed}");
    let mut slow = self::robot(wall, Imperfections::default(), 1);
    drive(&mut slow, 60.0, 18.0, 0.0);
    assert_eq!(slow.collisions(), [], "a touch");
    assert!(slow.path_mm() < 800.0);
}

#[test]
fn sensors_take_turns_and_sweep_moves_front_bearing() {
    let room = "wall -800 -800 800 -800 800 800 -800 800 -800 -800";
    let mut robot = robot(room, Imperfections::none(), 1);
    let (mut bearings, mut fresh) = (Vec::new(), [0; 3]);
    let mut last = robot.sample();
    let sweeping = VelocityInput {
        sweep_half_width_rad: 0.6,
        ..VelocityInput::default()
    };
    for _ in 0..600 {
        robot.step(0.01, sweeping);
        let sample = robot.sample();
        for sensor in [FRONT, RIGHT] {
            fresh[sensor] += u32::from(sample.ranges_mm[sensor] != last.ranges_mm[sensor]);
        }
        if sample.ranges_mm[FRONT] != last.ranges_mm[FRONT] {
            bearings.push((sample.front_bearing_rad.to_degrees() / 10.0).round());
        }
        last = sample;
    }
    // Every 60 ms each, and ±30°.
    assert!(fresh[FRONT] == 100 || fresh[FRONT] == 99, "{fresh:?}");
    assert!((95..=100).contains(&fresh[RIGHT]), "{fresh:?}");
    assert!(bearings.windows(2).all(|b| (b[1] - b[0]).abs() < 1.1));
    assert!(bearings.contains(&3.0) && bearings.contains(&-3.0) && !bearings.contains(&4.0));
    drive(&mut robot, 1.0, 0.0, 0.0);
    assert!(robot.sample().front_bearing_rad.abs() < 1e-9);
}

//! Tests of the follower on a robot that responds as the core does.

use super::super::RestDetector;
use super::*;
use fw_core::eeprom::{Image, fields};

fn config(image: &Image) -> Config {
    Config::decode(image).unwrap()
}

/// A robot that follows the velocity as the core does, up to `held` mm/s ahead and, if it may, back, and
/// reports a frame late; where it rests, and the farthest that it came ahead. A frame takes `frame_ms`.
fn drive(target: Pose, config: &Config, held: f64, back: bool, frame_ms: u32) -> (Pose, f64) {
    drive_braked(1.0, target, config, held, back, frame_ms)
}

/// [`drive`] with a robot that brakes a turn this many times later: at that much less speed.
fn drive_braked(
    later: f64,
    target: Pose,
    config: &Config,
    held: f64,
    back: bool,
    frame_ms: u32,
) -> (Pose, f64) {
    let mut follower = PoseFollower::new(target, &ArrivalCriteria::default(), config);
    let limits = follower.limits;
    let mut true_limits = limits;
    true_limits.wheel_per_deg *= later;
    let (mut pose, mut reported) = (Pose::default(), Pose::default());
    let (mut response, mut limited, mut farthest) = (Response::default(), false, 0.0_f64);
    let (mut rest, mut allowed) = (RestDetector::default(), [0.0; 2]);
    for ms in 0..60_000 {
        if ms % frame_ms == 0 {
            let still = rest.settled(u64::from(ms) * 1000, reported);
            let (forward, yaw) = follower.step(f64::from(ms) / 1e3, reported, limited, still);
            let fastest = -limits.reverse_mm_s..=limits.speed[0];
            assert!(fastest.contains(&forward) && yaw.abs() <= limits.speed[1]);
            allowed = [forward.clamp(if back { -1e3 } else { 0.0 }, held), yaw];
            limited = (allowed[0] - forward).abs() > 1e-9;
            reported = pose;
        }
        if ms % 5 == 4 {
            let [way, turn] = response.step(allowed, &true_limits);
            pose = Pose::new(way, 0.0, turn).in_frame_of(pose);
            farthest = farthest.max(pose.x_mm);
        }
    }
    assert!(response.stands());
    (pose, farthest)
}

#[track_caller]
fn assert_at(end: Pose, target: Pose) {
    let (mm, deg) = (end.distance_mm(target), end.rotation_to_deg(target));
    assert!(mm <= 3.0 && deg.abs() <= 0.5, "{target:?}: {mm} mm, {deg}°");
}

#[test]
fn follower_rests_on_poses_all_around() {
    let slow = Image::FIRST_BOARD
        .with(fields::MAX_SPEED, 60)
        .with(fields::ACCELERATION, 100)
        .with(fields::REVERSE_SPEED, 0);
    for config in [config(&Image::FIRST_BOARD), config(&slow)] {
        for (x, y, rotation) in [
            (1000.0, 0.0, 0.0),
            (0.0, 0.0, 180.0),
            (300.0, 300.0, 270.0),
            (-400.0, 100.0, 90.0),
            (0.0, 500.0, 0.0),
            (-60.0, 2.0, 0.0),
            (3.0, 8.0, -2.0),
            (4.0, 0.0, 0.0),
            (0.0, 0.0, 1.0),
            (500.0, -20.0, 720.0),
        ] {
            let target = Pose::new(x, y, rotation);
            assert_at(drive(target, &config, 1e3, true, 25).0, target);
        }
    }
}

#[test]
fn follower_comes_to_rest_with_a_brake_later_than_predicted() {
    let config = config(&Image::FIRST_BOARD);
    for later in [1.6, 2.6, 3.0] {
        for (x, y, rotation) in [
            (500.0, 0.0, 90.0),
            (0.0, 6.0, 0.0),
            (-40.0, 0.0, 0.0),
            (0.0, 0.0, 1.5),
        ] {
            let target = Pose::new(x, y, rotation);
            assert_at(
                drive_braked(later, target, &config, 1e3, true, 25).0,
                target,
            );
        }
    }
}

#[test]
fn held_back_follower_turns_round_without_overshoot() {
    let config = config(&Image::FIRST_BOARD);
    let ahead = Pose::new(600.0, 0.0, 0.0);
    for held in [100.0, 30.0] {
        let (end, farthest) = drive(ahead, &config, held, true, 25);
        assert_at(end, ahead);
        assert!(farthest < 603.0, "{farthest} mm, held at {held} mm/s");
    }
    let behind = Pose::new(-60.0, 2.0, 0.0);
    assert_at(drive(behind, &config, 1e3, false, 25).0, behind);
    // The criteria's tolerance, where it is the tighter one.
    let (tolerance_deg, rest) = (0.2, ArrivalCriteria::default());
    let criteria = ArrivalCriteria {
        tolerance_deg,
        ..rest
    };
    let follower = PoseFollower::new(ahead, &criteria, &config);
    assert!(!follower.reaches(Pose::new(600.0, 0.0, 0.3)));
}

#[test]
fn prediction_of_frames_between_steps_loses_no_time() {
    let limits = Limits::new(&config(&Image::FIRST_BOARD));
    let way = |frames: u32| {
        let mut response = Response::default();
        let frame = |_| response.run([200.0, 0.0], 2.0 / f64::from(frames), &limits)[0];
        (0..frames).map(frame).sum::<f64>()
    };
    assert!((way(120) - way(1)).abs() < 1.0, "{} {}", way(120), way(1));
}

#[test]
fn target_is_reached_at_any_rate_of_frames() {
    let config = config(&Image::FIRST_BOARD);
    let target = Pose::new(500.0, 0.0, 90.0);
    for frame_ms in [2, 10, 125] {
        assert_at(drive(target, &config, 1e3, true, frame_ms).0, target);
    }
}

//! Drives to a pose by velocity: what the STM's pose controller does in the modes that carry a
//! target is done here in the mode that carries a velocity.

use crate::pose::Pose;

/// Fastest way ahead, mm/s.
const SPEED_MM_S: f64 = 150.0;
/// Fastest way back, mm/s, below the core's own limit, and how far, mm.
const REVERSE: (f64, f64) = (40.0, 100.0);
/// Slowest speed that the wheels keep, mm/s.
const CREEP_MM_S: f64 = 20.0;
/// Deceleration that the speed leaves room for, mm/s², half of the core's.
const DECELERATION_MM_S2: f64 = 200.0;
/// Yaw rate per degree of error, 1/s, and its least and largest amount, degrees/s.
const YAW_GAIN: f64 = 2.5;
const YAW_DEG_S: (f64, f64) = (12.0, 60.0);
/// A target farther aside than this is turned to first, degrees.
const ASIDE_DEG: f64 = 25.0;

/// Follows one target.
#[derive(Clone, Debug)]
pub struct PoseFollower {
    target: Pose,
    tolerance_mm: f64,
    tolerance_deg: f64,
    on_target: bool,
}

impl PoseFollower {
    /// Follows `target` to well within the tolerances.
    pub const fn new(target: Pose, tolerance_mm: f64, tolerance_deg: f64) -> Self {
        Self {
            target,
            tolerance_mm,
            tolerance_deg,
            on_target: false,
        }
    }

    /// The forward speed, mm/s, and yaw rate, degrees/s, at a reported pose.
    pub fn step(&mut self, pose: Pose) -> (f64, f64) {
        let away_mm = pose.distance_mm(self.target);
        // Once there, a small overshoot while turning is not driven after.
        let share = if self.on_target { 0.8 } else { 0.4 };
        self.on_target = away_mm <= share * self.tolerance_mm;
        if self.on_target {
            let error = pose.rotation_to_deg(self.target);
            let still = error.abs() <= 0.4 * self.tolerance_deg;
            return (0.0, if still { 0.0 } else { yaw(error, YAW_DEG_S.0) });
        }
        let (dx, dy) = (self.target.x_mm - pose.x_mm, self.target.y_mm - pose.y_mm);
        let towards = Pose::new(0.0, 0.0, dy.atan2(dx).to_degrees());
        let mut aside = pose.rotation_to_deg(towards);
        let back = aside.abs() > 90.0 && away_mm < REVERSE.1;
        if back {
            aside -= 180.0_f64.copysign(aside);
        }
        if aside.abs() > ASIDE_DEG {
            return (0.0, yaw(aside, YAW_DEG_S.0));
        }
        let fastest = if back { REVERSE.0 } else { SPEED_MM_S };
        let speed = (2.0 * DECELERATION_MM_S2 * away_mm).sqrt() * 0.5;
        let speed = speed.clamp(CREEP_MM_S, fastest) * aside.to_radians().cos();
        (if back { -speed } else { speed }, yaw(aside, 0.0))
    }
}

fn yaw(error_deg: f64, least: f64) -> f64 {
    let rate = (YAW_GAIN * error_deg.abs()).clamp(least, YAW_DEG_S.1);
    rate.copysign(error_deg)
}

#[cfg(test)]
mod tests {
    use super::*;

    /// A robot that follows the velocity with a lag of 150 ms and reports a frame late.
    fn drive(target: Pose, seconds: u32) -> Pose {
        let mut follower = PoseFollower::new(target, 5.0, 1.0);
        let (mut pose, mut reported) = (Pose::default(), Pose::default());
        let (mut speed, mut rate) = (0.0, 0.0);
        for _ in 0..seconds * 40 {
            let (forward, yaw) = follower.step(reported);
            assert!((-REVERSE.0..=SPEED_MM_S).contains(&forward) && yaw.abs() <= YAW_DEG_S.1);
            reported = pose;
            speed += (forward - speed) * 0.025 / 0.15;
            rate += (yaw - rate) * 0.025 / 0.15;
            let step = Pose::new(speed * 0.025, 0.0, rate * 0.025);
            pose = step.in_frame_of(pose);
        }
        let at_rest = speed.abs() < 0.5 && rate.abs() < 0.5;
        assert!(at_rest, "moves: {speed} {rate}");
        pose
    }

    #[test]
    fn follower_rests_on_poses_all_around() {
        for (x, y, rotation) in [
            (1000.0, 0.0, 0.0),
            (0.0, 0.0, 180.0),
            (300.0, 300.0, 270.0),
            (-400.0, 100.0, 90.0),
            (-60.0, 2.0, 0.0),
            (3.0, 8.0, -2.0),
            (500.0, -20.0, 720.0),
        ] {
            let target = Pose::new(x, y, rotation);
            let end = drive(target, 30);
            let (mm, deg) = (end.distance_mm(target), end.rotation_to_deg(target));
            assert!(mm <= 5.0 && deg.abs() <= 1.0, "{target:?}: {mm} mm, {deg}°");
        }
    }
}

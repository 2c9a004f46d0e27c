//! Drives to a pose by velocity: what the STM's pose controller does in the modes that carry a
//! target is done here in the mode that carries a velocity.

use host_link::pose::Pose;

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
/// The core's accelerations, mm/s² and degrees/s², the two lags of its response to a velocity, s, and the
/// speeds below which it brakes a wheel that is to stand, mm/s and degrees/s.
const ACCELERATION: [f64; 2] = [400.0, 180.0];
const RESPONSE_LAG_S: f64 = 0.08;
const BRAKED: [f64; 2] = [10.0, 9.0];
/// Age of a report when its answer takes effect, s: a frame and a tick.
const AGE_S: f64 = 0.03;
/// Step of the prediction, s.
const STEP_S: f64 = 0.005;
/// A target farther aside than this is turned to first, degrees.
const ASIDE_DEG: f64 = 25.0;

/// How the core follows a velocity: with its acceleration and two lags; zero is braked at the end.
#[derive(Clone, Copy, Debug, Default)]
struct Response {
    /// Forward, mm/s, and yaw, degrees/s: the commanded speed within the acceleration, and behind one and
    /// two lags.
    speeds: [[f64; 3]; 2],
}

impl Response {
    /// Lets a step pass; the way, mm, and the turn, degrees.
    fn step(&mut self, command: [f64; 2]) -> [f64; 2] {
        for (axis, [ramp, first, second]) in self.speeds.iter_mut().enumerate() {
            let most = ACCELERATION[axis] * STEP_S;
            *ramp += (command[axis] - *ramp).clamp(-most, most);
            *first += (*ramp - *first) * STEP_S / RESPONSE_LAG_S;
            *second += (*first - *second) * STEP_S / RESPONSE_LAG_S;
        }
        let braked = |(axis, [ramp, _, second]): (usize, &[f64; 3])| {
            command[axis].abs() + ramp.abs() < 1e-6 && second.abs() < BRAKED[axis]
        };
        if self.speeds.iter().enumerate().all(braked) {
            *self = Self::default();
        }
        self.speeds.map(|[.., second]| second * STEP_S)
    }

    /// The way and the turn that are left when the command is to stand, from a report of [`AGE_S`] ago.
    fn rest(mut self) -> [f64; 2] {
        let mut left = self.speeds.map(|[.., second]| second * AGE_S);
        while self.speeds.iter().flatten().any(|speed| speed.abs() > 1e-3) {
            let moved = self.step([0.0; 2]);
            left = [left[0] + moved[0], left[1] + moved[1]];
        }
        left
    }
}

/// Follows one target.
#[derive(Clone, Debug)]
pub struct PoseFollower {
    target: Pose,
    tolerance_mm: f64,
    tolerance_deg: f64,
    on_target: bool,
    response: Response,
    /// The last command, and its time, s.
    last: ([f64; 2], f64),
}

impl PoseFollower {
    /// Follows `target` to well within the tolerances.
    pub fn new(target: Pose, tolerance_mm: f64, tolerance_deg: f64) -> Self {
        Self {
            target,
            tolerance_mm,
            tolerance_deg,
            on_target: false,
            response: Response::default(),
            last: ([0.0; 2], 0.0),
        }
    }

    /// The forward speed, mm/s, and yaw rate, degrees/s, at a reported pose: by where the robot would come
    /// to rest from there.
    pub fn step(&mut self, time_s: f64, pose: Pose) -> (f64, f64) {
        let (command, mut at_s) = self.last;
        at_s = at_s.max(time_s - 0.5);
        while at_s + STEP_S <= time_s {
            self.response.step(command);
            at_s += STEP_S;
        }
        let [way_mm, turn_deg] = self.response.rest();
        let command = self.towards(Pose::new(way_mm, 0.0, turn_deg).in_frame_of(pose));
        self.last = (command.into(), at_s);
        command
    }

    /// The velocity for a robot that stands at `pose`.
    fn towards(&mut self, pose: Pose) -> (f64, f64) {
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

    /// A robot that follows the velocity as the core does and reports a frame late.
    fn drive(target: Pose, seconds: u32) -> Pose {
        let mut follower = PoseFollower::new(target, 3.0, 0.5);
        let (mut pose, mut reported) = (Pose::default(), Pose::default());
        let mut response = Response::default();
        for frame in 0..seconds * 40 {
            let (forward, yaw) = follower.step(f64::from(frame) * 0.025, reported);
            assert!((-REVERSE.0..=SPEED_MM_S).contains(&forward) && yaw.abs() <= YAW_DEG_S.1);
            reported = pose;
            for _ in 0..5 {
                let [way, turn] = response.step([forward, yaw]);
                pose = Pose::new(way, 0.0, turn).in_frame_of(pose);
            }
        }
        assert!(
            response
                .speeds
                .iter()
                .flatten()
                .all(|speed| speed.abs() < 1e-6)
        );
        pose
    }

    #[test]
    fn follower_speeds_at_poses_before_a_target() {
        let turned = |deg: f64| 150.0 * deg.to_radians().cos();
        for (x_mm, rotation, speed, yaw) in [
            (0.0, 0.0, 150.0, 0.0),
            (0.0, 10.0, turned(10.0), -25.0),
            (0.0, -24.9, turned(24.9), 60.0),
            (0.0, 25.1, 0.0, -60.0),
            (950.0, 0.0, 20_000_f64.sqrt() / 2.0, 0.0),
            (997.9, 0.0, 20.0, 0.0),
            (1001.9, 8.0, 0.0, -20.0),
            (1001.9, 2.0, 0.0, -12.0),
            (1001.9, 0.41, 0.0, -12.0),
            (1001.9, 0.39, 0.0, 0.0),
            (1099.0, 0.0, -40.0, 0.0),
            (1101.0, -1.0, 0.0, -60.0),
        ] {
            let mut follower = PoseFollower::new(Pose::new(1000.0, 0.0, 0.0), 5.0, 1.0);
            let found = follower.towards(Pose::new(x_mm, 0.0, rotation));
            let off = (found.0 - speed).abs() + (found.1 - yaw).abs();
            assert!(off < 1e-6, "{x_mm} mm, {rotation} degrees: {found:?}");
            let stays = follower.towards(Pose::new(1003.9, 0.0, 0.0));
            assert_eq!(stays == (0.0, 0.0), x_mm > 1000.0 && x_mm < 1002.0);
        }
        let image = fw_core::eeprom::Image::FIRST_BOARD;
        let config = fw_core::eeprom::Config::decode(&image).unwrap();
        let limits = config.velocity_limits();
        let yaw = f64::from(limits.yaw_acceleration) / 4_294_967_296.0 * 360.0;
        assert!((yaw - ACCELERATION[1]).abs() < 1e-6, "{yaw}");
        assert!((f64::from(limits.acceleration_mm_s2) - ACCELERATION[0]).abs() < 1e-6);
    }

    #[test]
    fn prediction_brakes_slow_wheels_and_ends_half_a_second_back() {
        for (forward, yaw, braked) in [(9.0, 8.0, true), (11.0, 8.0, false), (9.0, 9.5, false)] {
            let mut response = Response {
                speeds: [forward, yaw].map(|speed| [0.0, speed, speed]),
            };
            response.step([0.0; 2]);
            let still = |speeds: &[f64; 3]| speeds.iter().all(|&speed| speed == 0.0);
            assert_eq!(response.speeds.iter().all(still), braked);
        }
        let mut follower = PoseFollower::new(Pose::new(1000.0, 0.0, 0.0), 5.0, 1.0);
        follower.step(0.0, Pose::default());
        let late = follower.step(100.0, Pose::new(900.0, 0.0, 0.0)).0;
        // From 900 mm it were 100 mm/s; the robot comes to rest some 50 mm later.
        assert!((50.0..80.0).contains(&late), "{late}");
        let speed = follower.response.speeds[0][2];
        assert!((100.0..140.0).contains(&speed), "{speed}");
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
            assert!(mm <= 3.0 && deg.abs() <= 0.5, "{target:?}: {mm} mm, {deg}°");
        }
    }
}

//! Tests of the filter.

use super::*;
use plant::Rng;

const FRAME_S: f64 = 0.025;

/// What one frame reports.
fn increment(forward_mm: f64, turn_rad: f64, gyro_rad: Option<f64>) -> Increment {
    let time_s = FRAME_S;
    Increment {
        time_s,
        forward_mm,
        turn_rad,
        gyro_rad,
    }
}

/// A robot with errors of calibration, and its filter.
struct Robot {
    truth: Pose2,
    ekf: Ekf,
    rng: Rng,
    wheels: [f64; 2],
    gyro: (f64, f64),
}

impl Robot {
    /// With errors as large as the filter's deviations say.
    fn new(seed: u64) -> Self {
        let mut rng = Rng::new(seed);
        let mut noise = MotionNoise::default();
        // Small enough for the linear model.
        noise.calibration[1] = 0.001;
        noise.slip = 0.002;
        let [travel, difference, _, scale, bias] = noise.calibration.map(|d| d * rng.normal());
        Self {
            truth: Pose2::default(),
            ekf: Ekf::new(noise, &Pose2::default(), &Matrix3::zeros()),
            wheels: [
                1.0 + travel - difference / 2.0,
                1.0 + travel + difference / 2.0,
            ],
            gyro: (1.0 / (1.0 + scale), bias),
            rng,
        }
    }

    /// One frame in which the wheels report these millimetres.
    fn frame(&mut self, left: f64, right: f64, with_gyro: bool) {
        let track_mm = self.ekf.noise.track_mm;
        let mut roll = |mm: f64, scale: f64| {
            mm * scale + self.ekf.noise.wheel * mm.abs().sqrt() * self.rng.normal()
        };
        let (a, b) = (roll(left, self.wheels[0]), roll(right, self.wheels[1]));
        let next = self.truth.advance_arc(a, b, track_mm);
        let turn = next.heading_rad - self.truth.heading_rad;
        self.truth = next;
        let walk = self.ekf.noise.gyro_walk * FRAME_S.sqrt() * self.rng.normal();
        self.ekf.advance(&increment(
            f64::midpoint(left, right),
            (right - left) / track_mm,
            with_gyro.then_some(turn * self.gyro.0 + self.gyro.1 * FRAME_S + walk),
        ));
    }

    fn drive(&mut self, seconds: f64, left: f64, right: f64, with_gyro: bool) {
        let mut time_s = 0.0;
        while time_s < seconds {
            self.frame(left, right, with_gyro);
            time_s += FRAME_S;
        }
    }

    /// Squared error in units of the covariance: 3 in the mean.
    fn nees(&self) -> f64 {
        let (pose, truth) = (self.ekf.pose(), self.truth);
        let turn = truth.turn_to_rad(&pose);
        let off = Vector3::new(pose.x_mm - truth.x_mm, pose.y_mm - truth.y_mm, turn);
        let information = self.ekf.pose_covariance().try_inverse().unwrap();
        off.dot(&(information * off))
    }
}

#[test]
fn late_gyro_is_no_error_of_scale() {
    let noise = MotionNoise::default();
    // Of the part, and of this one.
    let late_s = 0.0095 + 0.003;
    let mut ekf = Ekf::new(noise, &Pose2::default(), &Matrix3::zeros());
    let (mut heading_rad, mut last) = (0.0, 0.0);
    for nth in 0..800_u32 {
        // A straight way as a controller drives it, then turns on the spot.
        let (forward_mm, rate) = if nth < 420 {
            (2.0, 0.1 * (0.35 * f64::from(nth)).sin())
        } else {
            (0.0, [1.2, 0.0, -1.2, 0.0][nth as usize / 60 % 4])
        };
        let turn_rad = rate * FRAME_S;
        ekf.advance(&increment(
            forward_mm,
            turn_rad,
            Some(turn_rad - late_s * (rate - last)),
        ));
        (heading_rad, last) = (heading_rad + turn_rad, rate);
        let error_rad = ekf.pose().heading_rad - heading_rad;
        let is_steady = nth % 60 > 3;
        assert!(!is_steady || error_rad.abs() < 0.005, "{nth}: {error_rad}");
    }
    let found = ekf.calibration();
    for (scale, _) in [found.track_scale, found.gyro_scale] {
        assert!((scale - 1.0).abs() < 0.001, "{found:?}");
    }
}

#[test]
fn rest_reveals_bias_of_gyro() {
    let mut robot = Robot::new(1);
    robot.gyro.1 = 0.03f64.to_radians();
    robot.drive(3.0, 0.0, 0.0, true);
    let (bias, deviation) = robot.ekf.calibration().gyro_bias_rad_s;
    assert!(
        (bias - robot.gyro.1).abs() < 0.005f64.to_radians(),
        "{bias}"
    );
    assert!(
        (0.0075..0.01).contains(&deviation.to_degrees()),
        "{deviation}"
    );
    assert!(robot.ekf.pose().heading_rad.abs() < 0.05f64.to_radians());
}

#[test]
fn straight_drive_with_gyro_reveals_wheel_ratio() {
    let mut robot = Robot::new(2);
    robot.wheels = [0.998, 1.002];
    robot.drive(30.0, 4.0, 4.0, true);
    let (ratio, deviation) = robot.ekf.calibration().wheel_ratio;
    assert!(
        (ratio - 1.004).abs() < 3.0 * deviation,
        "{ratio} {deviation}"
    );
    assert!(deviation < 0.0015, "{deviation}");
    (robot.ekf.state[TRAVEL], robot.ekf.state[TURN]) = (0.01, -0.02);
    for (of, variance) in [(TRAVEL, 9.0), (TURN, 16.0)] {
        robot.ekf.covariance[(of, of)] = variance;
    }
    let (track, deviation) = robot.ekf.calibration().track_scale;
    assert!((track - 1.01 / 0.98).abs() < 1e-9 && (deviation - 5.0).abs() < 1e-9);
}

#[test]
fn turns_reveal_scale_of_gyro_where_the_track_is_known() {
    let mut robot = Robot::new(12);
    robot.ekf.covariance[(TURN, TURN)] = 0.0;
    (robot.wheels, robot.gyro.0) = ([1.0; 2], 1.0 / 1.02);
    robot.drive(60.0, -2.5, 2.5, true);
    let (scale, deviation) = robot.ekf.calibration().gyro_scale;
    assert!((scale - 1.02).abs() < 3.0 * deviation, "{scale}");
    assert!(deviation < 0.002, "{deviation}");
}

#[test]
fn measurement_counts_within_its_gate() {
    for (deviations, counts) in [(3.9, true), (4.1, false)] {
        let mut ekf = Robot::new(4).ekf;
        let before = ekf.state;
        let mut row = SMatrix::<f64, 1, N>::zeros();
        row[BIAS] = 1.0;
        let variance = ekf.covariance[(BIAS, BIAS)];
        ekf.measure(&row, deviations * (2.0 * variance).sqrt(), variance, 4.0);
        assert_eq!(ekf.state != before, counts, "{deviations}");
    }
}

#[test]
fn slip_of_wheels_changes_no_calibration() {
    let mut robot = Robot::new(3);
    robot.drive(10.0, 4.0, 4.0, true);
    let before = robot.ekf.calibration();
    robot.ekf.advance(&increment(4.0, 0.0, Some(0.2)));
    robot.drive(0.5, 0.0, 0.0, true);
    let change = robot.ekf.calibration().wheel_ratio.0 - before.wheel_ratio.0;
    assert!(change.abs() < 1e-4, "{change}");
}

#[test]
fn predicted_covariance_agrees_with_errors() {
    for with_gyro in [true, false] {
        let mut sum = 0.0;
        for seed in 0..200 {
            let mut robot = Robot::new(seed);
            for _ in 0..4 {
                robot.drive(8.0, 4.0, 4.0, with_gyro);
                robot.drive(1.0, -2.5, 2.5, with_gyro);
                robot.drive(1.0, 0.0, 0.0, with_gyro);
            }
            sum += robot.nees();
        }
        assert!((1.5..4.0).contains(&(sum / 200.0)), "{with_gyro} {sum}");
    }
}

#[test]
fn replaced_pose_moves_calibration_by_its_correlation() {
    let mut robot = Robot::new(5);
    robot.drive(25.0, 4.0, 4.0, true);
    let pose = robot.ekf.pose();
    let reported_mm = 4.0 * 25.0 / FRAME_S;
    let mean = Vector3::new(1.002 * reported_mm, pose.y_mm, pose.heading_rad);
    let covariance = Matrix3::from_diagonal(&Vector3::new(1.0, 100.0, 1e-4));
    robot.ekf.replace_pose(&mean, &covariance);
    let (scale, deviation) = robot.ekf.calibration().travel_scale;
    assert!(
        (scale - 1.002).abs() < 0.001 && deviation < 0.002,
        "{scale} {deviation}"
    );
    let kept = robot.ekf.pose_covariance();
    assert!((kept - covariance).norm() < 1e-6, "{kept}");
}

#[test]
fn right_angles_hold_heading_and_slanted_wall_does_not() {
    let mut robot = Robot::new(6);
    robot.ekf.observe_wall(0.1);
    robot.ekf.observe_wall(0.1);
    // A turn of unknown size, a slanted wall, then the wall to the left.
    robot.drive(1.0, -2.5, 2.5, true);
    let noise = SMatrix::<f64, N, 1>::from_fn(|nth, _| if nth == 2 { 0.03 } else { 0.0 });
    robot.ekf.covariance += noise * noise.transpose();
    let (before, turned) = (robot.ekf.pose(), robot.truth.heading_rad);
    robot.ekf.observe_wall(0.1 + 0.3 - turned);
    assert_eq!(robot.ekf.pose(), before);
    for _ in 0..20 {
        robot.ekf.observe_wall(0.1 + FRAC_PI_2 - turned - 0.02);
    }
    let off = robot.ekf.pose().heading_rad - (turned + 0.02);
    assert!(off.abs() < 0.01, "{off}");
    let deviation = robot.ekf.pose_covariance()[(2, 2)].sqrt();
    assert!((0.008..0.03).contains(&deviation), "{deviation}");
}

#[test]
fn majority_of_walls_is_direction_of_room() {
    let mut robot = Robot::new(7);
    let mut see = |normal_rad, walls| (0..walls).for_each(|_| robot.ekf.observe_wall(normal_rad));
    see(0.5, 1);
    see(0.0, 30);
    // As many as are ever held against forgetting.
    see(0.5, 12);
    let direction = robot.ekf.walls_rad().unwrap();
    assert!(direction.abs() < 0.02, "{direction}");
    // Where the heading is known, what was seen twice is between.
    let mut ekf = Robot::new(7).ekf;
    ekf.observe_wall(0.1);
    ekf.observe_wall(0.12);
    assert!((ekf.state[WALLS] - 0.11).abs() < 1e-9);
}

#[test]
fn covariance_grows_by_slip_drift_and_correlates_with_bias() {
    let noise = MotionNoise {
        calibration: [0.0, 0.0, 0.0, 0.0, 0.01],
        ..MotionNoise::default()
    };
    let mut ekf = Ekf::new(noise, &Pose2::default(), &Matrix3::zeros());
    ekf.advance(&increment(100.0, 0.0, Some(0.0)));
    // Half the turn of the frame acts on all of its way.
    let bias = 0.01_f64.powi(2);
    let aside = bias * (100.0 / 2.0 * FRAME_S).powi(2);
    let along = noise.wheel.powi(2) * 200.0 / 4.0;
    let slip = noise.slip.powi(2) * 100.0;
    let walk = noise.bias_walk.powi(2) * FRAME_S;
    let scale_walk = noise.scale_walk.powi(2) * FRAME_S;
    for (row, column, expected) in [
        (0, 0, along + slip),
        (1, 1, aside + slip),
        (1, BIAS, -bias * 100.0 / 2.0 * FRAME_S),
        (2, BIAS, -bias * FRAME_S),
        (BIAS, BIAS, bias + walk),
        (TRAVEL, TRAVEL, scale_walk),
        (SCALE, SCALE, scale_walk),
    ] {
        let found = ekf.covariance[(row, column)];
        let off = (found - expected).abs();
        assert!(
            off < 1e-9 * expected.abs(),
            "{row} {column}: {found} {expected}"
        );
    }
}

#[test]
fn covariance_turns_with_the_heading_and_grows_by_turns() {
    let advanced = |start_rad, forward_mm, turn_rad, gyro_rad| {
        let known = Matrix3::from_diagonal(&Vector3::new(1.0, 1.0, 0.01));
        let start = Pose2::new(0.0, 0.0, start_rad);
        let mut ekf = Ekf::new(MotionNoise::default(), &start, &known);
        ekf.advance(&increment(forward_mm, turn_rad, gyro_rad));
        ekf.covariance
    };
    let frame = |start_rad| advanced(start_rad, 100.0, 0.1, Some(0.12));
    let mut turn = SMatrix::<f64, N, N>::identity();
    let rotation = nalgebra::Rotation2::new(0.7);
    turn.fixed_view_mut::<2, 2>(0, 0)
        .copy_from(rotation.matrix());
    let off = turn * frame(0.0) * turn.transpose() - frame(0.7);
    assert!(off.norm() < 1e-9, "{off}");
    let noise = MotionNoise::default();
    let turned =
        0.01 + 4.0 * noise.calibration[2].powi(2) + noise.wheel.powi(2) * 2.0 / noise.track_mm;
    let found = advanced(0.0, 0.0, 2.0, None)[(2, 2)];
    assert!((found - turned).abs() < 1e-9, "{found} {turned}");
}

#[test]
fn robot_put_elsewhere_knows_no_walls() {
    let mut robot = Robot::new(8);
    robot.ekf.covariance[(2, 2)] = 0.01;
    robot.ekf.observe_wall(0.1);
    for (at, expected) in [
        ((WALLS, WALLS), 0.01 + WALL_RAD * WALL_RAD),
        ((WALLS, 2), 0.01),
        ((2, WALLS), 0.01),
    ] {
        assert!((robot.ekf.covariance[at] - expected).abs() < 1e-12);
    }
    robot.drive(1.0, 4.0, 4.0, true);
    let mut ekf = robot.ekf;
    ekf.relocate(&Vector3::new(1.0, 2.0, 0.3), &Matrix3::identity());
    assert_eq!(ekf.walls_rad(), None);
    assert_eq!(ekf.pose(), Pose2::new(1.0, 2.0, 0.3));
    assert_eq!(ekf.pose_covariance(), Matrix3::identity());
    assert!(ekf.covariance.fixed_view::<3, { N - 3 }>(0, 3).norm() < 1e-12);
    assert!(ekf.covariance.fixed_view::<{ N - 3 }, 3>(3, 0).norm() < 1e-12);
}

#[test]
fn turns_on_both_sides_of_a_gap_of_the_gyro_are_not_compared() {
    let mut robot = Robot::new(6);
    robot.ekf.noise.scale_walk = 0.0;
    let ratio = |robot: &Robot| robot.ekf.calibration().wheel_ratio;
    let before = ratio(&robot);
    robot.drive(0.3, 5.0, 5.0, true);
    robot.frame(5.0, 5.0, false);
    robot.drive(0.3, 5.0, 5.0, true);
    assert_eq!(ratio(&robot), before);
    robot.drive(0.3, 5.0, 5.0, true);
    assert_ne!(ratio(&robot), before);
}

#[test]
fn directions_of_walls_are_forgotten_after_ten_that_disagree() {
    let mut ekf = Robot::new(9).ekf;
    let mut observe = |normal_rad, count| {
        (0..count).for_each(|_| ekf.observe_wall(normal_rad));
        ekf.directions().count()
    };
    let others = [0.3, 0.6, 0.9].map(|normal_rad| observe(normal_rad, 100));
    assert_eq!((others, observe(0.0, 100)), ([1, 2, 3], DIRECTIONS));
    assert_eq!((observe(1.2, 9), observe(1.2, 1)), (DIRECTIONS, 0));
}

#[test]
fn slanted_walls_hold_heading_once_known() {
    let mut robot = Robot::new(10);
    let see = |ekf: &mut Ekf, normal_rad| (0..20).for_each(|_| ekf.observe_wall(normal_rad));
    see(&mut robot.ekf, 0.1);
    see(&mut robot.ekf, 0.4);
    let heading = |ekf: &Ekf| ekf.pose().heading_rad;
    let known = heading(&robot.ekf);
    assert!(known.abs() < 1e-9, "{known}");
    // A wall six degrees aside of a known one is neither that nor another.
    let before = robot.ekf.clone();
    see(&mut robot.ekf, 0.505);
    assert_eq!(robot.ekf.state, before.state);
    // An unseen turn to the left: both walls stand more to the right.
    robot.ekf.covariance[(2, 2)] += 0.03 * 0.03;
    see(&mut robot.ekf, 0.4 - 0.02);
    let turned = heading(&robot.ekf);
    assert!((turned - 0.02).abs() < 0.003, "{turned}");
    let direction = robot.ekf.state[WALLS + 1];
    assert!((direction - 0.4).abs() < 0.003, "{direction}");
}

#[test]
fn wall_askew_pulls_heading_like_one_at_one_deviation() {
    let pull = |askew_rad: f64| {
        let mut ekf = Robot::new(11).ekf;
        (0..20).for_each(|_| ekf.observe_wall(0.1));
        ekf.covariance[(2, 2)] += 0.03 * 0.03;
        ekf.observe_wall(0.1 - askew_rad);
        ekf.pose().heading_rad
    };
    assert!((0.02..0.027).contains(&pull(0.035)) && pull(0.1) < 0.027);
}

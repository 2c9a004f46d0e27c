//! Tests of what the localiser keeps, and of where a stretch ends.

use super::*;
use crate::Point;

/// A report at a heading of the odometry, the front sensor turned aside.
fn report(nth: u32, heading_rad: f64, front: (Option<f64>, f64)) -> Observation {
    Observation {
        time_s: 0.025 * f64::from(nth),
        odometry: Pose2::new(0.0, 0.0, heading_rad),
        gyro_rad: None,
        ranges_mm: [front.0, None, None],
        front_bearing_rad: Some(front.1),
    }
}

fn observing(reports: impl Iterator<Item = Observation>) -> Localiser {
    let mut localiser = Localiser::new(LocaliserConfig::default());
    reports.for_each(|report| localiser.observe(&report));
    localiser
}

/// A range that is a new measurement in every frame.
fn fresh(nth: u32) -> f64 {
    600.0 + f64::from(nth % 7)
}

#[test]
fn turn_of_the_robot_ends_a_stretch() {
    // The body was there.
    let is_entered = |localiser: &Localiser| {
        let log_odds = localiser.grid().log_odds_at(Point::new(0.0, 0.0));
        log_odds < -0.5
    };
    let turning = |frames: u32| {
        let turn = |nth| report(nth, 0.02 * f64::from(nth), (Some(fresh(nth)), 0.0));
        is_entered(&observing((0..=frames).map(turn)))
    };
    // A radian of turn counts as 400 mm.
    assert_eq!([turning(45), turning(55)], [false, true]);
}

#[test]
fn stretch_leaves_its_last_readings_as_context() {
    let turn = |nth| report(nth, 0.04 * f64::from(nth), (Some(fresh(nth)), 0.0));
    let localiser = observing((0..=27).map(turn));
    let [front, ..] = &localiser.tracks;
    assert_eq!(front.old, CONTEXT);
    assert!((CONTEXT..CONTEXT + 5).contains(&front.readings.len()));
}

#[test]
fn range_within_limits_is_kept_where_it_was_measured() {
    for (range_mm, kept) in [(29.0, None), (31.0, Some(Some(31.0))), (2491.0, Some(None))] {
        let ahead = |nth| Observation {
            time_s: 0.1 * f64::from(nth),
            odometry: Pose2::new(10.0 * f64::from(nth), 0.0, 0.0),
            ..report(nth, 0.0, (Some(range_mm), 0.0))
        };
        let localiser = observing((0..2).map(ahead));
        let readings = &localiser.tracks[0].readings;
        assert_eq!(readings.first().map(|reading| reading.range_mm), kept);
        // 20 ms earlier, 2 mm farther back.
        assert!(
            readings
                .iter()
                .all(|at| (at.sensor.x_mm - 88.0).abs() < 1e-9)
        );
    }
}

#[test]
fn repeated_range_is_the_same_measurement() {
    // Each for four frames, 20 mm.
    let ahead = |nth| Observation {
        odometry: Pose2::new(5.0 * f64::from(nth), 0.0, 0.0),
        ..report(nth, 0.0, (Some(f64::from(500 + nth / 4 % 2)), 0.0))
    };
    let localiser = observing((0..=40).map(ahead));
    assert_eq!(localiser.tracks[0].readings.len(), 11);
}

#[test]
fn sensor_that_is_not_swept_looks_where_it_is_mounted() {
    let mut config = LocaliserConfig::default();
    config.mounts[0].as_mut().unwrap().bearing_rad = 0.5;
    for (bearing_rad, looks_rad) in [(None, 0.5), (Some(0.2), 0.2)] {
        let mut localiser = Localiser::new(config.clone());
        for nth in 0..2 {
            localiser.observe(&Observation {
                front_bearing_rad: bearing_rad,
                ..report(nth, 0.0, (Some(fresh(nth)), 0.0))
            });
        }
        let sensor = localiser.tracks[0].readings[0].sensor;
        assert!((sensor.heading_rad - looks_rad).abs() < 1e-9);
    }
}

#[test]
fn heading_of_odometry_wraps() {
    let turn = |nth| report(nth, [3.1, -3.1][nth as usize], (None, 0.0));
    let found = observing((0..2).map(turn)).estimate().pose.heading_rad;
    assert!(
        (found - (std::f64::consts::TAU - 6.2)).abs() < 1e-9,
        "{found}"
    );
}

#[test]
fn stretch_enters_its_own_readings_where_it_matched_what_was_there_before() {
    let at = |nth| Reading {
        sensor: Pose2::new(12.0 * f64::from(nth), 0.0, std::f64::consts::FRAC_PI_2),
        range_mm: (nth < 20).then_some(600.0),
    };
    let covariance = Matrix3::from_diagonal(&Vector3::new(900.0, 900.0, 9e-4));
    for (old, is_entered) in [(0, true), (24, false)] {
        let mut localiser = Localiser::new(LocaliserConfig::default());
        localiser.ekf.relocate(&Vector3::zeros(), &covariance);
        localiser.tracks[1].readings = (0..24).map(at).collect();
        localiser.tracks[1].old = old;
        localiser.end_stretch();
        let (grid, surfaces) = (localiser.grid(), &localiser.evidence.surfaces);
        let written = grid.cells().any(|(c, r)| grid.log_odds(c, r) != 0.0);
        assert_eq!(written, is_entered);
        // In no echo's cone.
        let silent = grid.log_odds_at(Point::new(302.0, 250.0));
        assert_eq!(silent < 0.0, is_entered);
        assert_eq!(localiser.ekf.pose_covariance(), covariance);
        assert_eq!(localiser.evidence.walls_rad.is_some(), is_entered);
        let mut near = surfaces.near(Point::new(100.0, 600.0), 100.0);
        let record = near.next().map(|surfel| surfaces.record(surfel));
        let known = record.map(|record| record.covariance_at(&Pose2::default()));
        assert_eq!(known, is_entered.then_some(covariance));
    }
}

#[test]
fn echo_from_behind_a_wall_enters_nothing() {
    let wall = |range_mm| Element {
        sensor: Pose2::default(),
        range_mm,
        kind: Kind::Wall,
        towards_rad: 0.0,
        spread_rad: 0.03,
    };
    let mut localiser = Localiser::new(LocaliserConfig::default());
    // Two walls that the sensor sees obliquely, entered from before them.
    let towards_rad = 0.9;
    let oblique = [490.0, 520.0].map(|x_mm| Element {
        sensor: Pose2::at(
            Pose2::new(x_mm, 0.0, towards_rad).point_at(-300.0, 0.0),
            towards_rad,
        ),
        towards_rad,
        ..wall(300.0)
    });
    for _ in 0..12 {
        localiser.enter(&oblique, &Pose2::default());
    }
    localiser.enter(&[wall(1000.0)], &Pose2::default());
    let near = |x_mm| {
        let surfaces = &localiser.evidence.surfaces;
        surfaces.near(Point::new(x_mm, 0.0), 30.0).count()
    };
    assert!(near(500.0) > 0 && near(1000.0) == 0);
    // Nor does it correct the pose, nor do echoes that contradict each other.
    for x_mm in [300.0, 1000.0] {
        let at = Point::new(x_mm, 0.0);
        localiser.evidence.surfaces.insert(at, 0.0, Kind::Wall);
    }
    let covariance = Matrix3::from_diagonal(&Vector3::new(900.0, 900.0, 9e-4));
    for (ranges_mm, is_corrected) in [
        ([1000.0; 3], false),
        ([200.0, 300.0, 440.0], false),
        ([300.0; 3], true),
    ] {
        localiser.ekf.relocate(&Vector3::zeros(), &covariance);
        localiser.correct(&[ranges_mm.map(wall); 3].concat());
        assert_eq!(localiser.ekf.pose_covariance() != covariance, is_corrected);
    }
}

// Requirement: DOC-1-2
#[test]
fn without_correction_pose_and_map_are_those_of_odometry() {
    let mut localiser = Localiser::new(LocaliserConfig {
        corrects: false,
        ..LocaliserConfig::default()
    });
    let begin = Pose2::new(700.0, -300.0, 0.6);
    // Two metres there, along a wall to the left, and two metres back; the wheels slip aside, the gyroscope is wrong.
    for nth in 0..400 {
        let x_mm = 10.0 * f64::from(200 - (200 - i32::try_from(nth).unwrap()).abs());
        let odometry = begin.compose(&Pose2::new(x_mm, 0.1 * f64::from(nth), 0.0));
        let left = 600.0 - 0.1 * f64::from(nth) - 60.0;
        localiser.observe(&Observation {
            odometry,
            gyro_rad: Some(0.01 * f64::from(nth)),
            ranges_mm: [None, None, Some(left)],
            ..report(nth, 0.0, (None, 0.0))
        });
        assert_eq!(localiser.estimate().pose, odometry);
    }
    let learned = localiser.calibration();
    let learned = (learned.gyro_scale.0, learned.gyro_bias_rad_s.0);
    assert_eq!(learned, (1.0, 0.0));
    let at_begin = |at| Pose2::at(at, 0.0).relative_to(&begin).position();
    let walls: Vec<Point> = localiser.grid().occupied().map(at_begin).collect();
    assert!(walls.len() > 50);
    assert!(
        walls.iter().all(|at| (at.y_mm - 600.0).abs() < 40.0),
        "{walls:?}"
    );
}

#[test]
fn body_is_entered_once_where_it_passed() {
    let ahead = |nth| Observation {
        odometry: Pose2::new(10.0 * f64::from(nth), 0.0, 0.0),
        ..report(nth, 0.0, (None, 0.0))
    };
    // Three stretches; the first three places of the way are within the radius of the body.
    let localiser = observing((0..=125).map(ahead));
    let log_odds = localiser.grid().log_odds_at(Point::new(0.0, 0.0));
    assert!((-3.5..-2.5).contains(&log_odds), "{log_odds}");
    // Silence is a reading every 75 ms.
    let silent = observing((0..8).map(ahead));
    assert_eq!(silent.tracks[0].readings.len(), 2);
}

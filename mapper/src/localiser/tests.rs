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
        front_bearing_rad: front.1,
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
fn turn_of_robot_or_sensor_ends_a_stretch() {
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
    let sweeping = |frames: u32| {
        let bearing = |nth| report(nth, 0.0, (Some(fresh(nth)), 0.05 * f64::from(nth)));
        is_entered(&observing((0..=frames).map(bearing)))
    };
    assert_eq!([sweeping(15), sweeping(25)], [false, true]);
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
fn range_nearer_than_the_sensor_measures_is_ignored() {
    for (range_mm, kept) in [(29.0, 0), (31.0, 1)] {
        let at = |nth| report(nth, 0.0, (Some(range_mm), 0.0));
        let localiser = observing((0..2).map(at));
        assert_eq!(localiser.tracks[0].readings.len(), kept, "{range_mm}");
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
    for _ in 0..12 {
        localiser.enter(&[wall(490.0), wall(520.0)], &Pose2::default());
    }
    localiser.enter(&[wall(1000.0)], &Pose2::default());
    let near = |x_mm| {
        let surfaces = &localiser.evidence.surfaces;
        surfaces.near(Point::new(x_mm, 0.0), 30.0).count()
    };
    assert!(near(500.0) > 0 && near(1000.0) == 0);
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
}

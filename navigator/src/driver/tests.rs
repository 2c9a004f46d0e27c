//! Tests of driving.

use super::*;
use crate::cost_map::tests::draw;
use crate::manoeuvre::tests::status;

#[test]
fn unexplained_echo_ends_a_path_only_nearby() {
    let open = ["...................."; 8];
    let walled = open.map(|row| row.replace(".........", "........#"));
    let walled: Vec<&str> = walled.iter().map(String::as_str).collect();
    for (later, range_mm, look_s, goes_on) in [
        (&open[..], None, 1.0, true),
        (&open, Some(600.0), 1.0, true),
        // It has a look of its own.
        (&open, Some(250.0), 0.75, false),
        (&walled, None, 0.75, true),
        (&walled, None, 1.0, false),
        // What the map knows is no doubt.
        (&walled, Some(600.0), 1.0, false),
    ] {
        let mut driver = Driver::new(Config {
            rest_every_s: 1e9,
            sweep_half_width_rad: 1.0,
            ..Config::default()
        });
        driver.rested_s = 0.0;
        let pose = Pose2::new(200.0, 400.0, 0.0);
        let map = driver.survey(&draw(&open), 0.0);
        let reach = Reach::new(&map, &pose, driver.config.inflation_mm);
        let end = map.index(Point::new(1800.0, 400.0)).unwrap();
        driver.follow(&reach, end, 0.0);
        let mut frame = |time_s| {
            let mut status = status(time_s, pose);
            status.ranges_mm[0] = range_mm;
            driver.step(&draw(later), &status)
        };
        frame(0.5);
        let step = frame(look_s);
        assert_eq!(step != Step::Interrupted, goes_on, "{range_mm:?}: {step:?}");
    }
}

#[test]
fn gyro_rests_in_time() {
    let (mut driver, grid) = (Driver::new(Config::default()), Grid::new(25.0));
    let Config {
        rest_every_s: every_s,
        rest_s,
        ..
    } = driver.config;
    driver.rested_s = 0.0;
    let rests = [0.0, every_s - 0.1, every_s, every_s + rest_s - 0.1].map(|time_s| {
        let step = driver.step(&grid, &status(time_s, Pose2::default()));
        step != Step::Arrived
    });
    assert_eq!(rests, [false, false, true, true]);
}

#[test]
fn way_back_ends_where_way_there_began() {
    let (mut driver, grid) = (Driver::new(Config::default()), Grid::new(25.0));
    driver.rested_s = 0.0;
    driver.enqueue([Kind::Straight(300.0), Kind::Straight(-300.0)]);
    // Something appears after 100 mm.
    for (time_s, x_mm, front_mm, forward_mm_s) in [
        (1.0, 0.0, None, Some(90.0)),
        (2.0, 100.0, None, Some(90.0)),
        (3.0, 100.0, Some(200.0), Some(-45.0)),
        (4.0, 10.0, None, Some(-45.0)),
        (5.0, -1.0, None, None),
    ] {
        let mut status = status(time_s, Pose2::new(x_mm, 0.0, 0.0));
        status.ranges_mm[0] = front_mm;
        let found = match driver.step(&grid, &status) {
            Step::Act(Action::Drive(velocity)) => Some(velocity.forward_mm_s),
            _ => None,
        };
        assert_eq!(found, forward_mm_s, "{time_s}");
    }
}

// Requirement: NAV-recovery-1
#[test]
fn stop_repeated_at_one_place_turns_about() {
    let config = Config {
        rest_every_s: 1e9,
        ..Config::default()
    };
    let (mut driver, grid) = (Driver::new(config), Grid::new(25.0));
    driver.rested_s = 0.0;
    let mut frame = |time_s, stop| {
        let at_start = status(time_s, Pose2::default());
        driver.step(&grid, &Status { stop, ..at_start })
    };
    let stall = Some(StopReason::Stall);
    for (time_s, turns) in [(1.0, false), (2.0, true)] {
        assert_eq!(frame(time_s, stall), Step::Act(Action::Resume));
        // The resume is on its way.
        assert_eq!(frame(time_s + 0.025, stall), Step::Act(Action::Resume));
        match frame(time_s + 0.05, None) {
            Step::Act(Action::Drive(velocity)) => {
                assert!(turns && velocity.yaw_rate_rad_s.abs() > 1.0, "{velocity:?}");
                assert!(velocity.forward_mm_s.abs() < 1e-9, "{velocity:?}");
            }
            step => assert_eq!((step, turns), (Step::Interrupted, false)),
        }
    }
}

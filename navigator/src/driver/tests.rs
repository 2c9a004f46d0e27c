//! Tests of driving.

use std::f64::consts::FRAC_PI_2;

use super::*;
use crate::cost_map::tests::draw;
use crate::manoeuvre::tests::status;

/// A driver that rests no more, on the way through open floor from (200, 400) to (1800, 400), mm.
fn under_way(sweep_half_width_rad: f64) -> (Driver, Grid) {
    let grid = draw(&["...................."; 8]);
    let mut driver = Driver::new(Config {
        rest_every_s: 1e9,
        sweep_half_width_rad,
        ..Config::default()
    });
    driver.rested_s = 0.0;
    let map = driver.survey(&grid, 0.0);
    let pose = Pose2::new(200.0, 400.0, 0.0);
    let reach = Reach::new(&map, &pose, driver.config.inflation_mm());
    let end = map.index(Point::new(1800.0, 400.0)).unwrap();
    driver.follow(&reach, end, 0.0);
    (driver, grid)
}

/// The motions that come before the path.
pub fn queue(driver: &Driver) -> Vec<Kind> {
    driver.queue.iter().map(|motion| motion.kind).collect()
}

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
        let (mut driver, _) = under_way(1.0);
        let pose = Pose2::new(200.0, 400.0, 0.0);
        let mut frame = |time_s| {
            let mut status = status(time_s, pose);
            status.ranges_mm[0] = range_mm;
            driver.step(&draw(later), &status)
        };
        frame(0.5);
        let step = frame(look_s);
        assert_eq!(step != Step::Interrupted, goes_on, "{range_mm:?}: {step:?}");
        assert_eq!(driver.follower.is_some(), goes_on);
        let at = Point::new(850.0, 100.0);
        let known = driver.map.as_ref().and_then(|map| map.at(at)).unwrap().cell;
        assert_eq!(known != draw(later).cell_at(at), later != open && goes_on);
    }
}

#[test]
fn gyro_rests_in_time() {
    let (mut driver, grid) = (Driver::new(Config::default()), Grid::new(25.0));
    let (every_s, long_s) = (driver.config.rest_every_s, driver.config.rest_s);
    driver.rested_s = 0.0;
    let rests = [0.0, every_s - 0.1, every_s, every_s + long_s - 0.1].map(|time_s| {
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
        (2.5, 100.0, Some(235.0), Some(90.0)),
        (3.0, 140.0, Some(235.0), Some(-45.0)),
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
    assert_eq!(driver.stopped.2, 1, "stops are counted, reports are not");
    assert!(matches!(queue(&driver)[0], Kind::Turn(facing) if (facing.abs() - PI).abs() < 1e-9));
}

#[test]
fn speed_is_limited_by_clearance_and_unknown_floor_ahead() {
    let limit = |change: fn(&mut Node, f64)| {
        let grid = draw(&["...................."; 8]);
        let mut map = CostMap::new(&grid, 0.0, &[], (&[], 100.0));
        for index in 0..map.nodes.len() {
            let x_mm = map.point(index).x_mm;
            let node = &mut map.nodes[index];
            (node.seen, node.known_mm, node.clearance_mm) = ([false, true], 500.0, 500.0);
            change(node, x_mm);
        }
        let path = [212.5, 1812.5].map(|x_mm| Point::new(x_mm, 412.5));
        speed_limit(&Follower::new(path.into()), &map, &Config::default())
    };
    let is = |found: f64, expected: f64| {
        assert!((found - expected).abs() < 1e-9, "{found} {expected}");
    };
    is(limit(|_, _| ()), 170.0);
    is(limit(|node, _| node.seen = [false; 2]), 90.0);
    is(limit(|node, _| node.known_mm = 110.0), 90.0);
    is(limit(|node, _| node.known_mm = 111.0), 170.0);
    is(limit(|node, _| node.clearance_mm = 170.0), 120.0);
    is(limit(|node, _| node.clearance_mm = 110.0), 60.0);
    is(limit(|node, _| node.clearance_mm = 104.0), 18.0);
    // Narrow 50 mm ahead: slower by then.
    let narrow = |node: &mut Node, x_mm: f64| {
        if (x_mm - 262.5).abs() < 1.0 {
            node.clearance_mm = 120.0;
        }
    };
    is(limit(narrow), 60f64.hypot(2e4f64.sqrt()));
}

// Requirement: NAV-contact-1
#[test]
fn close_echo_limits_speed_and_is_what_stops() {
    let (mut driver, _) = under_way(1.0);
    let pose = Pose2::new(200.0, 400.0, 0.0);
    assert!(driver.contact_limit(&pose).is_infinite());
    assert_eq!(driver.obstacle(&pose), None);
    let mut frame = status(0.1, pose);
    // Of a wall that the map knows, 178 mm ahead of the middle and 66 mm to the left.
    frame.ranges_mm[0] = Some(66f64.hypot(98.0));
    frame.front_bearing_rad = 66f64.atan2(98.0);
    let wall = draw(&["....#"; 8]);
    driver.sight.observe(&frame, &driver.config, &wall, 0.0);
    // There the body reaches 88 mm; 15 mm are kept.
    assert!((driver.contact_limit(&pose) - 150.0).abs() < 1e-6);
    let velocity = |forward_mm_s, sweep_half_width_rad| Velocity {
        forward_mm_s,
        yaw_rate_rad_s: 0.2,
        sweep_half_width_rad,
    };
    let slower = Step::Act(Action::Drive(velocity(driver.contact_limit(&pose), 1.0)));
    assert_eq!(driver.drive(velocity(170.0, 0.0), &pose), slower);
    let marks = |stop| {
        let mut driver = driver.clone();
        driver.recover(&Status { stop, ..frame });
        driver.marks
    };
    let seen = marks(None);
    assert!(seen.len() == 1 && seen[0].1.distance_mm(pose.point_at(178.0, 66.0)) < 1e-6);
    // What a wheel met was not seen.
    let ahead = marks(Some(StopReason::Slip))[1].1;
    assert!(ahead.distance_mm(pose.point_at(120.0, 0.0)) < 1e-6);
    driver.enqueue([Kind::Straight(300.0)]);
    let near = status(0.2, Pose2::new(270.0, 400.0, 0.0));
    assert_eq!(driver.next_motion(&near), None);
    driver.trail.net_rad = 0.3;
    for in_vain in [0, 2] {
        driver.queue.clear();
        driver.leave(&pose, in_vain);
        let [Kind::Turn(facing), Kind::Straight(away_mm)] = queue(&driver)[..] else {
            panic!("{:?}", queue(&driver));
        };
        let about = wrap_angle(66f64.atan2(178.0) + PI + 0.7 * f64::from(in_vain));
        assert!((facing - 0.3).abs() <= PI && wrap_angle(facing - 0.3 - about).abs() < 1e-9);
        assert!((away_mm - BACK_MM).abs() < 1e-9);
    }
}

// Requirement: NAV-recovery-1
#[test]
fn stop_marks_its_place_and_goes_back_within_what_was_driven() {
    for (way_mm, reason, back_mm) in [
        (200.0, StopReason::Stall, Some(150.0)),
        (100.0, StopReason::Slip, Some(100.0)),
        (15.0, StopReason::Stall, None),
    ] {
        let (mut driver, grid) = under_way(0.0);
        let pose = |x_mm: f64| Pose2::new(200.0 + x_mm, 400.0, 0.0);
        driver.step(&grid, &status(0.1, pose(0.0)));
        driver.step(&grid, &status(0.2, pose(way_mm)));
        driver.enqueue([Kind::Rest(9.0)]);
        let stop = Status {
            stop: Some(reason),
            ..status(0.3, pose(way_mm))
        };
        assert_eq!(driver.step(&grid, &stop), Step::Act(Action::Resume));
        assert!(driver.held && driver.follower.is_none());
        let expected = Vec::from_iter(back_mm.map(|mm: f64| Kind::Straight(-mm)));
        assert_eq!(queue(&driver), expected, "{reason:?}");
        assert_eq!(driver.marks.len(), 3);
        for (&(time_s, at), aside) in driver.marks.iter().zip([-50.0, 0.0, 50.0]) {
            assert!((time_s - 0.3).abs() < 1e-9);
            let expected = pose(way_mm).point_at(120.0, aside);
            assert!(at.distance_mm(expected) < 1e-6, "{at:?}");
        }
        driver.queue.clear();
        let steps = [0.4, 0.5].map(|time_s| driver.step(&grid, &status(time_s, pose(way_mm))));
        assert_eq!(steps, [Step::Interrupted, Step::Arrived]);
        assert!(driver.held);
        driver.step(&grid, &status(0.55, pose(way_mm + 90.0)));
        assert!(driver.held, "it was pushed");
        driver.step(&grid, &status(0.6, pose(way_mm + 100.0)));
        assert!(!driver.held, "it has left the place");
        // The marks are obstacles for a while, unless they are forgotten.
        let is_marked = |driver: &mut Driver, time_s| {
            let map = driver.survey(&grid, time_s);
            let ahead = map.at(pose(way_mm).point_at(120.0, 0.0)).copied();
            ahead.expect("on the grid").clearance_mm < 60.0
        };
        let mut forgetful = driver.clone();
        forgetful.forget_marks();
        assert!(is_marked(&mut driver, 399.0) && !is_marked(&mut forgetful, 399.0));
        assert!(!is_marked(&mut driver, 401.0));
    }
    // A plan that took longer than the stop deadline is followed.
    let (mut driver, grid) = under_way(1.0);
    let at = Pose2::new(200.0, 400.0, 0.0);
    let mut lost = status(0.0, at);
    lost.stop = Some(StopReason::Link);
    for time_s in [0.1, 4.2, 8.3] {
        let ahead = driver.step(&grid, &status(time_s, at));
        assert!(matches!(ahead, Step::Act(Action::Drive(to)) if to.forward_mm_s > BLOCKED.0));
        lost.time_s = time_s + 4.0;
        assert_eq!(driver.step(&grid, &lost), Step::Act(Action::Resume));
        assert!(!driver.held && driver.marks.is_empty());
    }
}

#[test]
fn robot_that_does_not_move_is_blocked_after_a_second() {
    let (mut driver, grid) = under_way(1.0);
    driver.enqueue([Kind::Rest(5.0)]);
    for (time_s, speed_mm_s, is_blocked) in [
        (0.1, 0.0, false),
        (5.0, 0.0, false),
        (5.2, 0.0, false),
        (5.9, 13.0, false),
        (6.8, 11.0, false),
        (7.0, 11.0, true),
    ] {
        let frame = Status {
            speed_mm_s,
            ..status(time_s, Pose2::new(200.0, 400.0, 0.0))
        };
        let step = driver.step(&grid, &frame);
        let marks = if is_blocked { 3 } else { 0 };
        assert_eq!(driver.marks.len(), marks, "{time_s}");
        assert_eq!(step == Step::Interrupted, is_blocked, "{step:?}");
    }
}

#[test]
fn robot_without_sweep_looks_for_slanted_walls_first() {
    for (sweep_half_width_rad, heading_rad, net_rad, expected) in [
        (0.0, 0.0, 2.0, Some(1.2)),
        // To half-way between the walls, whichever side of one the heading is on.
        (0.0, 0.2, -2.0, Some(-1.4)),
        (0.0, 0.28, 2.0, Some(0.92)),
        // Not along the walls.
        (0.0, 0.5, 2.0, None),
        (1.0, 0.0, 2.0, None),
    ] {
        let (mut driver, grid) = under_way(sweep_half_width_rad);
        driver.trail.net_rad = net_rad;
        let step = driver.step(&grid, &status(0.1, Pose2::new(200.0, 400.0, heading_rad)));
        let queue = queue(&driver);
        if let Some(turn) = expected {
            let [Kind::Turn(there), Kind::Turn(back)] = queue[..] else {
                panic!("{queue:?}");
            };
            assert!((there - turn).abs() < 1e-9 && (back - net_rad).abs() < 1e-9);
        } else {
            assert_eq!(queue, []);
        }
        assert!(matches!(step, Step::Act(Action::Drive(_))), "{step:?}");
    }
}

// Requirement: NAV-contact-1
#[test]
fn robot_creeps_obliquely_towards_the_plane_of_what_it_saw() {
    for (heading_rad, seen, limit_mm_s) in [
        (0.0, Some((200.0, 560.0)), None),
        (0.5, None, None),
        (0.5, Some((200.0, 560.0)), Some(18.0)),
        (0.5, Some((-90.0, 560.0)), Some(18.0)),
        (0.5, Some((-110.0, 560.0)), None),
        (0.5, Some((200.0, 575.0)), None),
        // It drives away from it, or has passed it.
        (-0.5, Some((200.0, 560.0)), None),
        (0.5, Some((200.0, 390.0)), None),
    ] {
        let (mut driver, grid) = under_way(1.0);
        if let Some((x_mm, y_mm)) = seen {
            let sensor = Pose2::new(x_mm, y_mm - 100.0, FRAC_PI_2);
            driver.sight.see_near(&sensor, 100.0, 0.0, &grid);
        }
        let found = driver.contact_limit(&Pose2::new(200.0, 400.0, heading_rad));
        let found = found.is_finite().then_some(found);
        assert_eq!(found, limit_mm_s, "{heading_rad} {seen:?}");
    }
}

// Requirement: NAV-contact-1
#[test]
fn path_keeps_the_clearance_it_was_planned_with() {
    // A passage of 200 mm.
    let (wall, floor) = ("####################", "....................");
    let grid = draw(&[wall, wall, floor, floor, wall, wall]);
    for (clearance_mm, goes_on) in [(40.0, true), (80.0, true), (100.0, false)] {
        let (mut driver, _) = under_way(1.0);
        let pose = Pose2::new(200.0, 250.0, 0.0);
        let map = driver.survey(&grid, 0.0);
        let reach = Reach::new(&map, &pose, 40.0);
        let end = map.index(Point::new(1800.0, 250.0)).unwrap();
        driver.follow(&reach, end, 0.0);
        assert!((driver.clearance_mm - 40.0).abs() < 1e-9);
        driver.clearance_mm = clearance_mm;
        let velocity = driver.follow_path(&grid, &status(1.0, pose));
        assert_eq!(velocity.is_some(), goes_on, "{clearance_mm}");
        assert!(velocity.is_none_or(|velocity| velocity.forward_mm_s <= TOUCH_MM_S));
    }
}

#[test]
fn look_ahead_cuts_no_corner_over_unseen_or_narrow_floor() {
    let forward_mm_s = |change: fn(&mut Node)| {
        let (mut driver, grid) = under_way(1.0);
        let path = [(212.5, 412.5), (312.5, 412.5), (312.5, 712.5)];
        let path = path.map(|(x_mm, y_mm)| Point::new(x_mm, y_mm));
        driver.follower = Some(Follower::new(path.into()));
        let map = driver.map.as_mut().unwrap();
        map.nodes
            .iter_mut()
            .for_each(|node| node.seen = [true, false]);
        let corner = map.index(Point::new(262.5, 462.5)).unwrap();
        change(&mut map.nodes[corner]);
        let frame = status(0.5, Pose2::new(242.5, 412.5, 0.0));
        driver.follow_path(&grid, &frame).unwrap().forward_mm_s
    };
    // Beyond the corner it would turn on the spot.
    assert!(forward_mm_s(|_| ()).abs() < 1e-9);
    assert!(forward_mm_s(|node| node.seen = [false; 2]) > 10.0);
    assert!(forward_mm_s(|node| node.clearance_mm = 100.0) > 10.0);
}

#[test]
fn survey_knows_what_floor_a_beam_has_passed() {
    let (mut driver, grid) = under_way(0.0);
    let frame = status(0.1, Pose2::new(200.0, 400.0, 0.0));
    driver.sight.observe(&frame, &driver.config, &grid, 0.0);
    let map = driver.survey(&grid, 0.2);
    for (x_mm, y_mm, seen) in [(600.0, 400.0, [true, false]), (1500.0, 400.0, [false; 2])] {
        let node = map.at(Point::new(x_mm, y_mm)).expect("on the grid");
        assert_eq!(node.seen, seen, "{x_mm}");
    }
}

mod gaps;
mod motions;

use super::*;
use crate::manoeuvre::tests::status;

/// A room of 1 m by 2 m with openings in its right wall: where and how wide, mm.
fn room(openings: &[(f64, f64)]) -> Grid {
    let is_open = |y_mm: f64| {
        let mut openings = openings.iter();
        openings.any(|(at_mm, width_mm)| (y_mm - at_mm).abs() < width_mm / 2.0)
    };
    let (low, high) = (Point::new(-50.0, -50.0), Point::new(2000.0, 2050.0));
    Grid::from_fn(25.0, low, high, |Point { x_mm, y_mm }| {
        let wall = x_mm < 0.0 || x_mm > 1000.0 && !is_open(y_mm) || !(0.0..2000.0).contains(&y_mm);
        match x_mm < 1025.0 {
            true if wall => 4.0,
            true => -4.0,
            false => 0.0,
        }
    })
}

/// In the middle of the room, with every surface seen from near.
fn explorer() -> (Explorer, Status) {
    let mut explorer = Explorer::new(Config::default());
    let pose = Pose2::new(500.0, 1000.0, 0.0);
    explorer.start = Some(pose);
    for step in 0..200 {
        let along_mm = 10.0 * f64::from(step);
        let mut see = |x_mm: f64, y_mm: f64, heading_rad: f64| {
            let sensor = Pose2::new(x_mm, y_mm, heading_rad);
            explorer.driver.sight.see_surface(&sensor, 300.0);
        };
        see(300.0, along_mm, 2.0 * FRAC_PI_2);
        see(720.0, along_mm, 0.0);
        see(along_mm / 2.0, 300.0, -FRAC_PI_2);
        see(along_mm / 2.0, 1700.0, FRAC_PI_2);
    }
    (explorer, status(100.0, pose))
}

/// The motions that come before the path.
fn queue(explorer: &Explorer) -> Vec<Motion> {
    crate::driver::tests::queue(&explorer.driver)
}

fn target(kind: Kind, x_mm: f64, y_mm: f64) -> Target {
    Target {
        kind,
        centre: Point::new(x_mm, y_mm),
        view: 0,
        gain: 0.3,
        clearance_mm: 120.0,
    }
}

#[test]
fn places_are_remembered_with_their_deviation() {
    let mut explorer = Explorer::new(Config::default());
    for x_mm in [0.0, 299.0, 300.0, 550.0] {
        let mut status = status(0.0, Pose2::new(x_mm, 0.0, 0.0));
        status.estimate.covariance[0][0] = 900.0;
        status.estimate.covariance[1][1] = 1600.0;
        explorer.record(&status);
    }
    let expected = [0.0, 300.0].map(|x_mm| (Point::new(x_mm, 0.0), 50.0));
    assert_eq!(explorer.anchors, expected);
}

#[test]
fn target_is_resolved_once_it_is_seen() {
    let (mut explorer, _) = explorer();
    let approach = Goal::Approach;
    for (goal, expected) in [
        (approach(target(Kind::Frontier, 500.0, 500.0)), true),
        (approach(target(Kind::Frontier, 1500.0, 500.0)), false),
        (approach(target(Kind::Gap, 500.0, 500.0)), false),
        (approach(target(Kind::Surface, 1000.0, 500.0)), true),
        (approach(target(Kind::Surface, 1500.0, 500.0)), false),
        (Goal::Look(target(Kind::Frontier, 500.0, 500.0)), false),
    ] {
        explorer.driver.map = None;
        explorer.goal = goal;
        assert!(!explorer.is_resolved());
        explorer.driver.map = Some(CostMap::new(&room(&[]), 0.0, &[], (&[], 100.0)));
        assert_eq!(explorer.is_resolved(), expected, "{goal:?}");
    }
    // The way there is left, and the next target is chosen.
    let (grid, pose) = (room(&[]), Pose2::new(500.0, 1000.0, 0.0));
    let map = CostMap::new(&grid, 0.0, &[], (&[], 100.0));
    let reach = Reach::new(&map, &pose, 120.0);
    let node = map.index(Point::new(500.0, 500.0)).unwrap();
    explorer.driver.follow(&reach, node, 100.0);
    explorer.driver.rested_s = 100.0;
    explorer.start = Some(Pose2::new(500.0, 600.0, 0.0));
    explorer.goal = approach(target(Kind::Frontier, 500.0, 500.0));
    explorer.step(&grid, &status(100.0, pose));
    let goal = explorer.goal;
    assert!(matches!(goal, Goal::Home(Outcome::Complete)), "{goal:?}");
    assert!(explorer.driver.follower.is_some());
}

#[test]
fn surface_that_was_never_near_is_a_target() {
    let (seen, status) = explorer();
    let mut explorer = Explorer::new(seen.driver.config);
    explorer.leaves = 3;
    explorer.choose(&room(&[]), &status);
    let Goal::Approach(found) = explorer.goal else {
        panic!("{:?}", explorer.goal);
    };
    assert_eq!((found.kind, explorer.leaves), (Kind::Surface, 0));
    assert_eq!(explorer.chosen, Some((Kind::Surface, status.time_s)));
}

#[test]
fn uncertain_robot_returns_to_where_it_was_sure() {
    let returns = |time_s: f64, deviation_mm: f64, then_mm: f64| {
        let (mut explorer, mut status) = explorer();
        status.time_s = time_s;
        status.estimate.covariance[0][0] = deviation_mm * deviation_mm;
        explorer.anchors = [(300.0, 400.0), (500.0, 1500.0)]
            .map(|(x, y)| (Point::new(x, y), then_mm))
            .into();
        explorer.choose(&room(&[(1000.0, 400.0)]), &status);
        let is_return = matches!(explorer.goal, Goal::Return);
        let follower = explorer.driver.follower.as_ref().expect("a way");
        let end = follower.remaining_mm();
        // The nearer one.
        assert!(!is_return || (400.0..=600.0).contains(&end), "{end}");
        // Not again at once.
        explorer.choose(&room(&[(1000.0, 400.0)]), &status);
        assert!(!matches!(explorer.goal, Goal::Return));
        is_return
    };
    assert!(returns(100.0, 90.0, 40.0));
    assert!(!returns(100.0, 90.0, 50.0), "it was no better there");
    assert!(!returns(100.0, 79.0, 30.0), "sure enough");
    assert!(!returns(59.0, 90.0, 40.0), "a return just before");
}

#[test]
fn late_explorer_goes_home_and_lost_one_gives_up() {
    let mut recalled = explorer().0;
    recalled.recall();
    let end = |time_s: f64, start: Pose2, openings: &[(f64, f64)]| {
        let (mut explorer, mut status) = explorer();
        status.time_s = time_s;
        explorer.start = Some(start);
        explorer.choose(&room(openings), &status);
        (explorer.targets(), explorer.goal)
    };
    let (near, open) = (Pose2::new(500.0, 400.0, 0.0), [(1000.0, 400.0)]);
    let limit_s = Config::default().time_limit_s;
    assert!(matches!(end(limit_s, near, &open), (1, Goal::Approach(_))));
    let late = end(limit_s + 1.0, near, &open);
    assert!(
        matches!(late, (1, Goal::Home(Outcome::TimeLimit))),
        "{late:?}"
    );
    recalled.choose(&room(&open), &explorer().1);
    assert!(matches!(recalled.goal, Goal::Home(Outcome::Recalled)));
    let done = end(100.0, near, &[]);
    assert!(
        matches!(done, (0, Goal::Home(Outcome::Complete))),
        "{done:?}"
    );
    let cut_off = end(100.0, Pose2::new(5000.0, 400.0, 0.0), &[]);
    assert!(
        matches!(cut_off.1, Goal::Finish(Outcome::Unreachable)),
        "{cut_off:?}"
    );
}

#[test]
fn held_robot_turns_away_before_it_goes_home_or_gives_up() {
    for (start_y_mm, choices) in [(1000.0, 4), (400.0, 8)] {
        let (mut explorer, status) = explorer();
        explorer.start = Some(Pose2::new(500.0, start_y_mm, 0.0));
        let mut turns = Vec::new();
        for nth in 0..choices {
            explorer.driver.held = true;
            explorer.driver.queue.clear();
            explorer.choose(&room(&[]), &status);
            assert_eq!(matches!(explorer.goal, Goal::Choose), nth < 4, "{nth}");
            turns.extend(queue(&explorer).first().copied());
        }
        turns.dedup();
        assert_eq!(turns.len(), 4, "{turns:?}");
        explorer.driver.held = true;
        explorer.choose(&room(&[]), &status);
        assert!(matches!(explorer.goal, Goal::Finish(Outcome::Unreachable)));
    }
}

#[test]
fn way_home_that_stays_blocked_is_given_up() {
    for (ending, expected) in [
        (Outcome::Complete, Outcome::Unreachable),
        (Outcome::TimeLimit, Outcome::TimeLimit),
    ] {
        let (mut explorer, mut at) = explorer();
        let mut interrupt = |x_mm: f64| {
            at.estimate.pose = Pose2::new(x_mm, 1000.0, 0.0);
            explorer.goal = Goal::Home(ending);
            explorer.interrupted(&at);
            match explorer.goal {
                Goal::Finish(outcome) => Some(outcome),
                _ => None,
            }
        };
        // As long as it comes nearer it tries again.
        for step in 0..30 {
            assert_eq!(interrupt(5000.0 - 110.0 * f64::from(step)), None);
        }
        for _ in 0..8 {
            assert_eq!(interrupt(1800.0), None);
        }
        // A few millimetres are none.
        for nth in 0..=8 {
            assert_eq!(interrupt(1600.0 - 5.0 * f64::from(nth)), None);
        }
        assert_eq!(interrupt(1550.0), Some(expected));
    }
}

#[test]
fn first_way_is_as_long_as_a_look_straight_ahead_allows() {
    let config = Config {
        sweep_half_width_rad: 1.0,
        ..Config::default()
    };
    for (ahead_at_s, way_mm) in [(2.5, 300.0), (60.0, 150.0)] {
        let mut explorer = Explorer::new(config);
        let mut report = status(0.0, Pose2::new(500.0, 1000.0, 0.0));
        let way = (0..400).find_map(|frame| {
            report.time_s = 0.025 * f64::from(frame);
            // A wall near aside.
            let is_aside = report.time_s < ahead_at_s;
            report.ranges_mm[0] = Some(if is_aside { 400.0 } else { 1500.0 });
            report.front_bearing_rad = if is_aside { 0.9 } else { 0.1 };
            explorer.step(&room(&[]), &report);
            let queue = queue(&explorer);
            queue
                .contains(&Motion::Turn(FRAC_PI_2))
                .then_some((queue, report.time_s))
        });
        let (queue, time_s) = way.expect("a first way");
        assert_eq!(
            queue[..2],
            [Motion::Straight(way_mm), Motion::Straight(-way_mm)]
        );
        assert!(
            (time_s - ahead_at_s).abs() < 0.1 || (time_s - 5.0).abs() < 0.1,
            "{time_s}"
        );
    }
}

#[test]
fn look_that_left_the_most_was_in_vain() {
    let open = room(&[(1000.0, 400.0)]);
    let (mut explorer, status) = explorer();
    explorer.choose(&open, &status);
    let Goal::Approach(found) = explorer.goal else {
        panic!("{:?}", explorer.goal);
    };
    for (last, tries) in [
        (
            Target {
                gain: 1.5 * found.gain,
                ..found
            },
            0,
        ),
        (
            Target {
                kind: Kind::Surface,
                ..found
            },
            0,
        ),
        (target(Kind::Frontier, 500.0, 300.0), 0),
        (found, 1),
    ] {
        explorer.goal = Goal::Look(last);
        explorer.choose(&open, &status);
        assert_eq!(
            explorer.tries(found.centre, SAME_MM).count(),
            tries,
            "{last:?}"
        );
        assert!(matches!(explorer.goal, Goal::Approach(_)));
    }
    // The second time.
    explorer.goal = Goal::Look(found);
    explorer.choose(&open, &status);
    assert!(
        matches!(explorer.goal, Goal::Home(Outcome::Complete)),
        "{:?}",
        explorer.goal
    );
}

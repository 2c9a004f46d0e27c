//! What the explorer does where it arrives.

use super::*;

#[test]
fn first_way_keeps_off_the_echo_and_turns_follow() {
    for (range_mm, way_mm) in [
        (Some(1000.0), Some(300.0)),
        (Some(450.0), Some(150.0)),
        (Some(349.0), None),
        (None, Some(150.0)),
    ] {
        let mut explorer = Explorer::new(Config::default());
        let mut status = status(0.0, Pose2::default());
        status.ranges_mm[0] = range_mm;
        explorer.arrived(&room(&[]), &status);
        let ways = way_mm.map(|way_mm: f64| [Motion::Straight(way_mm), Motion::Straight(-way_mm)]);
        let turns = [FRAC_PI_2, -FRAC_PI_2, 0.0].map(Motion::Turn);
        let rest = [Motion::Rest(1.0)];
        let expected: Vec<Motion> = ways
            .into_iter()
            .flatten()
            .chain(rest)
            .chain(turns)
            .collect();
        assert_eq!(queue(&explorer), expected);
        assert!(matches!(explorer.goal, Goal::Choose));
    }
}

#[test]
fn arrival_looks_or_enters_what_no_look_could_clear() {
    let pose = Pose2::new(500.0, 1000.0, 0.3);
    let enters = |kind, x_mm: f64, y_mm: f64, is_tried: bool| {
        let (mut explorer, mut status) = explorer();
        status.estimate.pose = pose;
        explorer.driver.trail.net_rad = 0.5;
        let target = target(kind, x_mm, y_mm);
        explorer.tries.extend(is_tried.then_some(target));
        explorer.goal = Goal::Approach(target);
        explorer.arrived(&room(&[]), &status);
        assert!(matches!(explorer.goal, Goal::Look(_)));
        let is_gap = kind == Kind::Gap;
        assert_eq!(explorer.gap_views.contains(&pose.position()), is_gap);
        assert_eq!(
            explorer.tries.len(),
            usize::from(is_tried) + usize::from(is_gap)
        );
        let queue = queue(&explorer);
        let is_look = queue.len() == 2;
        let away_mm = pose.position().distance_mm(target.centre);
        if !is_look {
            assert_eq!(queue.len(), 5);
            let facing = 0.5 + FRAC_PI_4 - 0.3;
            let expected = [
                Motion::Turn(facing),
                Motion::Rest(0.3),
                Motion::Straight(away_mm),
                Motion::Turn(facing + LOOK_RAD),
                Motion::Turn(facing - LOOK_RAD),
            ];
            for (motion, expected) in queue.iter().zip(expected) {
                match (*motion, expected) {
                    (Motion::Turn(a), Motion::Turn(b)) => assert!((a - b).abs() < 1e-9),
                    (a, b) => assert_eq!(a, b),
                }
            }
        }
        !is_look
    };
    assert!(enters(Kind::Frontier, 800.0, 1300.0, true));
    assert!(!enters(Kind::Frontier, 800.0, 1300.0, false));
    assert!(!enters(Kind::Frontier, 980.0, 1480.0, true));
    assert!(!enters(Kind::Gap, 800.0, 1300.0, true));
}

#[test]
fn look_is_along_the_walls_and_turns_to_what_is_behind() {
    let pose = Pose2::new(500.0, 1000.0, 1.9);
    // The walls run at 0.2: the nearest of their directions is 0.2 + π/2.
    let aligned = 0.2 + FRAC_PI_2 - 1.9;
    let bearings = |off: f64| pose.facing(0.2 + FRAC_PI_2 + off).point_at(1000.0, 0.0);
    let look = |sweep_half_width_rad, net_rad: f64, off: Option<f64>| {
        let mut explorer = Explorer::new(Config {
            sweep_half_width_rad,
            ..Config::default()
        });
        explorer.driver.map = Some(CostMap::new(&room(&[]), 0.2, &[], (&[], 100.0)));
        explorer.driver.trail.net_rad = net_rad;
        explorer.look(off.map(bearings), &status(7.0, pose));
        let rested_s = if sweep_half_width_rad > 0.0 {
            7.0
        } else {
            f64::NEG_INFINITY
        };
        assert!(explorer.driver.rested_s.total_cmp(&rested_s).is_eq());
        let Motion::Turn(first) = queue(&explorer)[0] else {
            panic!("no turn");
        };
        let last = match queue(&explorer)[1] {
            Motion::Turn(last) => last,
            motion => {
                assert_eq!(motion, Motion::Rest(Config::default().rest_s));
                first
            }
        };
        [first, last].map(|turn| turn - net_rad)
    };
    let expect = |found: [f64; 2], expected: [f64; 2]| {
        let is_near = |(found, expected): (f64, f64)| (found - aligned - expected).abs() < 1e-9;
        assert!(
            found.into_iter().zip(expected).all(is_near),
            "{found:?} {expected:?}"
        );
    };
    for (net_rad, unwind) in [(1.0, -1.0), (-1.0, 1.0)] {
        let turns = [unwind * LOOK_RAD, -unwind * LOOK_RAD];
        expect(look(0.0, net_rad, None), turns);
        expect(look(0.0, net_rad, Some(2.2)), turns);
        let behind = turns.map(|turn| turn + unwind * FRAC_PI_2);
        expect(look(0.0, net_rad, Some(2.5)), behind);
        expect(look(1.0, net_rad, Some(-1.7)), [0.0; 2]);
        expect(look(1.0, net_rad, Some(1.8)), [FRAC_PI_2; 2]);
        expect(look(1.0, net_rad, Some(-1.8)), [-FRAC_PI_2; 2]);
    }
}

#[test]
fn home_is_left_with_the_heading_of_the_start() {
    let (mut explorer, mut status) = explorer();
    explorer.start = Some(Pose2::new(500.0, 1000.0, 1.0));
    status.estimate.pose = Pose2::new(500.0, 1000.0, 0.3);
    explorer.driver.trail.net_rad = 2.0;
    explorer.driver.rested_s = status.time_s;
    explorer.goal = Goal::Home(Outcome::Complete);
    explorer.arrived(&room(&[]), &status);
    let [Motion::Turn(turn), Motion::Rest(rest_s)] = queue(&explorer)[..] else {
        panic!("{:?}", queue(&explorer));
    };
    assert!((turn - 2.7).abs() < 1e-9 && (rest_s - 1.0).abs() < 1e-9);
    assert!(matches!(explorer.goal, Goal::Finish(Outcome::Complete)));
    explorer.driver.queue.clear();
    assert_eq!(
        explorer.step(&room(&[]), &status),
        Action::Done(Outcome::Complete)
    );
}

#[test]
fn wound_robot_looks_where_it_unwinds_to() {
    for (sweep_half_width_rad, expected) in [
        (1.0, [Motion::Turn(TAU), Motion::Rest(1.5)]),
        (
            0.0,
            [-LOOK_RAD, LOOK_RAD].map(|off| Motion::Turn(TAU + off)),
        ),
    ] {
        let mut explorer = Explorer::new(Config {
            sweep_half_width_rad,
            ..Config::default()
        });
        explorer.driver.trail.net_rad = 2.0 * TAU;
        let status = status(0.0, Pose2::default());
        explorer.look(Some(Point::new(1000.0, 0.0)), &status);
        assert_eq!(queue(&explorer), expected);
    }
}

#[test]
fn explorer_begins_with_a_rest_where_it_stands() {
    let mut explorer = Explorer::new(Config::default());
    let begun = status(0.0, Pose2::new(30.0, 40.0, 0.5));
    let action = explorer.step(&room(&[]), &begun);
    assert_eq!(action, Action::Drive(Velocity::default()));
    assert_eq!(explorer.start, Some(begun.estimate.pose));
    assert_eq!(queue(&explorer), [Motion::Rest(FIRST_REST_S)]);
    explorer.step(&room(&[]), &status(0.1, Pose2::new(31.0, 40.0, 0.5)));
    assert_eq!(explorer.start, Some(begun.estimate.pose));
    assert_eq!(explorer.anchors.len(), 1);
}

#[test]
fn interrupted_target_was_tried_in_vain() {
    let tried = target(Kind::Frontier, 500.0, 500.0);
    for (goal, tries, kind, counts) in [
        (Goal::Approach(tried), 1, Kind::Frontier, false),
        (Goal::Look(tried), 1, Kind::Surface, false),
        (Goal::Approach(tried), 1, Kind::Gap, true),
        (Goal::Pass(tried), 1, Kind::Gap, true),
        (Goal::Return, 0, Kind::Frontier, true),
        (Goal::Home(Outcome::Complete), 0, Kind::Frontier, true),
    ] {
        let (mut explorer, status) = explorer();
        explorer.goal = goal;
        explorer.chosen = Some((kind, 70.0));
        explorer.interrupted(&status);
        // It looks at what closes a gap.
        let looks = matches!(goal, Goal::Pass(_));
        assert_eq!(matches!(explorer.goal, Goal::Look(_)), looks);
        assert_eq!(matches!(explorer.goal, Goal::Choose), !looks);
        assert_eq!(queue(&explorer).len(), if looks { 2 } else { 0 });
        assert_eq!(explorer.tries(tried.centre, 1.0).count(), tries);
        assert_eq!(explorer.chosen.is_some(), counts, "{goal:?} {kind:?}");
    }
}

#[test]
fn returned_robot_looks_around_and_chooses() {
    let (mut explorer, status) = explorer();
    for goal in [Goal::Return, Goal::Pass(target(Kind::Gap, 500.0, 500.0))] {
        explorer.goal = goal;
        explorer.driver.queue.clear();
        explorer.arrived(&room(&[]), &status);
        assert_eq!(queue(&explorer).len(), 2);
        assert!(matches!(explorer.goal, Goal::Choose));
    }
}

//! Which gaps are looked at and gone through.

use super::*;
use crate::explorer::gaps::is_passed;
use crate::follower::Follower;

/// The front sensor has looked from these poses, as far as 1.3 m.
fn looking(grid: &Grid, poses: impl Iterator<Item = Pose2>) -> (Explorer, Status) {
    let (mut explorer, status) = explorer();
    for (nth, pose) in (0..).zip(poses) {
        let mut seen = status;
        seen.estimate.pose = pose;
        seen.ranges_mm = [Some(1300.0 - 0.1 * f64::from(nth)), None, None];
        let sight = &mut explorer.driver.sight;
        sight.observe(&seen, &Config::default(), grid, 0.0);
    }
    (explorer, status)
}

/// It has seen the floor before the right wall, and through a gap in it.
fn looked_through(grid: &Grid, y_mm: f64) -> (Explorer, Status) {
    let before = (0..40).map(|step| Pose2::new(100.0, 50.0 * f64::from(step), 0.0));
    looking(grid, before.chain([Pose2::new(700.0, y_mm, 0.0)]))
}

#[test]
fn gap_is_looked_at_twice_and_again_once_it_has_shown_more() {
    let grid = room(&[(500.0, 150.0), (1500.0, 275.0)]);
    let (mut explorer, status) = explorer();
    let chosen = |explorer: &mut Explorer| {
        explorer.choose(&grid, &status);
        match explorer.goal {
            Goal::Approach(target) => {
                assert_eq!(target.kind, Kind::Gap);
                explorer.tries.push(target);
                Some(target.centre.y_mm > 1000.0)
            }
            _ => None,
        }
    };
    let order = [(); 5].map(|()| chosen(&mut explorer));
    assert_eq!(
        order,
        [Some(true), Some(true), Some(false), Some(false), None]
    );
    // The looks have shown more floor behind the gaps.
    for tried in &mut explorer.tries {
        tried.gain /= 2.1;
    }
    assert_eq!(chosen(&mut explorer), Some(true));
    // Each but the last has shown a wider gap.
    let others = explorer.tries.len() - 1;
    for tried in &mut explorer.tries[..others] {
        tried.clearance_mm -= 40.0;
        tried.gain *= 2.1;
    }
    assert_eq!(chosen(&mut explorer), Some(true));
}

#[test]
fn passed_gap_comes_first_however_narrow_and_late() {
    let grid = room(&[(500.0, 125.0), (1500.0, 275.0)]);
    let first = |gaps_s, (mut explorer, status): (Explorer, Status)| {
        explorer.gaps_s = gaps_s;
        explorer.choose(&grid, &status);
        match explorer.goal {
            Goal::Approach(found) => Some((found.kind, found.centre.y_mm > 1000.0)),
            _ => None,
        }
    };
    assert_eq!(first(0.0, explorer()), Some((Kind::Gap, true)));
    assert_eq!(first(1000.0, explorer()), None);
    for (y_mm, gaps_s) in [(500.0, 0.0), (500.0, 1000.0), (1500.0, 1000.0)] {
        let found = first(gaps_s, looked_through(&grid, y_mm));
        assert_eq!(found, Some((Kind::Gap, y_mm > 1000.0)));
    }
    // Beams along the wall have not.
    let along = (0..40).map(|step| Pose2::new(15.0 * f64::from(step) + 600.0, 50.0, FRAC_PI_2));
    assert_eq!(first(1000.0, looking(&grid, along)), None);
}

#[test]
fn gap_that_was_looked_at_is_gone_through() {
    let grid = room(&[(1500.0, 225.0)]);
    let last = target(Kind::Gap, 1050.0, 1500.0);
    let far = target(Kind::Gap, 1050.0, 900.0);
    let narrow = room(&[(1500.0, 125.0)]);
    for (grid, last, passes) in [
        (&grid, last, true),
        (&grid, target(Kind::Frontier, 1050.0, 1500.0), false),
        (&grid, far, false),
        // Wide enough for the robot: a frontier.
        (&room(&[(1500.0, 400.0)]), last, false),
        (&narrow, last, false),
    ] {
        let (mut explorer, status) = explorer();
        explorer.goal = Goal::Look(last);
        explorer.choose(grid, &status);
        assert_eq!(matches!(explorer.goal, Goal::Pass(_)), passes, "{last:?}");
        if passes {
            let end = explorer.driver.follower.as_ref().and_then(Follower::end);
            let end = end.expect("a way");
            assert!(
                end.x_mm > 950.0 && (end.y_mm - 1500.0).abs() < 60.0,
                "{end:?}"
            );
            assert_eq!(explorer.chosen, Some((Kind::Gap, status.time_s)));
        }
    }
    let (mut passed, status) = looked_through(&narrow, 1500.0);
    passed.goal = Goal::Look(last);
    passed.choose(&narrow, &status);
    assert!(matches!(passed.goal, Goal::Pass(_)));
    // Not for ever, and not from afar.
    for (tries, from, passes) in [(5, 1000.0, true), (6, 1000.0, false), (0, 300.0, false)] {
        let (mut explorer, mut status) = explorer();
        status.estimate.pose.y_mm = from;
        explorer.tries = vec![last; tries];
        explorer.goal = Goal::Look(last);
        explorer.choose(&grid, &status);
        assert_eq!(matches!(explorer.goal, Goal::Pass(_)), passes, "{tries}");
    }
}

#[test]
fn gaps_are_left_when_the_time_for_them_is_spent() {
    let grid = room(&[(1500.0, 225.0)]);
    let (mut explorer, mut status) = explorer();
    let mut choose = |kind, spent_s: f64| {
        explorer.chosen = Some((kind, status.time_s));
        status.time_s += spent_s;
        explorer.choose(&grid, &status);
        (matches!(explorer.goal, Goal::Approach(_)), explorer.gaps_s)
    };
    assert_eq!(choose(Kind::Gap, 60.0), (true, 60.0));
    assert_eq!(choose(Kind::Gap, 50.0), (false, 110.0));
    assert_eq!(choose(Kind::Frontier, 40.0), (true, 70.0));
    assert_eq!(choose(Kind::Surface, 100.0), (true, 0.0));
    // The way there takes longer.
    assert_eq!(choose(Kind::Gap, 88.0), (false, 88.0));
}

#[test]
fn gaps_of_any_width_are_looked_at_on_one_way() {
    let grid = room(&[(500.0, 150.0), (1500.0, 275.0)]);
    for at_mm in [500.0, 1500.0] {
        let (mut explorer, mut status) = explorer();
        status.estimate.pose.y_mm = at_mm;
        explorer.choose(&grid, &status);
        // The wide one is none of the narrow ones, too.
        assert_eq!(explorer.targets(), 2);
        let near = |target: Target| (target.centre.y_mm - at_mm).abs() < 100.0;
        assert!(matches!(explorer.goal, Goal::Approach(found) if near(found)));
    }
}

#[test]
fn gap_is_passed_along_two_lines_side_by_side() {
    let grid = room(&[(1500.0, 225.0)]);
    let gap = target(Kind::Gap, 1050.0, 1500.0);
    for (rows, passed) in [
        (&[0][..], false),
        (&[0, 1], true),
        (&[0, -1], true),
        (&[0, 2], false),
        (&[1, 2], false),
    ] {
        let mut map = CostMap::new(&grid, 0.0, &[], (&[], 100.0));
        let middle = map.index(gap.centre).expect("on the map");
        for &row in rows {
            for column in 0..8 {
                let up = row * map.columns.cast_signed() - column;
                map.nodes[middle.strict_add_signed(up)].seen[0] = true;
            }
        }
        let reach = Reach::new(&map, &Pose2::new(500.0, 1500.0, 0.0), 120.0);
        assert_eq!(is_passed(&reach, &gap), passed, "{rows:?}");
    }
}

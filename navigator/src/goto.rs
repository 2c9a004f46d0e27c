//! Goes to a point of a known map.

use geometry::Point;
use mapper::{Cell, Grid};

use crate::driver::{Driver, Step};
use crate::manoeuvre::Kind;
use crate::planner::Reach;
use crate::{Action, Config, Outcome, Status, Velocity};

/// The reachable node taken for the target is at most this far from it, mm.
const NEAR_MM: f64 = 100.0;
/// Plans made before the target is given up, unless they bring the robot nearer by so much, mm.
const PLANS: u32 = 6;
const NEARER_MM: f64 = 500.0;
/// A way that is blocked is waited for so often, s each.
const WAITS: (u32, f64) = (12, 5.0);

/// Drives to a point, planning on the map.
#[derive(Clone, Debug)]
pub struct GoTo {
    driver: Driver,
    target: Point,
    /// The plan is under way.
    follows: bool,
    plans: u32,
    /// Plans at which it gives up, and waits so far; as of the last time that it came nearer, to this, mm.
    most_plans: u32,
    waits: u32,
    nearest_mm: f64,
}

impl GoTo {
    /// A way to `target`, in the frame of the grid.
    pub fn new(config: Config, target: Point) -> Self {
        Self {
            driver: Driver::new(config),
            target,
            follows: false,
            plans: 0,
            most_plans: PLANS,
            waits: 0,
            nearest_mm: f64::INFINITY,
        }
    }

    /// Whether the map shows free floor at the target: without any, no way leads there from anywhere.
    pub fn has_floor(grid: &Grid, target: Point) -> bool {
        grid.cells().any(|(column, row)| {
            let away_mm = grid.middle(column, row).distance_mm(target);
            grid.cell(column, row) == Cell::Free && away_mm <= NEAR_MM
        })
    }

    /// Takes a frame: the map and the robot's report.
    pub fn step(&mut self, grid: &Grid, status: &Status) -> Action {
        match self.driver.step(grid, status) {
            Step::Act(action) => return action,
            Step::Arrived if self.follows => return Action::Done(Outcome::Complete),
            Step::Arrived | Step::Interrupted => {}
        }
        let left_mm = self.target.distance_mm(status.estimate.pose.position());
        if left_mm < self.nearest_mm - NEARER_MM {
            (self.most_plans, self.waits) = (self.plans + PLANS, 0);
            self.nearest_mm = left_mm;
        }
        if self.plans == self.most_plans {
            return Action::Done(Outcome::Unreachable);
        }
        if self.plan(grid, status) {
            self.plans += 1;
            return Action::Drive(Velocity::default());
        }
        // What is not in the map may go, and so may what came into it since there was a way.
        let had_a_way = self.plans > 0;
        self.driver.forget_marks();
        if self.waits == WAITS.0 || !(had_a_way || self.plan(grid, status)) {
            return Action::Done(Outcome::Unreachable);
        }
        self.waits += 1;
        (self.follows, self.driver.follower) = (false, None);
        self.driver.enqueue([Kind::Rest(WAITS.1)]);
        Action::Drive(Velocity::default())
    }

    /// Sets out to the target, if a way leads there.
    fn plan(&mut self, grid: &Grid, status: &Status) -> bool {
        let pose = status.estimate.pose;
        let map = self.driver.survey(grid, status.time_s);
        let reach = Reach::new(&map, &pose, self.driver.config.inflation_mm());
        let node = reach.nearest(self.target, NEAR_MM);
        if let Some(node) = node {
            self.driver.follow(&reach, node, status.time_s);
            self.follows = true;
        }
        node.is_some()
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::StopReason;
    use crate::cost_map::tests::draw;
    use crate::manoeuvre::tests::status;
    use geometry::Pose2;

    /// Steps towards a target on open floor of 2 m by 0.8 m.
    fn steps(target: Point) -> impl FnMut(f64, f64, Option<StopReason>) -> Action {
        let grid = draw(&["...................."; 8]);
        let config = Config {
            sweep_half_width_rad: 1.0,
            ..Config::default()
        };
        let mut plan = GoTo::new(config, target);
        move |time_s, x_mm, stop| {
            let report = status(time_s, Pose2::new(x_mm, 400.0, 0.0));
            plan.step(&grid, &Status { stop, ..report })
        }
    }

    #[test]
    fn gap_is_a_way_for_a_body_that_it_is_wide_enough_for() {
        let (wall, floor) = ("........##........", "..................");
        let grid = draw(&[wall, wall, floor, floor, floor, wall, wall]);
        for (body_mm, (x_mm, y_mm), is_open) in [
            (100.0, (1500.0, 350.0), true),
            (150.0, (1500.0, 350.0), false),
            // In the wall.
            (100.0, (900.0, 100.0), false),
        ] {
            let config = Config {
                body_mm,
                ..Config::default()
            };
            let mut plan = GoTo::new(config, Point::new(x_mm, y_mm));
            let at = Pose2::new(400.0, 350.0, 0.0);
            let [_, planned] = [0.0, 2.0].map(|time_s| plan.step(&grid, &status(time_s, at)));
            let is_refused = planned == Action::Done(Outcome::Unreachable);
            let found = (is_at_rest(planned), is_refused);
            assert_eq!(found, (is_open, !is_open), "{body_mm}: {planned:?}");
        }
    }

    fn is_at_rest(action: Action) -> bool {
        matches!(action, Action::Drive(velocity) if velocity.forward_mm_s.abs() < 1e-9)
    }

    #[test]
    fn floor_is_at_most_a_tenth_of_a_metre_from_the_target() {
        let grid = draw(&["...#"]);
        for (x_mm, expected) in [(-90.0, false), (-80.0, true), (380.0, true), (400.0, false)] {
            let target = Point::new(x_mm, 50.0);
            assert_eq!(GoTo::has_floor(&grid, target), expected, "{x_mm}");
        }
    }

    #[test]
    fn target_is_planned_to_and_reached() {
        let mut step = steps(Point::new(1500.0, 400.0));
        assert!(is_at_rest(step(0.0, 300.0, None)), "for the gyro");
        assert!(is_at_rest(step(2.0, 300.0, None)));
        let moves = (0..400).any(|nth| {
            let action = step(2.0 + 0.025 * f64::from(nth), 300.0, None);
            matches!(action, Action::Drive(velocity) if velocity.forward_mm_s > 10.0)
        });
        assert!(moves);
        let x_mm = |nth: i32| 300.0 + 2.0 * f64::from(nth);
        let done = (0..700).position(|nth| {
            let action = step(12.0 + 0.025 * f64::from(nth), x_mm(nth), None);
            action == Action::Done(Outcome::Complete)
        });
        let end_mm = x_mm(i32::try_from(done.expect("an end")).unwrap());
        assert!((1450.0..1550.0).contains(&end_mm), "{end_mm}");
    }

    #[test]
    fn blocked_way_is_waited_for() {
        let (open, closed) = (["...................."; 8], ["..........#........."; 8]);
        for (gone_s, expected) in [(50.0, None), (150.0, Some(Outcome::Unreachable))] {
            let mut plan = GoTo::new(Config::default(), Point::new(1500.0, 400.0));
            let mut ended = None;
            for second in 0..100 {
                let report = status(f64::from(second), Pose2::new(700.0, 400.0, 0.0));
                let stands = (4.0..gone_s).contains(&report.time_s);
                let grid = draw(if stands { &closed } else { &open });
                if let Action::Done(outcome) = plan.step(&grid, &report) {
                    ended = Some(outcome);
                }
            }
            assert_eq!(ended, expected, "{gone_s}");
            assert_eq!(plan.follows, ended.is_none());
        }
    }

    #[test]
    fn mark_that_closes_the_way_is_tried_again() {
        let mut plan = GoTo::new(Config::default(), Point::new(1500.0, 400.0));
        let closed = (0..17).map(|nth| (0.0, Point::new(1000.0, 50.0 * f64::from(nth))));
        plan.driver.marks.extend(closed);
        let grid = draw(&["...................."; 8]);
        for (time_s, follows) in [(0.0, false), (2.0, false), (2.1, false), (7.2, true)] {
            let report = status(time_s, Pose2::new(700.0, 400.0, 0.0));
            let action = plan.step(&grid, &report);
            assert!(matches!(action, Action::Drive(_)));
            assert_eq!(plan.follows, follows, "{time_s}");
        }
    }

    #[test]
    fn driven_way_that_something_has_closed_is_left_for_another() {
        // Two doors, the robot below and the target above; it came through the left one.
        let (wall, floor) = ("#....##########....##", ".....................");
        let grid = draw(&[floor, floor, floor, floor, wall, floor, floor, floor, floor]);
        for stopped in [false, true] {
            let mut plan = GoTo::new(Config::default(), Point::new(300.0, 750.0));
            let way = (2..15).map(|nth| Point::new(300.0, 50.0 * f64::from(nth)));
            plan.driver.trail.points = way.collect();
            if stopped {
                // As wide as the door.
                let marks = (1..5).map(|nth| (0.0, Point::new(100.0 * f64::from(nth), 430.0)));
                plan.driver.marks = marks.collect();
            }
            let at = Pose2::new(300.0, 200.0, 0.0);
            assert!(plan.plan(&grid, &status(1.0, at)));
            let way = plan.driver.follower.as_ref().expect("a way");
            let farthest = (0..90).filter_map(|nth| way.ahead(50.0 * f64::from(nth)));
            let farthest_mm = farthest.map(|at| at.x_mm).fold(0.0, f64::max);
            assert_eq!(farthest_mm > 1500.0, stopped, "{farthest_mm}");
        }
    }

    #[test]
    fn target_is_given_up_without_a_way_or_after_six_plans() {
        let mut step = steps(Point::new(1500.0, 2000.0));
        step(0.0, 300.0, None);
        let action = step(2.0, 300.0, None);
        assert_eq!(action, Action::Done(Outcome::Unreachable));

        // Each stop is elsewhere, and the mark of the last one forgotten.
        let mut step = steps(Point::new(1500.0, 400.0));
        step(0.0, 900.0, None);
        for nth in 0..PLANS {
            let time_s = 2.0 + 401.0 * f64::from(nth);
            let x_mm = 900.0 - 110.0 * f64::from(nth);
            for rested_s in [0.0, 2.0] {
                assert!(is_at_rest(step(time_s + rested_s, x_mm, None)), "{nth}");
            }
            let slipped = step(time_s + 2.1, x_mm, Some(StopReason::Slip));
            assert_eq!(slipped, Action::Resume);
        }
        step(3000.0, 300.0, None);
        let action = step(3002.0, 300.0, None);
        assert_eq!(action, Action::Done(Outcome::Unreachable));
    }

    #[test]
    fn plans_are_counted_from_where_they_brought_the_robot_nearer() {
        let grid = draw(&["...................."; 8]);
        for (nearer_mm, plans) in [(99.0, PLANS), (101.0, 5 + PLANS)] {
            let config = Config {
                rest_s: 0.0,
                ..Config::default()
            };
            let mut plan = GoTo::new(config, Point::new(1500.0, 400.0));
            let given_up = (0..20).find(|&nth| {
                let x_mm = 300.0 + nearer_mm * f64::from(nth.min(5));
                (plan.follows, plan.driver.follower) = (false, None);
                let report = status(f64::from(nth), Pose2::new(x_mm, 400.0, 0.0));
                plan.step(&grid, &report) == Action::Done(Outcome::Unreachable)
            });
            assert_eq!(given_up, Some(plans), "{nearer_mm}");
        }
    }
}

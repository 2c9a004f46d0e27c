//! The navigator in a closed loop with the robot without firmware, with the true pose, and
//! with the localiser.
#![allow(
    clippy::cast_precision_loss,
    clippy::cast_possible_truncation,
    clippy::cast_sign_loss
)]

mod closed_loop;
mod ideal_map;

use closed_loop::{drive, explore, localiser, Run};
use geometry::Point;
use ideal_map::IdealMapper;
use mapper::Grid;
use navigator::{Config, GoTo, Outcome, Status, StopReason};
use plant::Room;

fn explore_ideally(room: &Room, seed: u64, stop: impl FnMut(f64) -> Option<StopReason>) -> Run {
    let mut mapping = IdealMapper::new(Grid::new(25.0));
    explore(room, seed, Config::default(), &mut mapping, stop)
}

#[test]
fn default_room_is_explored_by_estimated_pose() {
    let room = Room::two_rooms();
    let run = explore(&room, 105, Config::default(), &mut localiser(), |_| None);
    let (median_mm, worst_mm, heading_deg) = run.errors();
    assert_eq!(
        (run.outcome, run.collisions.len()),
        (Some(Outcome::Complete), 0)
    );
    assert!(
        run.coverage > 0.95 && run.iou > 0.75,
        "{} {}",
        run.coverage,
        run.iou
    );
    assert!(
        median_mm < 60.0 && worst_mm < 200.0,
        "{median_mm} {worst_mm}"
    );
    assert!(
        heading_deg < 5.0 && run.minutes < 15.0,
        "{heading_deg} {}",
        run.minutes
    );
}

#[test]
fn default_room_is_explored_and_robot_comes_home() {
    let run = explore_ideally(&Room::two_rooms(), 101, |_| None);
    assert_eq!(run.outcome, Some(Outcome::Complete));
    assert_eq!(run.collisions, []);
    assert!(
        run.coverage > 0.99 && run.iou > 0.95,
        "{} {}",
        run.coverage,
        run.iou
    );
    assert!(
        run.minutes < 12.0 && run.path_mm > 20_000.0,
        "{}",
        run.minutes
    );
    assert!(run.end.x_mm.hypot(run.end.y_mm) < 80.0, "{:?}", run.end);
    let turned = run.end.turn_to_rad(&geometry::Pose2::default());
    assert!(turned.abs() < 0.1, "{turned}");
}

#[test]
fn stops_of_every_kind_are_cleared_and_exploring_completes() {
    let reasons = [
        StopReason::Stall,
        StopReason::Link,
        StopReason::Slip,
        StopReason::Obstacle,
    ];
    let (mut count, mut latched) = (0, None);
    let run = explore_ideally(&Room::two_rooms(), 102, |time_s| {
        if time_s > 35.0 * f64::from(count + 1) {
            latched = Some(reasons[count as usize % 4]);
            count += 1;
            return latched;
        }
        // Latched for a frame more: the resume is on its way.
        latched.take()
    });
    assert_eq!(run.outcome, Some(Outcome::Complete));
    assert_eq!((run.collisions.len(), run.resumed), (0, 2 * count));
    assert!(
        count > 12 && run.coverage > 0.97,
        "{count} {}",
        run.coverage
    );
}

#[test]
fn goal_on_known_map_is_reached_and_goal_in_wall_is_refused() {
    let room = Room::two_rooms();
    let map = explore_ideally(&room, 103, |_| None).grid;
    for (x_mm, y_mm, outcome) in [
        (4900.0, 2100.0, Outcome::Complete),
        (5400.0, 3300.0, Outcome::Unreachable),
    ] {
        let mut goto = GoTo::new(Config::default(), Point::new(x_mm, y_mm));
        let navigate = |grid: &Grid, status: &Status| goto.step(grid, status);
        let run = drive(
            &room,
            104,
            navigate,
            &mut IdealMapper::new(map.clone()),
            |_| None,
        );
        assert_eq!((run.outcome, run.collisions.len()), (Some(outcome), 0));
        let left_mm = run.end.position().distance_mm(Point::new(x_mm, y_mm));
        assert!(
            outcome == Outcome::Unreachable || left_mm < 60.0,
            "{left_mm}"
        );
    }
}

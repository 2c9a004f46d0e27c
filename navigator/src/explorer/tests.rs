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
        let queue = explorer.driver.queue.iter().map(|motion| motion.kind);
        assert_eq!(queue.collect::<Vec<_>>(), expected);
    }
}

#[test]
fn widest_gaps_are_looked_at_first_and_each_twice() {
    let grid = room(&[(500.0, 150.0), (1500.0, 275.0)]);
    let (mut explorer, status) = explorer();
    let chosen = |explorer: &mut Explorer| {
        explorer.choose(&grid, &status);
        match explorer.goal {
            Goal::Approach(target) => {
                assert_eq!(target.kind, Kind::Gap);
                explorer.tries.push(target.centre);
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
}

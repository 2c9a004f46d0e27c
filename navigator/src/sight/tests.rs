use super::*;
use crate::cost_map::tests::draw;
use crate::manoeuvre::tests::status;

#[test]
fn echo_is_remembered_until_map_or_later_echo_explains_it() {
    let (empty, wall) = (
        draw(&["....."; 5]),
        draw(&["....#", "....#", "....#", "....#", "....#"]),
    );
    let sensor = Pose2::new(0.0, 250.0, 0.0);
    let mut sight = Sight::default();
    assert!(!sight.see_near(&sensor, 450.0, 700.0, &wall));
    assert!(sight.see_near(&sensor, 350.0, 700.0, &empty));
    assert_eq!(sight.unexplained().count(), 5);
    assert!(sight.see_near(&sensor, 300.0, 700.0, &empty));
    assert_eq!(sight.unexplained().count(), 10, "both are possible");
    // Beyond the axis' middle part, the places stay possible.
    assert!(!sight.see_near(&sensor, 900.0, 700.0, &empty));
    assert_eq!(sight.unexplained().count(), 4);
    sight.forget_unexplained();
    assert_eq!(sight.unexplained().count(), 0);
}

#[test]
fn echo_counts_once_and_is_forgotten_by_way_and_turns() {
    let (grid, config) = (draw(&["....."; 5]), Config::default());
    let mut sight = Sight::default();
    let mut observe = |x_mm, heading_rad, range_mm, bearing_rad| {
        let mut status = status(0.0, Pose2::new(x_mm, 0.0, heading_rad));
        status.ranges_mm[0] = range_mm;
        status.front_bearing_rad = bearing_rad;
        sight.observe(&status, &config, &grid, 0.0);
        (
            sight.unexplained().count(),
            sight.contact(&status.estimate.pose, 100.0),
        )
    };
    // Of the swept front sensor, 1 rad to the left.
    let (places, contact) = observe(0.0, 0.0, Some(300.0), 1.0);
    assert_eq!((places, contact), (5, None));
    // The same value is the same measurement, wherever the sensor points now.
    assert_eq!(observe(10.0, 0.0, Some(300.0), 0.0), (5, None));
    let (places, contact) = observe(10.0, 0.0, Some(301.0), 0.0);
    assert!(places == 10 && contact.is_some());
    // 200 mm and a radian are 600 mm of way; silence explains nothing.
    assert_eq!(observe(-190.0, 1.0, None, 0.0).0, 10);
    assert_eq!(observe(-190.0, 1.235, None, 0.0).0, 5);
    assert_eq!(observe(-190.0, 1.3, None, 0.0).0, 0);
    assert_eq!(observe(10.0, 0.0, None, 0.0), (0, None));
}

#[test]
fn way_is_blocked_by_echoes_before_the_body_alone() {
    let (grid, robot) = (draw(&["....."; 5]), Pose2::new(200.0, 200.0, 1.0));
    for (ahead_mm, left_mm, blocked) in [
        (200.0, 0.0, [true; 2]),
        (200.0, 110.0, [true; 2]),
        (200.0, -110.0, [true; 2]),
        (200.0, 150.0, [false, true]),
        (200.0, -150.0, [false, true]),
        (300.0, 0.0, [false, true]),
        (-100.0, 0.0, [false; 2]),
    ] {
        let Point { x_mm, y_mm } = robot.point_at(ahead_mm - 40.0, left_mm);
        let mut sight = Sight::default();
        assert!(sight.see_near(&Pose2::new(x_mm, y_mm, 1.0), 40.0, 700.0, &grid));
        let found = [100.0, 150.0].map(|body_mm| sight.is_blocked(&robot, body_mm));
        assert_eq!(found, blocked, "{ahead_mm} {left_mm}");
    }
}

#[test]
fn slanted_walls_are_seen_half_way_between_the_walls_directions() {
    let (grid, config) = (draw(&["....."; 5]), Config::default());
    let directions = [
        (0.3, false),
        (0.5, false),
        (0.7, true),
        (-0.9, true),
        (1.2, false),
    ];
    for (heading_rad, looks) in directions {
        let mut sight = Sight::default();
        let status = status(0.0, Pose2::new(100.0, 100.0, heading_rad));
        sight.observe(&status, &config, &grid, 0.0);
        let aside = Point::new(500.0, 100.0);
        assert_eq!(sight.is_slant_seen(aside), looks, "{heading_rad}");
    }
}

// Requirement: NAV-contact-1
#[test]
fn contact_of_close_echo_is_where_body_touches_it() {
    let grid = draw(&["....."; 5]);
    let mut sight = Sight::default();
    let robot = Pose2::new(200.0, 200.0, 0.0);
    let ahead = |bearing_rad| Pose2::new(280.0, 200.0, bearing_rad);
    sight.see_near(&ahead(1.0), 150.0, 700.0, &grid);
    let [narrow, wide] = [100.0, 150.0].map(|body_mm| sight.contact(&robot, body_mm));
    assert!(narrow.is_none() && wide.is_some(), "passes beside it");
    sight.see_near(&ahead(-0.6), 150.0, 700.0, &grid);
    let (way_mm, point) = sight.contact(&robot, 100.0).unwrap();
    let touching = robot.point_at(way_mm, 0.0);
    assert!((touching.distance_mm(point) - 110.0).abs() < 1e-6);
    assert!((50.0..200.0).contains(&way_mm), "{way_mm}");
    sight.see_near(&ahead(0.0), 340.0, 700.0, &grid);
    let nearest = sight.contact(&robot, 100.0);
    assert_eq!(nearest, Some((way_mm, point)));
    // A later reading through the place refutes it, one beside its axis does not: the echo may have come from there.
    for bearing_rad in [-0.5, -0.7] {
        sight.see_near(&ahead(bearing_rad), 600.0, 700.0, &grid);
        assert_eq!(sight.contact(&robot, 100.0), nearest);
    }
    sight.see_near(&ahead(-0.6), 600.0, 700.0, &grid);
    let left = sight.contact(&robot, 100.0);
    assert!(left.is_some_and(|(mm, _)| mm > 300.0));
}

#[test]
fn floor_counts_as_seen_through_along_walls_alone() {
    let (along, across, none) = ([true, false], [false, true], [false; 2]);
    for (heading_rad, seen) in [
        (0.1, along),
        (3.0, along),
        (0.35, none),
        (0.8, none),
        (-1.5, across),
    ] {
        let mut sight = Sight::default();
        let sensor = Pose2::new(0.0, 0.0, heading_rad);
        sight.see_floor(&sensor, Some(500.0), 0.0);
        assert_eq!(sight.seen_through(sensor.point_at(400.0, 0.0)), seen);
        assert_eq!(sight.seen_through(sensor.point_at(600.0, 0.0)), none);
    }
}

#[test]
fn silence_is_a_measurement_of_its_own_after_a_while() {
    let (grid, config) = (draw(&["....."; 5]), Config::default());
    let mut sight = Sight::default();
    let mut is_seen = |time_s, y_mm: f64| {
        let status = status(time_s, Pose2::new(0.0, y_mm, 0.0));
        sight.observe(&status, &config, &grid, 0.0);
        // The sensor is 80 mm ahead.
        sight.seen_through(Point::new(820.0, y_mm))[0]
    };
    assert!(is_seen(1.0, 0.0) && !is_seen(1.05, 300.0) && is_seen(1.061, 600.0));
}

#[test]
fn silent_front_sensor_shortens_the_reach_of_a_look() {
    let (grid, config) = (draw(&["....."; 5]), Config::default());
    let mut sight = Sight::default();
    for (x_mm, ranges_mm, reach_mm) in [
        (0.0, [None; 3], 500.0),
        (99.0, [None, Some(300.0), None], 500.0),
        (110.0, [None, Some(300.0), Some(310.0)], 250.0),
        (120.0, [Some(900.0), None, None], 500.0),
        (210.0, [None; 3], 500.0),
        (230.0, [None; 3], 250.0),
    ] {
        let report = status(x_mm, Pose2::new(x_mm, 0.0, 0.0));
        sight.observe(
            &Status {
                ranges_mm,
                ..report
            },
            &config,
            &grid,
            0.0,
        );
        assert!((sight.slant_reach_mm() - reach_mm).abs() < 1e-9, "{x_mm}");
    }
}

#[test]
fn near_surface_counts_as_seen_as_wide_as_the_beam() {
    let (grid, config) = (draw(&["....."; 5]), Config::default());
    for (range_mm, is_near) in [(850.0, true), (851.0, false)] {
        let mut sight = Sight::default();
        let mut report = status(0.0, Pose2::new(-80.0, 50.0, 0.0));
        report.ranges_mm[0] = Some(range_mm);
        sight.observe(&report, &config, &grid, 0.0);
        for (aside_mm, is_wide) in [
            (0.0, true),
            (220.0, true),
            (-220.0, true),
            (360.0, false),
            (-360.0, false),
        ] {
            let point = Point::new(850.0, 50.0 + aside_mm);
            assert_eq!(
                sight.is_seen_closely(point),
                is_near && is_wide,
                "{aside_mm}"
            );
        }
    }
}

#[test]
fn beam_sees_floor_as_wide_as_it_is() {
    let mut sight = Sight::default();
    sight.see_floor(&Pose2::new(0.0, 25.0, 0.0), None, 0.0);
    for (x_mm, aside_mm, seen) in [
        (400.0, 0.0, true),
        (400.0, 55.0, true),
        (400.0, -55.0, true),
        (400.0, 110.0, false),
        (400.0, -110.0, false),
        (780.0, 105.0, true),
        (840.0, 0.0, false),
    ] {
        let point = Point::new(x_mm, 25.0 + aside_mm);
        assert_eq!(sight.seen_through(point), [seen, false], "{point:?}");
    }
}

#[test]
fn echo_comes_from_its_arc_unless_the_map_has_a_cell_near() {
    let sensor = Pose2::new(0.0, 250.0, 0.0);
    // Within 40 mm and a tenth of the range of the arc at 400 mm.
    for (x_mm, y_mm, is_explained) in [
        (300.0, 250.0, false),
        (335.0, 250.0, true),
        (470.0, 250.0, true),
        (505.0, 250.0, false),
        // Beside the arc's ends.
        (388.0, 405.0, true),
        (388.0, 95.0, true),
        (388.0, 455.0, false),
        (388.0, 45.0, false),
    ] {
        let cell = Point::new(x_mm, y_mm);
        let grid = Grid::from_fn(25.0, Point::new(0.0, 0.0), Point::new(900.0, 500.0), |at| {
            f32::from(u8::from(at.distance_mm(cell) < 17.0)) * 4.0
        });
        let mut sight = Sight::default();
        let is_unexplained = sight.see_near(&sensor, 400.0, 700.0, &grid);
        assert_eq!(is_unexplained, !is_explained, "{cell:?}");
        let arc = [-0.24f64, -0.12, 0.0, 0.12, 0.24];
        let places: Vec<Point> = sight.unexplained().collect();
        assert_eq!(places.len(), if is_explained { 0 } else { 5 });
        for (place, off_rad) in places.iter().zip(arc) {
            let expected = sensor.point_at(400.0 * off_rad.cos(), 400.0 * off_rad.sin());
            assert!(place.distance_mm(expected) < 1e-6, "{place:?}");
        }
        // 40 mm more than the clearance.
        let at = |mm: f64| sensor.point_at(400.0 - mm, 0.0);
        assert_eq!(sight.doubts(at(159.0), 120.0), !is_explained);
        assert!(!sight.doubts(at(161.0), 120.0));
    }
}

#[test]
fn what_appears_to_one_sensor_appears() {
    let (grid, config) = (draw(&["....."; 5]), Config::default());
    for nth in 0..3 {
        let mut report = status(0.0, Pose2::new(200.0, 200.0, 0.0));
        report.ranges_mm[nth] = Some([650.0, 450.0, 450.0][nth]);
        assert!(
            Sight::default().observe(&report, &config, &grid, 0.0),
            "{nth}"
        );
    }
}

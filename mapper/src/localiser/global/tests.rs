//! Tests of the search.

use super::*;
use crate::localiser::surface::Kind;
use crate::{Localiser, LocaliserConfig};

#[test]
fn map_without_free_floor_gives_finite_uncertain_pose() {
    let localiser = Localiser::on_map(LocaliserConfig::default(), Grid::new(25.0), None);
    let estimate = localiser.estimate();
    assert!(!localiser.is_located());
    assert!(estimate.pose.x_mm.is_finite() && estimate.covariance[0][0] > 1e6);
}

#[test]
fn place_is_certain_after_six_searches_in_a_row() {
    let grid = Grid::new(25.0);
    let mut search = GlobalSearch::new(&SurfaceMap::from_grid(&grid), &grid);
    let mut find = |x_mm, count| {
        let frame = |x_mm| Pose2::new(x_mm, 0.0, 0.0);
        let agreed = (0..count).map(|_| search.is_agreed(Option::map(x_mm, frame)));
        agreed.filter(|agreed| *agreed).count()
    };
    for other in [Some(2000.0), None] {
        assert_eq!((find(Some(1000.0), 5), find(other, 1)), (0, 0));
    }
    assert_eq!(find(Some(1000.0), 6), 1);
}

#[test]
fn place_costs_what_it_does_not_explain() {
    let (low, high) = (Point::new(-500.0, -500.0), Point::new(1049.0, 500.0));
    let wall = |at: Point| if at.x_mm > 1000.0 { 4.0 } else { -4.0 };
    let grid = Grid::from_fn(25.0, low, high, wall);
    let (map, config) = (SurfaceMap::from_grid(&grid), MatcherConfig::default());
    let (half_angle_rad, incidence_rad) = (0.26, 0.5);
    let beam = Beam {
        half_angle_rad,
        incidence_rad,
    };
    let cost = |phantoms: usize, way_mm| {
        let see = |nth| Element {
            sensor: Pose2::new(0.0, f64::from(nth), 0.0),
            range_mm: if nth < 10 { 1025.0 } else { 400.0 },
            kind: Kind::Wall,
            towards_rad: 0.0,
            spread_rad: 0.03,
        };
        let seen: Vec<Element> = (0..20).map(see).take(10 + phantoms).collect();
        let (start, way) = (Pose2::default(), [Pose2::new(way_mm, 0.0, 0.0)]);
        let place = refine(&seen, &way, &start, (&map, &grid), (&beam, &config));
        place.unwrap().cost
    };
    assert!(cost(0, 0.0) < 0.5 && cost(10, 0.0) > 4.4 && cost(0, 1030.0) > 0.8);
}

#[test]
fn best_place_is_taken_if_good_and_others_are_clearly_worse() {
    for (cost, other, is_found) in [
        (2.6, (1000.0, 9.0), true),
        (2.8, (1000.0, 9.0), false),
        (0.1, (1000.0, 2.6), false),
        (0.1, (1000.0, 2.8), true),
        (2.0, (1000.0, 3.9), false),
        (1.0, (200.0, 1.1), true),
    ] {
        let places = [(0.0, cost), other].map(|(x_mm, cost)| Place {
            mean: Vector3::new(x_mm, 0.0, 0.0),
            covariance: Matrix3::identity(),
            cost,
        });
        assert_eq!(distinct(&places).is_some(), is_found, "{cost} {other:?}");
    }
}

#[test]
fn spread_covers_all_places_by_their_weight() {
    let at = |x_mm, off_rad| Pose2::new(x_mm, 0.0, geometry::wrap_angle(PI + off_rad));
    let (near, far) = (at(0.0, -0.05), at(2000.0, 0.05));
    let (mean, covariance) = spread(&[(near, 5.0), (far, 5.0), (at(9e3, 0.0), 900.0)], 1.0);
    assert!((mean[0] - 1000.0).abs() < 1e-6 && (covariance[(0, 0)].sqrt() - 1000.0).abs() < 2.0);
    assert!(geometry::wrap_angle(mean[2] - PI).abs() < 1e-9 && covariance[(2, 2)] < 0.01);
    // A coarse pose alone stands for half the spacing around it.
    let alone = spread(&[(near, 5.0)], 1.0).1;
    assert!((alone[(0, 0)] - 2500.0).abs() < 1e-6 && (alone[(2, 2)] - 0.002).abs() < 1e-9);
}

#[test]
fn way_that_fits_nowhere_is_forgotten() {
    let (grid, config, here) = (Grid::new(25.0), MatcherConfig::default(), Pose2::default());
    let (half_angle_rad, incidence_rad) = (0.26, 0.5);
    let beam = Beam {
        half_angle_rad,
        incidence_rad,
    };
    let map = SurfaceMap::from_grid(&grid);
    let mut search = GlobalSearch::new(&map, &grid);
    search.advance((vec![], vec![here]), &here, (&map, &grid), (&beam, &config));
    assert!(search.stretches.is_empty());
}

//! The mapper on the modelled robot's default tour.
#![allow(clippy::cast_precision_loss, clippy::cast_possible_truncation)] // a drive's few numbers

mod drive;

use mapper::{Cell, Config, Mapper, Point, Pose2, map_iou};
use plant::{Params, RangefinderParams, Room};

// Requirement: DOC-1-2
#[test]
fn map_of_default_room_matches_its_walls() {
    let drive = drive::tour(&Room::two_rooms(), Params::default(), 1);
    assert_eq!(drive.world.collisions(), []);
    assert!(drive.world.path_mm() > 25_000.0);
    let agreement = map_iou(drive.mapper.grid(), &drive.walls, 100.0);
    assert!(agreement.iou > 0.9, "{agreement:?}");
    let counters = drive.mapper.counters();
    assert!(
        counters.echoes > 1000 && counters.outliers > 0,
        "{counters:?}"
    );
    let (estimate, truth) = (drive.estimate.last(), drive.truth.last());
    assert!(estimate.unwrap().distance_mm(truth.unwrap()) < 5.0);
}

#[test]
fn scanned_range_is_entered_along_its_bearing_once() {
    let mut mapper = Mapper::new(Config::default());
    for nth in 0..40 {
        let range_mm = [900.0, 901.0][nth / 2 % 2];
        let left = std::f64::consts::FRAC_PI_2;
        mapper.observe_scan(&Pose2::default(), 0, left, Some(range_mm));
    }
    let counters = mapper.counters();
    assert_eq!((counters.ignored, counters.echoes), (20, 19));
    let at = Point::new(80.0, 900.0);
    assert_eq!(mapper.grid().cell_at(at), Cell::Occupied);
}

// Requirement: DOC-2.2-4
#[test]
fn map_with_five_percent_outliers_stays_usable() {
    let rangefinder = RangefinderParams {
        outlier: 0.05,
        noise_mm: 3.0,
        ..Default::default()
    };
    let params = Params {
        rangefinder,
        ..Default::default()
    };
    let drive = drive::tour(&Room::two_rooms(), params, 2);
    let agreement = map_iou(drive.mapper.grid(), &drive.walls, 100.0);
    assert!(agreement.iou > 0.85, "{agreement:?}");
    assert!(
        drive.mapper.counters().outliers > 150,
        "{:?}",
        drive.mapper.counters()
    );
}

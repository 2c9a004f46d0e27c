//! The mapper on the modelled robot's default tour.
#![allow(clippy::cast_precision_loss, clippy::cast_possible_truncation)] // a drive's few numbers

mod drive;

use mapper::map_iou;
use plant::{Params, RangefinderParams, Room};

// Requirement: DOC-1-2
#[test]
fn the_default_rooms_map_agrees_with_its_walls() {
    let drive = drive::tour(&Room::two_rooms(), Params::default(), 1);
    assert_eq!(
        drive.world.collisions(),
        0,
        "{:?}",
        drive.world.first_collision()
    );
    assert!(drive.world.path_mm() > 25_000.0);
    let agreement = map_iou(drive.mapper.grid(), &drive.walls, 100.0);
    assert!(agreement.iou > 0.9, "{agreement:?}");
    let counters = drive.mapper.counters();
    assert!(counters.echoes > 1000 && counters.alone > 0, "{counters:?}");
    let last = |path: &[mapper::Pose]| path.last().copied().unwrap();
    let (believed, truth) = (last(&drive.believed), last(&drive.truth));
    assert!((believed.x_mm - truth.x_mm).hypot(believed.y_mm - truth.y_mm) < 5.0);
}

// Requirement: DOC-2.2-4
#[test]
fn wild_readings_one_in_twenty_leave_the_map_usable() {
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
        drive.mapper.counters().alone > 150,
        "{:?}",
        drive.mapper.counters()
    );
}

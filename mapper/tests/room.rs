//! The mapper on the default tour of a robot with exact wheels.

mod tour;

use mapper::{Cell, Config, LocaliserConfig, MapScore, Mapper, Point, Pose2, map_iou};
use plant::{Imperfections, Rng, Room};
use tour::Drive;

/// The map of a drive with this share of wrong readings, and how well it matches the walls.
fn mapped(wrong: f64) -> (Mapper, MapScore) {
    let (room, config) = (Room::two_rooms(), LocaliserConfig::default());
    let mut drive = Drive::new(&room, Imperfections::none(), 1, config);
    drive.tour(&room, 0, room.tour.len(), 3000.0);
    assert_eq!(drive.robot.collisions(), []);
    assert!(drive.robot.path_mm() > 25_000.0);
    let (mut mapper, mut rng) = (Mapper::new(Config::default()), Rng::new(2));
    let mut before = [None; 3];
    for (pose, ranges) in drive.column(2).iter().zip(&drive.ranges_mm) {
        let mut given = *ranges;
        for (given, is_new) in given
            .iter_mut()
            .zip([0, 1, 2].map(|n| ranges[n] != before[n]))
        {
            let is_wrong = is_new && rng.unit() < wrong;
            *given = if is_wrong {
                Some(2500.0 * rng.unit())
            } else {
                *given
            };
        }
        before = *ranges;
        mapper.observe(pose, &given);
    }
    let walls = room.relative_to_start().visible_surfaces();
    let score = map_iou(mapper.grid(), &walls, 100.0);
    (mapper, score)
}

// Requirement: DOC-1-2
#[test]
fn map_of_default_room_matches_its_walls() {
    let (mapper, agreement) = mapped(0.0);
    assert!(agreement.iou > 0.9, "{agreement:?}");
    let counters = mapper.counters();
    assert!(
        counters.echoes > 1000 && counters.outliers > 0,
        "{counters:?}"
    );
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
    let (mapper, agreement) = mapped(0.05);
    assert!(agreement.iou > 0.85, "{agreement:?}");
    assert!(mapper.counters().outliers > 150, "{:?}", mapper.counters());
}

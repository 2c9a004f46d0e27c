//! The localiser on drives through imperfect worlds.

mod tour;

use mapper::{Localiser, LocaliserConfig, Pose2};
use plant::{Imperfections, Room};
use tour::Drive;

/// A drive through the whole room.
fn mapped(room: &Room) -> Drive {
    let mut drive = Drive::new(
        room,
        Imperfections::default(),
        11,
        LocaliserConfig::default(),
    );
    drive.tour(room, 0.0, 3000.0);
    drive
}

/// A robot at the room's start that has the map of another drive and does not know where it is.
fn lost(first: &Drive, room: &Room, seed: u64) -> Drive {
    let config = LocaliserConfig::default();
    let map = first.localiser.grid().clone();
    let mut drive = Drive::new(room, Imperfections::default(), seed, config.clone());
    drive.localiser = Localiser::on_map(config, map, None);
    drive
}

// Requirement: NAV-pose-1
#[test]
fn default_room_is_mapped_within_error_bounds() {
    let room = Room::two_rooms();
    let drive = mapped(&room);
    let result = drive.result(&room);
    assert!(result.map.iou > 0.92, "{result:?}");
    assert!(
        result.median_mm < 20.0 && result.worst_mm < 40.0,
        "{result:?}"
    );
    assert!(result.heading_deg < 3.0, "{result:?}");
    assert!(result.raw_worst_mm > 3.0 * result.worst_mm, "{result:?}");
    // 3 for an exact covariance.
    assert!((0.3..8.0).contains(&result.nees), "{result:?}");
    assert!(result.minutes < 10.0, "{result:?}");
}

// Requirement: NAV-pose-2
#[test]
fn unknown_start_on_saved_map_is_found() {
    let room = Room::two_rooms();
    let first = mapped(&room);
    let frame = first.frame();
    for (seed, start) in [
        (12, Pose2::new(4600.0, 600.0, 2.0)),
        (15, Pose2::new(0.0, 900.0, 3.0)),
    ] {
        let room = Room {
            start,
            ..room.clone()
        };
        let mut second = lost(&first, &room, seed);
        // Somewhere on 20 m² of floor.
        let start_covariance = second.localiser.estimate().covariance;
        assert!(
            start_covariance[0][0].sqrt() > 1000.0,
            "{start_covariance:?}"
        );
        second.tour(&room, 0.0, 160.0);
        assert!(second.localiser.is_located(), "{seed}");
        for [estimate, truth, _] in &second.poses[second.search_frames..] {
            let off = frame.compose(estimate).distance_mm(&start.compose(truth));
            assert!(off < 150.0, "{seed}: {off} mm");
        }
    }
}

// Requirement: NAV-pose-2
#[test]
fn symmetric_room_gives_no_start() {
    let room = Room::default().with_box(&Pose2::new(1000.0, 500.0, 0.0), 3000.0, 2000.0);
    let first = mapped(&room);
    for (seed, start) in [
        (12, Pose2::new(2000.0, 1000.0, 2.0)),
        (13, Pose2::new(0.0, 500.0, 3.0)),
        (108, Pose2::new(111.7, -128.6, 1.391_02)),
    ] {
        let room = Room {
            start,
            ..room.clone()
        };
        let mut second = lost(&first, &room, seed);
        second.tour(&room, 0.0, 3000.0);
        assert!(!second.localiser.is_located(), "{seed}");
    }
}

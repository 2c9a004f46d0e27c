//! The localiser on drives through imperfect worlds.

mod tour;

use mapper::LocaliserConfig;
use plant::{Imperfections, Room};
use tour::Drive;

#[test]
fn default_room_is_mapped_within_error_bounds() {
    let room = Room::two_rooms();
    let mut drive = Drive::new(
        &room,
        Imperfections::default(),
        11,
        LocaliserConfig::default(),
    );
    drive.tour(&room, 0.0);
    let result = drive.result(&room);
    assert!(result.map.iou > 0.85, "{result:?}");
    assert!(
        result.median_mm < 40.0 && result.worst_mm < 120.0,
        "{result:?}"
    );
    assert!(result.heading_deg < 5.0, "{result:?}");
    assert!(result.raw_worst_mm > 3.0 * result.worst_mm, "{result:?}");
    // 3 for an exact covariance.
    assert!((0.3..12.0).contains(&result.nees), "{result:?}");
}

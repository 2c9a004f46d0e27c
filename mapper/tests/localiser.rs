//! The localiser on drives through imperfect worlds.

mod tour;

use mapper::evaluation::{best_alignment, in_estimate_frame, pose_errors};
use mapper::{Localiser, LocaliserConfig, MapScore, Observation, Pose2, Segment, map_iou};
use plant::{Imperfections, Rng, Room};
use tour::Drive;

/// The figures of a drive, map and poses compared after the best rigid alignment of the way.
#[derive(Clone, Copy, Debug)]
struct Figures {
    map: MapScore,
    median_mm: f64,
    worst_mm: f64,
    heading_deg: f64,
    raw_worst_mm: f64,
    nees: f64,
    minutes: f64,
}

impl Drive {
    /// The map's frame in that of the start, by the best rigid alignment of the way.
    fn frame(&self) -> Pose2 {
        best_alignment(&self.column(0), &self.column(1))
    }

    /// The room's visible surfaces in the map's frame, by the best rigid alignment of the way.
    fn walls(&self, room: &Room) -> Vec<Segment> {
        in_estimate_frame(&room.visible_surfaces(), &room.start.compose(&self.frame()))
    }

    #[allow(clippy::cast_precision_loss)]
    fn result(&self, room: &Room) -> Figures {
        let (estimate, truth, raw) = (self.column(0), self.column(1), self.column(2));
        let errors = pose_errors(&estimate, &truth, &self.frame());
        let raw_frame = best_alignment(&raw, &truth);
        Figures {
            map: map_iou(self.localiser.grid(), &self.walls(room), 100.0),
            median_mm: errors.position_mm_median,
            worst_mm: errors.position_mm_max,
            heading_deg: errors.heading_deg_max,
            raw_worst_mm: pose_errors(&raw, &truth, &raw_frame).position_mm_max,
            nees: self.nees.iter().sum::<f64>() / self.nees.len() as f64,
            minutes: self.robot.sample().time_s / 60.0,
        }
    }
}

/// A drive through the whole room.
fn mapped(room: &Room) -> Drive {
    let mut drive = Drive::new(
        room,
        Imperfections::default(),
        11,
        LocaliserConfig::default(),
    );
    drive.tour(room, 0, room.tour.len(), 3000.0);
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

// Requirement: DOC-1-2, NAV-pose-1
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

// Requirement: DOC-2.2-4
#[test]
fn map_with_five_percent_wrong_ranges_stays_usable() {
    let room = Room::two_rooms();
    let (mut drive, mut rng) = (mapped(&room), Rng::new(2));
    drive.localiser = Localiser::new(LocaliserConfig::default());
    let (mut before, mut given) = ([None; 3], [None; 3]);
    for (observation, poses) in drive.observations.iter().zip(&mut drive.poses) {
        let ranges_mm = observation.ranges_mm;
        for nth in (0..3).filter(|&nth| ranges_mm[nth] != before[nth]) {
            let is_wrong = rng.unit() < 0.05;
            given[nth] = if is_wrong {
                Some(2500.0 * rng.unit())
            } else {
                ranges_mm[nth]
            };
        }
        before = ranges_mm;
        drive.localiser.observe(&Observation {
            ranges_mm: given,
            ..*observation
        });
        poses[0] = drive.localiser.estimate().pose;
    }
    let result = drive.result(&room);
    assert!(result.map.iou > 0.85, "{result:?}");
}

// Requirement: NAV-pose-2
#[test]
fn unknown_start_on_saved_map_is_found() {
    let room = Room::two_rooms();
    let first = mapped(&room);
    let frame = first.frame();
    for (seed, start, goal) in [
        (12, Pose2::new(4600.0, 600.0, 2.0), 14),
        (15, Pose2::new(0.0, 900.0, 3.0), 5),
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
        second.tour(&room, goal, room.tour.len(), 160.0);
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
    let corners = [(0.0, 0.0), (2000.0, 0.0), (2000.0, 1000.0), (0.0, 1000.0)];
    let room = Room {
        tour: corners.map(|(x, y)| Pose2::new(x, y, 0.0)).into(),
        ..Room::default().with_box(&Pose2::new(1000.0, 500.0, 0.0), 3000.0, 2000.0)
    };
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
        second.tour(&room, 0, 20, 3000.0);
        assert!(!second.localiser.is_located(), "{seed}");
    }
}

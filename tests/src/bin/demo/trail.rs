//! Where the robot believed it was against where it was.

use host_link::pose::Place;
use twin::plant::Room;
use twin::Board;

/// Belief and truth, report by report.
pub struct Trail {
    start: twin::plant::Pose,
    pub believed: Vec<mapper::Pose>,
    pub true_path: Vec<mapper::Pose>,
    pub worst_mm: f64,
    pub worst_deg: f64,
    pub last_mm: f64,
    pub last_deg: f64,
}

impl Trail {
    pub fn new(board: &Board, room: &Room) -> Self {
        debug_assert!(
            board.truth().path_mm < 1.0,
            "the robot stands where it was put"
        );
        Self {
            start: room.start,
            believed: Vec::new(),
            true_path: Vec::new(),
            worst_mm: 0.0,
            worst_deg: 0.0,
            last_mm: 0.0,
            last_deg: 0.0,
        }
    }

    /// The reply of a frame that has just ended; the truth is that of the frame's end, so the age of
    /// the reply, up to one tick, counts as error.
    pub fn note(&mut self, board: &Board, believed: Place) {
        let truth = board.truth().pose.seen_from(&self.start);
        let truth = Place {
            x_mm: truth.x_mm,
            y_mm: truth.y_mm,
            rotation_deg: truth.heading_rad.to_degrees(),
        };
        self.last_mm = believed.distance_mm(truth);
        self.last_deg = believed.turn_to_deg(truth).abs();
        self.worst_mm = self.worst_mm.max(self.last_mm);
        self.worst_deg = self.worst_deg.max(self.last_deg);
        self.believed.push(mapped(believed));
        self.true_path.push(mapped(truth));
    }
}

fn mapped(place: Place) -> mapper::Pose {
    mapper::Pose::new(place.x_mm, place.y_mm, place.rotation_deg.to_radians())
}

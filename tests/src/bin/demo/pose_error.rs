//! The reported pose against the true one.

use host_link::pose::Pose;
use robot_tests::test_board::TIM5_CCR1;
use twin::plant::{Pose2, Room};
use twin::trace::EventKind;
use twin::Board;

/// Shortest time from a tick to the end of the frame that reports it, nanoseconds: the tick's own work
/// and the frame. A later tick is not in the reply yet.
const NEAREST_NS: u64 = 80_000;

/// Reported and true poses, and their differences.
pub struct PoseErrors {
    start: Pose2,
    pub estimate: Vec<Pose2>,
    pub true_path: Vec<Pose2>,
    pub worst_mm: f64,
    pub worst_deg: f64,
    pub last_mm: f64,
    pub last_deg: f64,
    /// The same at the frame's end: with what the robot moved since the reply's tick.
    pub late_mm: f64,
    pub late_deg: f64,
    /// When the robot's ticks were, the latest last.
    ticks: Vec<u64>,
}

impl PoseErrors {
    pub fn new(board: &Board, room: &Room) -> Self {
        debug_assert!(board.truth().path_mm < 1.0, "the robot is at its start");
        board.trace_writes(TIM5_CCR1);
        Self {
            start: room.start,
            estimate: Vec::new(),
            true_path: Vec::new(),
            worst_mm: 0.0,
            worst_deg: 0.0,
            last_mm: 0.0,
            last_deg: 0.0,
            late_mm: 0.0,
            late_deg: 0.0,
            ticks: Vec::new(),
        }
    }

    /// The reply of a frame that has just ended. Its pose is that of the tick before the frame; the
    /// truth of that instant is the truth now, rolled back by the wheels' speeds.
    pub fn record(&mut self, board: &Board, reported: Pose) {
        self.ticks.extend(
            board
                .take_events()
                .iter()
                .filter(|event| {
                    matches!(
                        event.kind,
                        EventKind::Write {
                            address: TIM5_CCR1,
                            ..
                        }
                    )
                })
                .map(|event| event.at_ns),
        );
        let now = board.truth();
        let recent = self.ticks.iter().rev().take(4);
        let age_ns = recent
            .map(|tick| now.at_ns - tick)
            .find(|age| *age >= NEAREST_NS)
            .unwrap_or(0);
        #[allow(clippy::cast_precision_loss)] // some ten milliseconds
        let back_s = -(age_ns as f64) / 1e9;
        let turned = now.wheel_deg_s.map(|speed| speed * back_s);
        let then = board.world(move |world| {
            let chassis = world.params().chassis;
            chassis.roll(&world.pose(), chassis.travel(turned))
        });
        let truth = self.place(&then);
        let late = self.place(&now.pose);
        self.last_mm = reported.distance_mm(truth);
        self.last_deg = reported.rotation_to_deg(truth).abs();
        self.worst_mm = self.worst_mm.max(self.last_mm);
        self.worst_deg = self.worst_deg.max(self.last_deg);
        self.late_mm = self.late_mm.max(reported.distance_mm(late));
        self.late_deg = self.late_deg.max(reported.rotation_to_deg(late).abs());
        self.estimate.push(mapped(reported));
        self.true_path.push(mapped(truth));
    }

    /// A true pose in the robot's own frame.
    fn place(&self, pose: &Pose2) -> Pose {
        let pose = pose.relative_to(&self.start);
        Pose::new(pose.x_mm, pose.y_mm, pose.heading_rad.to_degrees())
    }
}

fn mapped(place: Pose) -> Pose2 {
    Pose2::new(place.x_mm, place.y_mm, place.rotation_deg.to_radians())
}

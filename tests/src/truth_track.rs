//! The true poses at the ticks whose reports arrive.

use twin::plant::Pose2;
use twin::trace::EventKind;
use twin::Board;

use crate::test_board::TIM5_CCR1;

/// Shortest time from a tick to the end of the frame that reports it, nanoseconds: the tick's own work
/// and the frame. A later tick is not in the reply yet.
const NEAREST_NS: u64 = 80_000;

/// Looks up the truth for every report.
pub struct TruthTrack {
    start: Pose2,
    /// When the robot's ticks were, the latest last.
    ticks: Vec<u64>,
}

impl TruthTrack {
    /// Poses are seen from where the robot stands now.
    pub fn new(board: &Board) -> Self {
        board.trace_writes(TIM5_CCR1);
        let start = board.truth().pose;
        let ticks = Vec::new();
        Self { start, ticks }
    }

    /// For the reply of a frame that has just ended: the true pose at the tick before the frame, that is
    /// the one of now, rolled back by the wheels' speeds; and the one of now.
    pub fn sample(&mut self, board: &Board) -> [Pose2; 2] {
        let events = board.take_events();
        let ticks = events.iter().filter(
            |event| matches!(event.kind, EventKind::Write { address, .. } if address == TIM5_CCR1),
        );
        self.ticks.extend(ticks.map(|event| event.at_ns));
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
        [then, now.pose].map(|pose| pose.relative_to(&self.start))
    }
}

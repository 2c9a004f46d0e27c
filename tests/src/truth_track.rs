//! The true poses at the ticks whose reports arrive.

use host_link::pose::Pose;
use twin::plant::Pose2;
use twin::trace::EventKind;
use twin::Board;

use crate::test_board::TIM5_CCR1;

/// Shortest time from a tick to the end of the frame that reports it, nanoseconds: the tick's own work
/// and the frame. A later tick is not in the reply yet.
const NEAREST_NS: u64 = 80_000;

/// Looks up the truth for every report.
pub struct TruthTrack {
    /// When the robot's ticks were, the latest last.
    ticks: Vec<u64>,
    /// The latest reported pose, and the true one at its tick.
    latest: Option<(Pose, Pose2)>,
}

impl TruthTrack {
    /// From now on.
    pub fn new(board: &Board) -> Self {
        board.trace_writes(TIM5_CCR1);
        let (ticks, latest) = (Vec::new(), None);
        Self { ticks, latest }
    }

    /// For the reply of a frame that has just ended: the true pose at the tick that the reported pose is
    /// of, and the one of now, in the room's frame. The tick is the one before the frame, its pose the one
    /// of now, rolled back by the wheels' speeds; a reply that repeats the one before, because the status
    /// changed after it was armed (docs/interfaces.md), is of the same tick.
    pub fn sample(&mut self, board: &Board, reported: Pose) -> [Pose2; 2] {
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
        let repeated = self.latest.filter(|(pose, _)| *pose == reported);
        let then = repeated.map_or(then, |(_, then)| then);
        self.latest = Some((reported, then));
        [then, now.pose]
    }
}

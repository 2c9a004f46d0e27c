//! The true poses at the ticks whose reports arrive.

use twin::Board;
use twin::plant::Pose2;

use crate::test_board::{TIM5_CCR1, take_writes};

/// Shortest time from a tick to the end of the frame that reports it, nanoseconds: the tick's own work
/// and the frame. A later tick is not in the reply yet.
const NEAREST_NS: u64 = 80_000;

/// Looks up the truth for every report.
pub struct TruthTrack {
    /// When the robot's ticks were, the latest last.
    ticks: Vec<u64>,
}

impl TruthTrack {
    /// From now on.
    pub fn new(board: &Board) -> Self {
        board.trace_writes(TIM5_CCR1);
        Self { ticks: Vec::new() }
    }

    /// For the reply of a frame that has just ended: the true pose at the last tick before the frame, whose
    /// data a guarded reply holds (docs/interfaces.md), and now, in the room's frame.
    pub fn sample(&mut self, board: &Board) -> [Pose2; 2] {
        let writes = take_writes(board).into_iter();
        let ticks = writes.filter(|write| write.address == TIM5_CCR1);
        self.ticks.extend(ticks.map(|tick| tick.at_ns));
        let now = board.truth();
        let mut ages_ns = self.ticks.iter().rev().map(|tick| now.at_ns - tick);
        let then = ages_ns.find(|age| *age >= NEAREST_NS).map(|age_ns| {
            let chassis = board.world(|world| world.params().chassis);
            #[allow(clippy::cast_precision_loss)] // some ten milliseconds
            let back_s = -(age_ns as f64) / 1e9;
            // Rolled back by the wheels' speeds.
            let turned = now.wheel_deg_s.map(|speed| speed * back_s);
            chassis.roll(&now.pose, chassis.travel(turned))
        });
        [then.unwrap_or(now.pose), now.pose]
    }
}

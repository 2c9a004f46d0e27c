//! The true poses at the ticks whose reports arrive.

use geometry::wrap_angle;
use host_link::pose::Pose;
use pilot::mapping::mapper_pose;
use twin::Board;
use twin::plant::Pose2;
use twin::trace::EventKind;

use crate::test_board::TIM5_CCR1;

/// Shortest time from a tick to the end of the frame that reports it, nanoseconds: the tick's own work
/// and the frame. A later tick is not in the reply yet.
const NEAREST_NS: u64 = 80_000;

/// Ticks that a reply may be of: those of two frames.
const TICKS: usize = 6;

/// Looks up the truth for every report.
pub struct TruthTrack {
    /// When the robot's ticks were, the latest last.
    ticks: Vec<u64>,
    /// The latest reported pose, and the true one at its tick.
    latest: Option<(Pose2, Pose2)>,
}

impl TruthTrack {
    /// From now on.
    pub fn new(board: &Board) -> Self {
        board.trace_writes(TIM5_CCR1);
        let (ticks, latest) = (Vec::new(), None);
        Self { ticks, latest }
    }

    /// For the reply of a frame that has just ended: the true pose at the tick that the reported pose is
    /// of, at the last tick before the frame, and now, in the room's frame. The first two are mostly the
    /// same; a reply that was not refreshed, because the status changed after it was armed
    /// (docs/interfaces.md), is of an earlier tick: the one since whose pose the robot moved most nearly as
    /// it reports.
    pub fn sample(&mut self, board: &Board, reported: Pose) -> [Pose2; 3] {
        let reported = mapper_pose(reported);
        let events = board.take_events();
        let ticks = events.iter().filter(
            |event| matches!(event.kind, EventKind::Write { address, .. } if address == TIM5_CCR1),
        );
        self.ticks.extend(ticks.map(|event| event.at_ns));
        let now = board.truth();
        let chassis = board.world(|world| world.params().chassis);
        let recent = self.ticks.iter().rev().take(TICKS);
        let ages_ns = recent.map(|tick| now.at_ns - tick);
        let mut then = ages_ns.filter(|age| *age >= NEAREST_NS).map(|age_ns| {
            #[allow(clippy::cast_precision_loss)] // some ten milliseconds
            let back_s = -(age_ns as f64) / 1e9;
            // Rolled back by the wheels' speeds.
            let turned = now.wheel_deg_s.map(|speed| speed * back_s);
            chassis.roll(&now.pose, chassis.travel(turned))
        });
        let mismatch = |then: &Pose2| {
            self.latest.map_or(0.0, |(reported_before, before)| {
                let [is, was] = [
                    reported.relative_to(&reported_before),
                    then.relative_to(&before),
                ];
                let turn = wrap_angle(is.heading_rad - was.heading_rad).abs();
                is.distance_mm(&was) + turn * chassis.track_mm / 2.0
            })
        };
        let last = then.next().unwrap_or(now.pose);
        let nearest = then.fold(last, |best, then| {
            if mismatch(&then) < mismatch(&best) {
                then
            } else {
                best
            }
        });
        self.latest = Some((reported, nearest));
        [nearest, last, now.pose]
    }
}

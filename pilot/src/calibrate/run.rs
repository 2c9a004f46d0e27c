//! The drives. They go from pose to pose as [`drive`](crate::drive) does, and end with the robot stopped
//! on every path; the path is recorded, and a robot that leaves it is stopped.

use super::wheel_geometry::WheelGeometry;
use super::wheel_path::WheelPath;
use crate::drive::{ArrivalCriteria, MAX_UNANSWERED, follow, resume_to_pose};
use crate::mapping::mapper_pose;
use host_link::error::Error;
use host_link::pose::Pose;
use host_link::session::Session;
use mapper::Segment;
use std::ops::RangeInclusive;

/// Largest reported distance from the straight line between two corners, millimetres.
const MAX_CROSS_TRACK_MM: f64 = 150.0;

/// Shortest and longest drive or side of a square, millimetres.
pub const LENGTHS_MM: RangeInclusive<f64> = 300.0..=5000.0;

/// A straight drive, seen from where the robot stands.
pub fn straight(length_mm: f64) -> Vec<Pose> {
    vec![Pose::new(length_mm, 0.0, 0.0)]
}

/// A square to the right (clockwise) or to the left, turning on the spot at its corners, and back to
/// the rotation of the start.
pub fn square(side_mm: f64, clockwise: bool) -> Vec<Pose> {
    let (l, s) = (side_mm, if clockwise { -1.0 } else { 1.0 });
    vec![
        Pose::new(l, 0.0, s * 90.0),
        Pose::new(l, s * l, 180.0),
        Pose::new(0.0, s * l, s * -90.0),
        Pose::new(0.0, 0.0, 0.0),
    ]
}

/// Drives `waypoints`, seen from where the robot stands, and returns the path. `reached` gets how many
/// of them are done.
///
/// # Errors
/// Those of [`crate::drive::go_to`];
/// [`Error::Silent`] after a fifth of a second without a valid reply; [`Error::Calibration`] if the
/// robot leaves its path. On each of them, and on a panic, it is stopped first.
pub fn run(
    session: &mut Session<'_>,
    waypoints: &[Pose],
    mut reached: impl FnMut(usize),
) -> Result<WheelPath, Error> {
    resume_to_pose(session)?;
    let start = session.snapshot().pose.unwrap_or_default();
    let mut path = WheelPath::new(WheelGeometry::from_config(session.config()));
    path.push(start);
    let criteria = ArrivalCriteria::default();
    let point = |pose: Pose| mapper_pose(pose).position();
    let mut from = start;
    for (index, there) in waypoints.iter().enumerate() {
        let target = there.in_frame_of(start);
        let leg = Segment::new(point(from), point(target));
        follow(session, target, &criteria, |session, report, _| {
            session.check_answered(MAX_UNANSWERED)?;
            let Some(pose) = report.and(session.snapshot().pose) else {
                return Ok(());
            };
            path.push(pose);
            let off = leg.distance_mm(point(pose));
            if off > MAX_CROSS_TRACK_MM {
                return Err(Error::Calibration(format!(
                    "the robot is {off:.0} mm beside its path; accepted are {MAX_CROSS_TRACK_MM:.0} mm"
                )));
            }
            Ok(())
        })?;
        from = target;
        reached(index + 1);
    }
    if !path.moved() {
        return Err(Error::Calibration("nothing moved".into()));
    }
    Ok(path)
}

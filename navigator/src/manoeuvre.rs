//! Motions without a path: rests, turns on the spot, short straight ways.

use geometry::Pose2;

use crate::follower::turn_rate;
use crate::{Config, Status, Velocity};

/// A turn has ended within this, radians.
const TURNED_RAD: f64 = 0.035;
/// No manoeuvre takes longer, s.
const LONGEST_S: f64 = 20.0;
/// A straight way ends this far before a front echo, mm.
const NEAR_MM: f64 = 230.0;
/// Fastest way back, mm/s: nothing looks there.
const BACK_MM_S: f64 = 45.0;

/// One motion.
#[derive(Clone, Copy, Debug, PartialEq)]
pub(crate) enum Kind {
    /// Stand for these seconds.
    Rest(f64),
    /// Turn on the spot until the net rotation is this, radians.
    Turn(f64),
    /// Drive these millimetres straight; negative is back.
    Straight(f64),
}

/// A motion under way.
#[derive(Clone, Copy, Debug)]
pub(crate) struct Manoeuvre {
    pub kind: Kind,
    began: Option<(f64, Pose2)>,
}

impl From<Kind> for Manoeuvre {
    fn from(kind: Kind) -> Self {
        Self { kind, began: None }
    }
}

impl Manoeuvre {
    /// The velocity for this frame; `None` when the motion has ended. `net_rad` is the robot's net
    /// rotation.
    pub fn step(&mut self, status: &Status, net_rad: f64, config: &Config) -> Option<Velocity> {
        let pose = status.estimate.pose;
        let (began_s, from) = *self.began.get_or_insert((status.time_s, pose));
        let elapsed_s = status.time_s - began_s;
        if elapsed_s > LONGEST_S {
            return None;
        }
        match self.kind {
            Kind::Rest(seconds) => (elapsed_s < seconds).then(Velocity::default),
            Kind::Turn(to_rad) => {
                let error = to_rad - net_rad;
                (error.abs() > TURNED_RAD).then(|| Velocity {
                    yaw_rate_rad_s: turn_rate(error, config.yaw_rate_rad_s),
                    ..Velocity::default()
                })
            }
            Kind::Straight(mm) => {
                let done = pose.relative_to(&from).x_mm;
                let near = status.range_ahead_mm().is_some_and(|range| range < NEAR_MM);
                let blocked = mm > 0.0 && (near || status.obstacle_limited && elapsed_s > 0.5);
                let left = (mm - done) * mm.signum();
                let fastest = if mm < 0.0 {
                    BACK_MM_S
                } else {
                    config.slow_mm_s
                };
                (left > 5.0 && !blocked).then(|| Velocity {
                    forward_mm_s: (2.0 * left).clamp(15.0, fastest).copysign(mm),
                    yaw_rate_rad_s: 1.5 * pose.turn_to_rad(&from).clamp(-0.2, 0.2),
                    ..Velocity::default()
                })
            }
        }
    }
}

#[cfg(test)]
pub(crate) mod tests {
    use super::*;
    use mapper::PoseEstimate;

    /// The report of a robot at `pose` that hears nothing.
    pub(crate) fn status(time_s: f64, pose: Pose2) -> Status {
        Status {
            time_s,
            estimate: PoseEstimate {
                pose,
                ..PoseEstimate::default()
            },
            speed_mm_s: 0.0,
            ranges_mm: [None; 3],
            front_bearing_rad: 0.0,
            obstacle_limited: false,
            stop: None,
        }
    }

    /// Forward speed and yaw rate of a motion that began at the origin at 0 s.
    fn velocity(kind: Kind, status: &Status, net_rad: f64) -> Option<(f64, f64)> {
        let (mut motion, config) = (Manoeuvre::from(kind), Config::default());
        motion.step(&self::status(0.0, Pose2::default()), 10.0, &config);
        let velocity = motion.step(status, net_rad, &config);
        velocity.map(|velocity| (velocity.forward_mm_s, velocity.yaw_rate_rad_s))
    }

    #[test]
    fn motion_ends_at_its_time_place_or_rotation() {
        let at = |x_mm, time_s| status(time_s, Pose2::new(x_mm, 0.0, 0.0));
        for (kind, status, net_rad, expected) in [
            (Kind::Rest(1.5), at(0.0, 1.4), 0.0, Some((0.0, 0.0))),
            (Kind::Rest(1.5), at(0.0, 1.5), 0.0, None),
            (Kind::Turn(7.0), at(0.0, 1.0), 6.9, Some((0.0, 0.35))),
            (Kind::Turn(7.0), at(0.0, 1.0), 9.0, Some((0.0, -1.2))),
            (Kind::Turn(7.0), at(0.0, 1.0), 6.97, None),
            (Kind::Turn(7.0), at(0.0, 20.5), 0.0, None),
            (Kind::Straight(300.0), at(0.0, 1.0), 0.0, Some((90.0, 0.0))),
            (
                Kind::Straight(300.0),
                at(270.0, 1.0),
                0.0,
                Some((60.0, 0.0)),
            ),
            (
                Kind::Straight(300.0),
                at(294.0, 1.0),
                0.0,
                Some((15.0, 0.0)),
            ),
            (Kind::Straight(300.0), at(296.0, 1.0), 0.0, None),
            (
                Kind::Straight(-100.0),
                at(0.0, 1.0),
                0.0,
                Some((-45.0, 0.0)),
            ),
            (Kind::Straight(-100.0), at(-96.0, 1.0), 0.0, None),
        ] {
            let found = velocity(kind, &status, net_rad);
            let near = |(a, b): ((f64, f64), (f64, f64))| (a.0 - b.0).abs() + (a.1 - b.1).abs();
            let same = found
                .zip(expected)
                .map_or(found == expected, |both| near(both) < 1e-9);
            assert!(same, "{kind:?}: {found:?} is not {expected:?}");
        }
    }

    #[test]
    fn straight_way_keeps_its_heading_and_ends_before_obstacles() {
        let (ahead, back) = (Kind::Straight(300.0), Kind::Straight(-300.0));
        let turned = status(1.0, Pose2::new(50.0, 0.0, 0.04));
        let (_, yaw) = velocity(ahead, &turned, 0.0).unwrap();
        assert!((yaw + 0.06).abs() < 1e-9, "{yaw}");
        let mut near = status(1.0, Pose2::default());
        near.ranges_mm = [Some(225.0), None, None];
        let mut limited = status(1.0, Pose2::default());
        limited.obstacle_limited = true;
        for status in [near, limited] {
            assert_eq!(velocity(ahead, &status, 0.0), None);
            assert!(velocity(back, &status, 0.0).is_some());
        }
        // A sweep hears what is aside.
        let mut aside = near;
        aside.front_bearing_rad = -0.3;
        near.ranges_mm = [Some(235.0), None, None];
        // It may only have begun to drive.
        limited.time_s = 0.4;
        for status in [near, aside, limited] {
            assert!(velocity(ahead, &status, 0.0).is_some());
        }
    }
}

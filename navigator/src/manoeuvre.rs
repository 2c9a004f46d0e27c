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
    kind: Kind,
    began: Option<(f64, Pose2)>,
}

impl From<Kind> for Manoeuvre {
    fn from(kind: Kind) -> Self {
        Self { kind, began: None }
    }
}

impl Manoeuvre {
    /// Whether it drives forward.
    pub fn is_forward(&self) -> bool {
        matches!(self.kind, Kind::Straight(mm) if mm > 0.0)
    }

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
                let near = status.ranges_mm[0].is_some_and(|range| range < NEAR_MM);
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

//! Follows a path by forward speed and yaw rate: regulated pure pursuit.

use geometry::{Point, Pose2, wrap_angle};

use crate::Velocity;

/// Look-ahead: seconds of way, and its limits, mm.
const LOOK_AHEAD: (f64, f64, f64) = (0.8, 90.0, 200.0);
/// A direction that differs by more than the first begins a turn on the spot, which ends below the
/// second. Radians.
const ON_THE_SPOT: (f64, f64) = (0.6, 0.15);
/// The path's end is reached within this, mm.
const ARRIVED_MM: f64 = 25.0;
/// Speed per distance to the end, 1/s.
const APPROACH: f64 = 2.0;
/// Yaw rate per heading error, 1/s, and the slowest turn, rad/s: below it friction wins.
const TURN: (f64, f64) = (3.5, 0.15);

/// Yaw rate that turns by `error_rad` on the spot, rad/s.
pub(crate) fn turn_rate(error_rad: f64, fastest_rad_s: f64) -> f64 {
    (TURN.0 * error_rad.abs())
        .clamp(TURN.1, fastest_rad_s)
        .copysign(error_rad)
}

/// A path and how far it was followed.
#[derive(Clone, Debug)]
pub(crate) struct Follower {
    path: Vec<Point>,
    /// Corners behind the robot.
    leg: usize,
    /// Way along the leg, mm.
    along_mm: f64,
    turning: bool,
}

impl Follower {
    /// Follows these corners from the first on.
    pub const fn new(path: Vec<Point>) -> Self {
        Self {
            path,
            leg: 0,
            along_mm: 0.0,
            turning: false,
        }
    }

    /// The path's last point.
    pub fn end(&self) -> Option<Point> {
        self.path.last().copied()
    }

    /// The point of the path `mm` after the place reached; its end at most.
    pub fn ahead(&self, mm: f64) -> Option<Point> {
        let mut left = self.along_mm + mm;
        for two in self.path.get(self.leg..)?.windows(2) {
            let length = two[0].distance_mm(two[1]);
            if left < length {
                return Some(two[0].lerp(two[1], left / length));
            }
            left -= length;
        }
        self.end()
    }

    /// Way to the end, mm.
    pub fn remaining_mm(&self) -> f64 {
        let legs = self.path.get(self.leg..).unwrap_or_default().windows(2);
        legs.map(|two| two[0].distance_mm(two[1])).sum::<f64>() - self.along_mm
    }

    /// Moves the place reached to the point of this leg or the next one nearest to `at`, but never
    /// back to an earlier leg.
    fn project(&mut self, at: Point) {
        let mut nearest = f64::INFINITY;
        for leg in self.leg..(self.leg + 2).min(self.path.len().saturating_sub(1)) {
            let (from, to) = (self.path[leg], self.path[leg + 1]);
            let (dx, dy) = (to.x_mm - from.x_mm, to.y_mm - from.y_mm);
            let length = libm::hypot(dx, dy).max(1e-9);
            let along = ((at.x_mm - from.x_mm) * dx + (at.y_mm - from.y_mm) * dy) / length;
            let along = along.clamp(0.0, length);
            let distance = from.lerp(to, along / length).distance_mm(at);
            if distance < nearest {
                (nearest, self.leg, self.along_mm) = (distance, leg, along);
            }
        }
    }

    /// The velocity from `pose`, at most this fast; `None` at the end. The look-ahead is shortened
    /// until the straight line to it is `clear`.
    pub fn step(
        &mut self,
        pose: &Pose2,
        fastest: (f64, f64),
        clear: impl Fn(Point, Point) -> bool,
    ) -> Option<Velocity> {
        let (fastest_mm_s, fastest_rad_s) = fastest;
        let at = pose.position();
        self.project(at);
        let end = self.end()?;
        let remaining = self.remaining_mm();
        if remaining < ARRIVED_MM || at.distance_mm(end) < ARRIVED_MM {
            return None;
        }
        let mut look_mm = (LOOK_AHEAD.0 * fastest_mm_s).clamp(LOOK_AHEAD.1, LOOK_AHEAD.2);
        let mut target = self.ahead(look_mm)?;
        while look_mm > 0.5 * LOOK_AHEAD.1 && !clear(at, target) {
            look_mm -= 20.0;
            target = self.ahead(look_mm)?;
        }
        let local = Pose2::at(target, 0.0).relative_to(pose).position();
        let error = wrap_angle(local.angle_rad());
        self.turning = error.abs()
            > if self.turning {
                ON_THE_SPOT.1
            } else {
                ON_THE_SPOT.0
            };
        let rate = turn_rate(error, fastest_rad_s);
        if self.turning {
            return Some(Velocity {
                yaw_rate_rad_s: rate,
                ..Velocity::default()
            });
        }
        // The arc through the target has the curvature 2·sin(error)/distance.
        let curvature = 2.0 * libm::sin(error) / local.length_mm().max(1.0);
        let by_turn = fastest_rad_s / curvature.abs().max(1e-9);
        let forward_mm_s = fastest_mm_s.min(by_turn).min(APPROACH * remaining);
        Some(Velocity {
            forward_mm_s,
            yaw_rate_rad_s: forward_mm_s * curvature,
            ..Velocity::default()
        })
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    fn points(path: &[(f64, f64)]) -> Vec<Point> {
        path.iter().map(|&(x, y)| Point::new(x, y)).collect()
    }

    /// Follows with an ideal robot; returns its way.
    fn follow(path: &[(f64, f64)], start: Pose2) -> Vec<Pose2> {
        let mut follower = Follower::new(points(path));
        let mut way = vec![start];
        while let Some(velocity) = follower.step(&way[way.len() - 1], (200.0, 1.0), |_, _| true) {
            let (along, turn) = (
                velocity.forward_mm_s * 0.025,
                velocity.yaw_rate_rad_s * 0.025,
            );
            assert!(velocity.yaw_rate_rad_s.abs() <= 1.0 + 1e-9);
            way.push(way[way.len() - 1].advance_arc(
                along - turn * 50.0,
                along + turn * 50.0,
                100.0,
            ));
            assert!(way.len() < 4000, "no arrival");
        }
        way
    }

    #[test]
    fn follower_reaches_end_of_each_shape() {
        for path in [
            &[(0.0, 0.0), (1000.0, 0.0)][..],
            &[(0.0, 0.0), (600.0, 0.0), (600.0, 600.0)],
            &[(0.0, 0.0), (300.0, 0.0), (300.0, 100.0), (0.0, 100.0)],
            &[(0.0, 0.0), (-500.0, 0.0)],
            &[(80.0, 50.0), (80.0, 400.0)],
        ] {
            let (x, y) = path[path.len() - 1];
            let way = follow(path, Pose2::default());
            let end = way[way.len() - 1].position();
            assert!(
                end.distance_mm(Point::new(x, y)) <= ARRIVED_MM + 10.0,
                "{path:?}: {end:?}"
            );
        }
    }

    #[test]
    fn follower_stays_within_look_ahead_of_path() {
        let path = [(0.0, 0.0), (800.0, 0.0), (800.0, 800.0)];
        for pose in follow(&path, Pose2::default()) {
            let off = (pose.y_mm.abs()).min((pose.x_mm - 800.0).abs());
            assert!(off < 90.0, "{pose:?}");
        }
    }

    /// The velocity from `pose` along a path in free floor, at most 200 mm/s and this yaw rate.
    fn first_step(path: &[(f64, f64)], pose: Pose2, yaw_rate_rad_s: f64) -> Option<(f64, f64)> {
        let mut follower = Follower::new(points(path));
        let velocity = follower.step(&pose, (200.0, yaw_rate_rad_s), |_, _| true);
        velocity.map(|velocity| (velocity.forward_mm_s, velocity.yaw_rate_rad_s))
    }

    #[test]
    fn follower_drives_arc_to_target_and_slows_before_end() {
        let is = |found: Option<(f64, f64)>, (forward, yaw): (f64, f64)| {
            let found = found.unwrap();
            let near = (found.0 - forward).abs() < 1e-6 && (found.1 - yaw).abs() < 1e-6;
            assert!(near, "{found:?} is not {forward} and {yaw}");
        };
        // The target is 160 mm ahead and 30 mm to the left.
        let aside = Pose2::new(0.0, -30.0, 0.0);
        let curvature = 2.0 * 30.0 / (160.0 * 160.0 + 30.0 * 30.0);
        let long = [(0.0, 0.0), (1000.0, 0.0)];
        is(first_step(&long, aside, 1.0), (200.0, 200.0 * curvature));
        is(first_step(&long, aside, 0.3), (0.3 / curvature, 0.3));
        is(
            first_step(&long, Pose2::new(940.0, 0.0, 0.0), 1.0),
            (120.0, 0.0),
        );
        assert_eq!(first_step(&long, Pose2::new(976.0, 0.0, 0.0), 1.0), None);
        // The robot stands at the end of a way round.
        let round = [(0.0, 0.0), (60.0, 0.0), (0.0, 10.0)];
        assert_eq!(first_step(&round, Pose2::default(), 1.0), None);
        assert!((turn_rate(-0.01, 1.0) + 0.15).abs() < 1e-9);
    }

    #[test]
    fn follower_beyond_a_corner_is_on_the_next_leg() {
        let mut follower = Follower::new(points(&[(0.0, 0.0), (100.0, 0.0), (100.0, 500.0)]));
        follower.project(Point::new(150.0, 20.0));
        let ahead = follower.ahead(0.0).unwrap();
        assert!(
            ahead.distance_mm(Point::new(100.0, 20.0)) < 1e-9,
            "{ahead:?}"
        );
        assert!((follower.remaining_mm() - 480.0).abs() < 1e-9);
    }

    #[test]
    fn follower_blocked_view_shortens_look_ahead() {
        let mut follower = Follower::new(points(&[(0.0, 0.0), (100.0, 0.0), (100.0, 500.0)]));
        let seen = std::cell::RefCell::new(Vec::new());
        follower.step(&Pose2::default(), (200.0, 1.0), |_, to| {
            seen.borrow_mut().push(to);
            to.y_mm < 1.0
        });
        let last = *seen.borrow().last().unwrap();
        assert!(last.y_mm < 1.0 && last.x_mm > 40.0, "{last:?}");
    }

    #[test]
    fn follower_facing_away_turns_on_the_spot() {
        let mut follower = Follower::new(vec![Point::new(0.0, 0.0), Point::new(-500.0, 10.0)]);
        let velocity = follower
            .step(&Pose2::default(), (200.0, 1.0), |_, _| true)
            .unwrap();
        assert!(velocity.forward_mm_s.abs() < 1e-9 && velocity.yaw_rate_rad_s > 0.9);
    }
}

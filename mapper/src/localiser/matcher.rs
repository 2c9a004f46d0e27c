//! Correlative matching of a stretch's elements to the surface map.
//!
//! The likelihood is evaluated on a lattice of poses around the prediction, so that no local
//! minimum of a gradient method is taken for the answer, and the posterior's mean and covariance
//! are its moments. Readings of one stretch share their errors: the log-likelihood is divided by
//! [`MatcherConfig::temperature`]. After Olson, "Real-time correlative scan matching" (ICRA 2009).

use nalgebra::{Matrix3, Vector3};

use super::likelihood::{ASIDE, Problem};
use super::surface::{Beam, Element};
use super::surface_map::SurfaceMap;
use crate::Pose2;

/// How much a match weighs.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct MatcherConfig {
    /// What the log-likelihood is divided by: number of readings that share one error.
    pub temperature: f64,
    /// Deviation of a surface in the map, mm.
    pub surface_mm: f64,
    /// Share of a match's variance by which the map drifts from stretch to stretch.
    pub drift: f64,
    /// Fewest elements with a counterpart in the map.
    pub fewest: usize,
}

impl Default for MatcherConfig {
    fn default() -> Self {
        Self {
            temperature: 20.0,
            surface_mm: 8.0,
            drift: 0.1,
            fewest: 6,
        }
    }
}

/// The pose by prediction and match.
#[derive(Clone, Copy, Debug, PartialEq)]
pub(super) struct Match {
    pub mean: Vector3<f64>,
    pub covariance: Matrix3<f64>,
    /// Mean cost of the elements at the best pose, 0 (perfect) to the limit.
    pub cost: f64,
    /// Elements with a counterpart in the map.
    pub matched: usize,
}

/// Largest steps (mm, mm, rad) of the lattice that the moments are taken on.
const FINE: [f64; 3] = [6.0, 6.0, 0.004];

/// Matches `elements`, given in the robot's frame, around a predicted pose. `None` when too little
/// of the surroundings is known.
pub(super) fn find(
    map: &SurfaceMap,
    elements: &[Element],
    (prior, covariance): (&Pose2, &Matrix3<f64>),
    beam: &Beam,
    config: &MatcherConfig,
) -> Option<Match> {
    let prior_mean = Vector3::new(prior.x_mm, prior.y_mm, prior.heading_rad);
    // A pose known exactly, as the first, still gets a lattice.
    let covariance = covariance + Matrix3::from_diagonal(&Vector3::new(0.25, 0.25, 1e-7));
    let root = covariance.cholesky()?.l();
    let whiten = root.try_inverse()?;
    let deviation = |nth: usize| covariance[(nth, nth)].sqrt();
    let position = deviation(0).max(deviation(1));
    let inputs = (beam, config);
    let problem = Problem::new(map, elements, prior, [position, deviation(2)], inputs);
    if problem.candidates.len() < config.fewest {
        return None;
    }
    let steps = [0, 1, 2].map(|nth| 3.0 * deviation(nth) / f64::from(ASIDE));
    let mut middle = *prior;
    let mut lattice = steps;
    if (0..3).any(|nth| steps[nth] > FINE[nth]) {
        let mut lowest = (f64::INFINITY, *prior);
        problem.lattice(prior, steps, |at, cost| {
            let total = cost / config.temperature + (whiten * (at - prior_mean)).norm_squared();
            if total < lowest.0 {
                lowest = (total, Pose2::new(at[0], at[1], at[2]));
            }
        });
        middle = lowest.1;
        lattice = [0, 1, 2].map(|nth| f64::min(steps[nth], FINE[nth]));
    }
    // In units in which the prior's covariance is the identity.
    let mut points = Vec::with_capacity(2200);
    problem.lattice(&middle, lattice, |at, cost| {
        let at = whiten * (at - prior_mean);
        points.push((at, at.norm_squared(), cost / config.temperature));
    });
    // The lattice ends somewhere: what the match adds is the difference of the moments with and
    // without it, both cut off in the same way.
    let (with, with_covariance) = moments(points.iter().map(|(at, p, cost)| (at, p + cost)));
    let (without, without_covariance) = moments(points.iter().map(|(at, p, _)| (at, *p)));
    let (with, without) = (
        (with_covariance.try_inverse()?, with),
        (without_covariance.try_inverse()?, without),
    );
    let pull = with.0 * with.1 - without.0 * without.1;
    let added = (with.0 - without.0).symmetric_eigen();
    let map_covariance = whiten * problem.map_covariance(map, prior) * whiten.transpose();
    let (mut mean, mut covariance) = (Vector3::zeros(), Matrix3::zeros());
    for (nth, &information) in added.eigenvalues.iter().enumerate() {
        let axis = added.eigenvectors.column(nth);
        let mut variance = 1.0;
        if information > 0.0 {
            variance = 1.0 / (1.0 + information);
            mean += axis * axis.dot(&pull) * variance;
            // The pose is never known better than the part of the map it was found by.
            let of_map = (axis.transpose() * map_covariance * axis)[0] + config.drift / information;
            variance = variance.max(of_map.min(1.0));
        }
        covariance += axis * axis.transpose() * variance;
    }
    let smallest = points
        .iter()
        .map(|(_, _, cost)| *cost)
        .fold(f64::INFINITY, f64::min);
    let count = f64::from(u32::try_from(problem.candidates.len()).unwrap_or(1));
    Some(Match {
        mean: root * mean + prior_mean,
        covariance: root * covariance * root.transpose(),
        cost: smallest * config.temperature / count,
        matched: problem.candidates.len(),
    })
}

/// Mean and covariance over points with costs.
fn moments<'a>(
    points: impl Iterator<Item = (&'a Vector3<f64>, f64)> + Clone,
) -> (Vector3<f64>, Matrix3<f64>) {
    let lowest = points
        .clone()
        .map(|(_, cost)| cost)
        .fold(f64::INFINITY, f64::min);
    let (mut weight, mut mean, mut square) = (0.0, Vector3::zeros(), Matrix3::zeros());
    for (at, cost) in points {
        let share = libm::exp(-0.5 * (cost - lowest));
        weight += share;
        mean += at * share;
        square += at * at.transpose() * share;
    }
    mean /= weight;
    (mean, square / weight - mean * mean.transpose())
}

#[cfg(test)]
mod tests {
    use super::super::likelihood::LIMIT;
    use super::super::surface::Kind;
    use super::*;
    use crate::Point;
    use std::f64::consts::PI;

    const BEAM: Beam = Beam {
        half_angle_rad: std::f64::consts::PI / 12.0,
        incidence_rad: std::f64::consts::FRAC_PI_6,
    };
    const CONFIG: MatcherConfig = MatcherConfig {
        temperature: 2.0,
        surface_mm: 8.0,
        drift: 0.0,
        fewest: 6,
    };

    /// Walls at x = 1000 and, if it is a corner, y = 800, seen by a robot that knew its pose up to
    /// `map_deviation`.
    fn surroundings(corner: bool, map_deviation: f64) -> SurfaceMap {
        let mut map = SurfaceMap::default();
        map.begin(
            &Pose2::default(),
            Matrix3::from_diagonal(&Vector3::new(1.0, 1.0, 0.0)) * map_deviation.powi(2),
        );
        for step in -20..20 {
            let along = 40.0 * f64::from(step);
            map.insert(Point::new(1000.0, along), 0.0, Kind::Wall);
            if corner {
                map.insert(Point::new(along, 800.0), PI / 2.0, Kind::Wall);
            }
        }
        map
    }

    /// What a robot at `pose` sees of them.
    fn elements(corner: bool, pose: &Pose2) -> Vec<Element> {
        let see = |off: f64, towards: f64, range_mm: f64| {
            let sensor = Pose2::new(off * towards.sin(), off * towards.cos(), towards);
            let seen = Element {
                sensor: Pose2::new(pose.x_mm + sensor.x_mm, pose.y_mm + sensor.y_mm, towards),
                range_mm,
                kind: Kind::Wall,
                towards_rad: towards,
                spread_rad: 0.03,
            };
            seen.moved(&Pose2::default().relative_to(pose))
        };
        let mut seen = Vec::new();
        for step in -15..15 {
            let off = 12.0 * f64::from(step);
            seen.push(see(off, 0.0, 1000.0 - pose.x_mm));
            if corner {
                seen.push(see(off, PI / 2.0, 800.0 - pose.y_mm));
            }
        }
        seen
    }

    fn prior_covariance() -> Matrix3<f64> {
        Matrix3::from_diagonal(&Vector3::new(900.0, 900.0, 0.0009))
    }

    fn matched(corner: bool, map_deviation: f64, drift: f64) -> Match {
        let map = surroundings(corner, map_deviation);
        let seen = elements(corner, &Pose2::new(30.0, -20.0, 0.03));
        let prior = (&Pose2::default(), &prior_covariance());
        let config = MatcherConfig { drift, ..CONFIG };
        find(&map, &seen, prior, &BEAM, &config).unwrap()
    }

    #[test]
    fn corner_fixes_pose_from_displaced_prediction() {
        let found = matched(true, 0.0, 0.0);
        let off = found.mean - Vector3::new(30.0, -20.0, 0.03);
        assert!(
            off[0].abs() < 6.0 && off[1].abs() < 6.0 && off[2].abs() < 0.008,
            "{found:?}"
        );
        assert!(
            found.covariance[(0, 0)] < 90.0 && found.cost < 1.0,
            "{found:?}"
        );
    }

    #[test]
    fn single_wall_leaves_direction_along_it_open() {
        let found = matched(false, 0.0, 0.0);
        assert!(
            (found.mean[0] - 30.0).abs() < 6.0 && found.mean[1].abs() < 6.0,
            "{found:?}"
        );
        assert!(found.covariance[(0, 0)] < 90.0, "{found:?}");
        assert!(
            (800.0..=901.0).contains(&found.covariance[(1, 1)]),
            "{found:?}"
        );
    }

    #[test]
    fn pose_is_never_better_known_than_map() {
        let (exact, vague) = (matched(true, 0.0, 0.0), matched(true, 15.0, 0.0));
        assert!((exact.mean - vague.mean).norm() < 1e-9);
        assert!(exact.covariance[(0, 0)] < 100.0);
        let variance = vague.covariance[(0, 0)];
        assert!((200.0..260.0).contains(&variance), "{vague:?}");
        let drifting = matched(true, 15.0, 10.0).covariance[(0, 0)];
        assert!(drifting > variance + 5.0, "{drifting}");
        // What knows less than the prior takes nothing from it.
        let worse = matched(true, 60.0, 0.0).covariance;
        let prior = prior_covariance()[(0, 0)];
        assert!(worse[(0, 0)] < 1.01 * prior, "{worse}");
    }

    #[test]
    fn elements_that_contradict_each_other_cost_half_the_limit() {
        let mut seen = elements(true, &Pose2::default());
        for (nth, element) in seen.iter_mut().enumerate() {
            element.range_mm += [-60.0, 0.0, 60.0][nth / 2 % 3];
        }
        let prior = (&Pose2::default(), &prior_covariance());
        let found = find(&surroundings(true, 0.0), &seen, prior, &BEAM, &CONFIG);
        assert!(found.unwrap().cost > 0.5 * LIMIT);
    }

    #[test]
    fn unknown_surroundings_give_no_match() {
        let map = surroundings(true, 0.0);
        let far = Pose2::new(-4000.0, 0.0, 0.0);
        let seen = elements(true, &Pose2::default());
        let prior = (&far, &prior_covariance());
        assert_eq!(find(&map, &seen, prior, &BEAM, &CONFIG), None);
        let prior = (&Pose2::default(), &prior_covariance());
        let by = |count: usize| find(&map, &seen[..count], prior, &BEAM, &CONFIG);
        assert!(by(5).is_none() && by(6).is_some());
    }
}

//! Likelihood of poses: how well a stretch's elements fall on known surfaces.

use std::f64::consts::PI;

use geometry::wrap_angle;
use nalgebra::{Matrix3, Vector3};

use super::MatcherConfig;
use super::surface::{Beam, Element, Kind, range_deviation_mm};
use super::surface_map::{SurfaceMap, Surfel};
use crate::Pose2;

/// Largest cost of an element: an outlier.
pub(super) const LIMIT: f64 = 9.0;
/// Half the number of lattice points per axis.
pub(super) const ASIDE: i32 = 5;
/// A surfel answers for its surroundings up to this distance along the surface, mm …
const ALONG_MM: f64 = 60.0;
/// … and beyond with this deviation.
const BEYOND_MM: f64 = 25.0;
/// Error of the map's normals, rad.
const FACING_RAD: f64 = 0.08;
/// Surfels that an element is compared with.
const PARTNERS: usize = 3;

/// An element and a surfel, for one heading: `cost = fixed + (n·t + c)²/σ² + …` for a translation t.
struct Pair {
    normal: (f64, f64),
    across: f64,
    along: f64,
    fixed: f64,
}

impl Pair {
    fn new(element: &Element, surfel: &Surfel, pose: &Pose2, beam: &Beam) -> Self {
        let element = element.moved(pose);
        let towards = if surfel.edge {
            (surfel.point - element.sensor.position()).angle_rad()
        } else {
            surfel.facing_rad + PI
        };
        let point = element.point_towards(beam, towards);
        let (sin, cos) = libm::sincos(towards);
        let (dx, dy) = (
            point.x_mm - surfel.point.x_mm,
            point.y_mm - surfel.point.y_mm,
        );
        let spread = libm::hypot(element.spread_rad, FACING_RAD);
        let off = wrap_angle(towards - element.towards_rad) / spread;
        Self {
            normal: (cos, sin),
            across: cos * dx + sin * dy,
            along: cos * dy - sin * dx,
            fixed: off * off,
        }
    }

    fn cost(&self, x: f64, y: f64, variance: f64) -> f64 {
        let (cos, sin) = self.normal;
        let across = self.across + cos * x + sin * y;
        let along = (self.along + cos * y - sin * x).abs();
        let beyond = (along - ALONG_MM).max(0.0) / BEYOND_MM;
        let z = self.fixed + across * across / variance + beyond * beyond;
        z / (1.0 + z / LIMIT)
    }
}

/// The elements with their possible partners, around one pose.
pub(super) struct Problem<'a> {
    beam: &'a Beam,
    pub candidates: Vec<(&'a Element, f64, Vec<&'a Surfel>)>,
}

impl<'a> Problem<'a> {
    pub fn new(
        map: &'a SurfaceMap,
        elements: &'a [Element],
        prior: &Pose2,
        deviations: [f64; 2],
        (beam, config): (&'a Beam, &MatcherConfig),
    ) -> Self {
        let candidates = elements.iter().filter_map(|element| {
            let point = element.moved(prior).point(beam);
            let aside = 2.5 * libm::hypot(deviations[0], deviations[1] * element.range_mm);
            let reach = ALONG_MM + aside + if element.has_bearing() { 0.0 } else { 60.0 };
            let range_deviation = range_deviation_mm(element.range_mm);
            let variance = config.surface_mm.powi(2) + range_deviation * range_deviation;
            let wide = variance + deviations[0] * deviations[0];
            let mut partners: Vec<(f64, &Surfel)> = map
                .near(point, reach)
                .filter(|s| element.kind != Kind::Wall || !s.edge)
                .map(|s| (Pair::new(element, s, prior, beam).cost(0.0, 0.0, wide), s))
                .filter(|(cost, _)| *cost < 0.7 * LIMIT)
                .collect();
            partners.sort_by(|a, b| a.0.total_cmp(&b.0));
            partners.truncate(PARTNERS);
            let partners: Vec<&Surfel> = partners.into_iter().map(|(_, s)| s).collect();
            (!partners.is_empty()).then_some((element, variance, partners))
        });
        Self {
            beam,
            candidates: candidates.collect(),
        }
    }

    /// Covariance of a pose near `at` due to the error of the surfels it is matched to.
    pub fn map_covariance(&self, map: &SurfaceMap, at: &Pose2) -> Matrix3<f64> {
        let (mut sum, mut count) = (Matrix3::zeros(), 0.0);
        for (_, _, partners) in &self.candidates {
            sum += map.record(partners[0]).covariance_at(at);
            count += 1.0;
        }
        sum / count
    }

    /// Pairs of every element for poses with this heading, as seen from `at`.
    fn pairs(&self, at: &Pose2) -> Vec<(f64, Vec<Pair>)> {
        let pair = |element: &Element, surfel: &Surfel| Pair::new(element, surfel, at, self.beam);
        self.candidates
            .iter()
            .map(|(element, variance, partners)| {
                (
                    *variance,
                    partners.iter().map(|s| pair(element, s)).collect(),
                )
            })
            .collect()
    }

    /// The sum of all costs on the lattice of [`ASIDE`] steps around `middle`.
    pub fn lattice(
        &self,
        middle: &Pose2,
        steps: [f64; 3],
        mut visit: impl FnMut(Vector3<f64>, f64),
    ) {
        // Between lattice points no sharp optimum may hide.
        let blur = (0.6 * steps[0]).powi(2);
        for turn in -ASIDE..=ASIDE {
            let heading_rad = middle.heading_rad + f64::from(turn) * steps[2];
            let pairs = self.pairs(&Pose2 {
                heading_rad,
                ..*middle
            });
            for column in -ASIDE..=ASIDE {
                for row in -ASIDE..=ASIDE {
                    let (x, y) = (f64::from(column) * steps[0], f64::from(row) * steps[1]);
                    let cost = pairs
                        .iter()
                        .map(|(variance, partners)| {
                            let costs = partners.iter().map(|p| p.cost(x, y, variance + blur));
                            costs.fold(LIMIT, f64::min)
                        })
                        .sum::<f64>();
                    visit(
                        Vector3::new(middle.x_mm + x, middle.y_mm + y, heading_rad),
                        cost,
                    );
                }
            }
        }
    }
}

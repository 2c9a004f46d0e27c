//! The search for the robot on a saved map, from an unknown start.
//!
//! While the robot drives, its elements and its way are kept in the dead reckoning's frame. At the
//! end of every stretch all poses on free floor are scored by them, coarsely; the best ones are
//! refined by the matcher. The robot is located when one of them explains nearly everything and
//! all that are clearly elsewhere do not, search after search: what is left unexplained at the
//! best place shows how wrong map and way are, and a place that is worse by no more than that may
//! be the right one. A map's errors are not symmetric where the room is: as long as two places
//! explain nearly everything, neither is taken.

use std::f64::consts::{PI, TAU};

use nalgebra::{Matrix3, Vector3};

use super::likelihood::LIMIT;
use super::matcher::{self, MatcherConfig};
use super::surface::{Beam, Element};
use super::surface_map::{SurfaceMap, Surfel};
use crate::{Cell, Grid, Point, Pose2};

/// Way that is remembered, in stretches: the dead reckoning's error stays small within.
const STRETCHES: usize = 16;
/// Fewest elements for a decision.
const FEWEST: usize = 150;
/// Fewest points of the way, 25 mm apart.
const FEWEST_OF_WAY: usize = 80;
/// Elements and points of the way that are scored coarsely.
const SAMPLES: usize = 60;
/// Points of the way that are not on free floor rule a pose out.
const BLOCKED: usize = 8;
/// Headings of the coarse poses per turn.
const HEADINGS: u32 = 72;
/// Coarse poses that are refined, and deviations of their error (mm, rad).
const REFINED: usize = 24;
const COARSE: (f64, f64) = (60.0, 0.05);
/// Coarse poses kept, the best: all of 140 m² of free floor, 32 MB.
const MOST: usize = 1_000_000;
/// Poses nearer than this (mm, rad) are the same place.
const SAME: (f64, f64) = (250.0, 0.25);
/// Mean cost of the elements at the right place, at most.
const GOOD: f64 = 0.3 * LIMIT;
/// Mean cost at all other places, at least, besides [`GOOD`]: a multiple of the best one's.
const WORSE: f64 = 2.0;
/// Successive searches that find the same place so distinctly.
const AGREEING: u32 = 6;

/// Variance of a pose on a map without free floor, mm² and rad².
const NOWHERE: f64 = 1e8;

/// Distance classes of the surfaces that face in one of [`SECTORS`] directions.
const SECTORS: usize = 12;
#[allow(clippy::cast_precision_loss)] // a dozen
const SECTOR_RAD: f64 = TAU / SECTORS as f64;
const FIELD_MM: f64 = 50.0;
const REACH_MM: f64 = 150.0;

/// What was seen since the start, in the dead reckoning's frame.
#[derive(Clone, Debug)]
pub(super) struct GlobalSearch {
    field: Field,
    stretches: Vec<(Vec<Element>, Vec<Pose2>)>,
    /// The dead reckoning's origin by the best place, and how many searches agree on it.
    frame: Pose2,
    searches: u32,
}

/// A place where the robot may be.
#[derive(Clone, Copy, Debug, PartialEq)]
pub(super) struct Place {
    pub mean: Vector3<f64>,
    pub covariance: Matrix3<f64>,
    /// Costs of the elements and points of the way, per element.
    cost: f64,
}

/// The outcome of a search.
#[derive(Clone, Copy, Debug)]
pub(super) enum Outcome {
    /// Mean and covariance over everywhere that it may be.
    Searching(Vector3<f64>, Matrix3<f64>),
    Located(Place),
}

impl GlobalSearch {
    pub fn new(surfaces: &SurfaceMap, grid: &Grid) -> Self {
        Self {
            field: Field::new(surfaces, grid),
            stretches: Vec::new(),
            frame: Pose2::default(),
            searches: 0,
        }
    }

    /// Takes a stretch and searches; the result is the pose now, at `dead_reckoning`.
    pub fn advance(
        &mut self,
        (elements, way): (Vec<Element>, Vec<Pose2>),
        dead_reckoning: &Pose2,
        (surfaces, grid): (&SurfaceMap, &Grid),
        (beam, config): (&Beam, &MatcherConfig),
    ) -> Outcome {
        self.stretches.push((elements, way));
        if self.stretches.len() > STRETCHES {
            self.stretches.remove(0);
        }
        let to_robot = Pose2::default().relative_to(dead_reckoning);
        let moved = |e: &Element| e.has_bearing().then(|| e.moved(&to_robot));
        let seen = self.stretches.iter().flat_map(|s| &s.0);
        let elements: Vec<Element> = seen.filter_map(moved).collect();
        let ways = self.stretches.iter().flat_map(|s| &s.1);
        let way: Vec<Pose2> = ways.map(|at| to_robot.compose(at)).collect();
        let mut coarse = self.coarse(&thinned(&elements), &thinned(&way), beam);
        if coarse.is_empty() {
            // Nowhere on the map can this be driven: the map or the way is wrong.
            self.stretches.clear();
            coarse = self.coarse(&[], &[], beam);
        }
        let mut places: Vec<Place> = Vec::new();
        if elements.len() >= FEWEST && way.len() >= FEWEST_OF_WAY {
            for (pose, _) in coarse.iter().take(REFINED) {
                let place = refine(&elements, &way, pose, (surfaces, grid), (beam, config));
                places.extend(place);
            }
        }
        places.sort_by(|a, b| a.cost.total_cmp(&b.cost));
        let best = distinct(&places);
        let frame = best.map(|best| best.pose().compose(&to_robot));
        if let (Some(best), true) = (best, self.is_agreed(frame)) {
            return Outcome::Located(*best);
        }
        let (mean, covariance) = spread(&coarse, config.temperature);
        Outcome::Searching(mean, covariance)
    }

    /// Whether enough successive searches have found this place of the dead reckoning's origin.
    fn is_agreed(&mut self, frame: Option<Pose2>) -> bool {
        let same = frame.is_some_and(|frame| is_same(&frame, &self.frame));
        let before = if same { self.searches } else { 0 };
        self.searches = before + u32::from(frame.is_some());
        self.frame = frame.unwrap_or(self.frame);
        self.searches >= AGREEING
    }

    /// Poses on free floor with their cost per element, the best and distinct ones first, then the
    /// others.
    fn coarse(&self, elements: &[Element], way: &[Pose2], beam: &Beam) -> Vec<(Pose2, f64)> {
        let mut poses = Vec::new();
        for heading in 0..HEADINGS {
            let heading_rad = f64::from(heading) * TAU / f64::from(HEADINGS);
            let turn = Pose2::new(0.0, 0.0, heading_rad);
            let turned = elements.iter().map(|e| e.moved(&turn));
            let looked_up = |e: Element| (step_to(e.point(beam)), sector(e.towards_rad + PI));
            let elements: Vec<(Step, usize)> = turned.map(looked_up).collect();
            let way = way.iter().map(|at| step_to(turn.compose(at).position()));
            let way: Vec<Step> = way.collect();
            for at in self.field.floor() {
                let blocked = way.iter().filter(|step| !self.field.is_free(at, **step));
                let blocked = blocked.take(BLOCKED).count();
                if blocked < BLOCKED {
                    let cost = |(step, sector): &(Step, usize)| self.field.cost(at, *step, *sector);
                    #[allow(clippy::cast_precision_loss)] // below BLOCKED
                    let cost = elements.iter().map(cost).sum::<f64>() + LIMIT * blocked as f64;
                    let middle = self.field.middle(at);
                    poses.push((Pose2::new(middle.x_mm, middle.y_mm, heading_rad), cost));
                }
            }
            if poses.len() > MOST {
                poses.sort_by(|a, b| a.1.total_cmp(&b.1));
                poses.truncate(MOST);
            }
        }
        poses.sort_by(|a, b| a.1.total_cmp(&b.1));
        let mut distinct: Vec<(Pose2, f64)> = Vec::new();
        for pose in &poses {
            if distinct.len() < REFINED && !distinct.iter().any(|known| is_same(&known.0, &pose.0))
            {
                distinct.push(*pose);
            }
        }
        distinct.extend(poses);
        distinct
    }
}

impl Place {
    fn pose(&self) -> Pose2 {
        Pose2::new(self.mean[0], self.mean[1], self.mean[2])
    }
}

fn is_same(a: &Pose2, b: &Pose2) -> bool {
    a.distance_mm(b) < SAME.0 && a.turn_to_rad(b).abs() < SAME.1
}

/// At most [`SAMPLES`] of the values, evenly spaced.
fn thinned<T: Copy>(values: &[T]) -> Vec<T> {
    let apart = values.len() / SAMPLES + 1;
    values.iter().step_by(apart).copied().collect()
}

fn refine(
    elements: &[Element],
    way: &[Pose2],
    pose: &Pose2,
    (surfaces, grid): (&SurfaceMap, &Grid),
    (beam, config): (&Beam, &MatcherConfig),
) -> Option<Place> {
    let deviations = Vector3::new(COARSE.0, COARSE.0, COARSE.1);
    let prior = Matrix3::from_diagonal(&deviations.component_mul(&deviations));
    let elements = thinned(elements);
    let found = matcher::find(surfaces, &elements, (pose, &prior), beam, config)?;
    let at = Pose2::new(found.mean[0], found.mean[1], found.mean[2]);
    let blocked = |step: &&Pose2| grid.cell_at(at.compose(step).position()) == Cell::Occupied;
    let way = thinned(way);
    let missing = elements.len() - found.matched + way.iter().filter(blocked).count();
    #[allow(clippy::cast_precision_loss)] // some hundreds
    let cost = (found.cost * found.matched as f64 + LIMIT * missing as f64) / elements.len() as f64;
    Some(Place {
        mean: found.mean,
        covariance: found.covariance,
        cost,
    })
}

/// The first of these places, the best ones first, if it is good and all others are clearly worse.
fn distinct(places: &[Place]) -> Option<&Place> {
    let best = places.first().filter(|best| best.cost < GOOD)?;
    let is_other = |place: &&Place| !is_same(&best.pose(), &place.pose());
    let other = places.iter().find(is_other);
    let is_worse = |other: &Place| other.cost > GOOD.max(WORSE * best.cost);
    other.is_none_or(is_worse).then_some(best)
}

/// Mean and covariance of weighted poses; the headings around the mean direction.
fn spread(poses: &[(Pose2, f64)], temperature: f64) -> (Vector3<f64>, Matrix3<f64>) {
    let lowest = poses.first().map_or(0.0, |pose| pose.1);
    let weight = |cost: f64| libm::exp(-0.5 * (cost - lowest) / temperature);
    let (mut total, mut sum, mut direction) = (0.0, Vector3::zeros(), (0.0, 0.0));
    for (pose, cost) in poses {
        let (share, (sin, cos)) = (weight(*cost), libm::sincos(pose.heading_rad));
        total += share;
        sum += Vector3::new(pose.x_mm, pose.y_mm, 0.0) * share;
        direction = (direction.0 + share * sin, direction.1 + share * cos);
    }
    if total <= 0.0 {
        return (Vector3::zeros(), Matrix3::identity() * NOWHERE);
    }
    let mut mean = sum / total;
    mean[2] = libm::atan2(direction.0, direction.1);
    // Half the coarse spacing.
    let mut covariance = Matrix3::from_diagonal(&Vector3::new(2500.0, 2500.0, 0.002));
    for (pose, cost) in poses {
        let turn = geometry::wrap_angle(pose.heading_rad - mean[2]);
        let off = Vector3::new(pose.x_mm - mean[0], pose.y_mm - mean[1], turn);
        covariance += off * off.transpose() * (weight(*cost) / total);
    }
    (mean, covariance)
}

/// Columns and rows of the field from one of its cells to another.
type Step = (isize, isize);

/// To the cell with a point, seen from the middle of one.
#[allow(clippy::cast_possible_truncation)] // as far as a robot drives
fn step_to(point: Point) -> Step {
    let cells = |mm: f64| libm::floor(mm / FIELD_MM + 0.5) as isize;
    (cells(point.x_mm), cells(point.y_mm))
}

#[allow(clippy::cast_possible_truncation, clippy::cast_sign_loss)] // never negative
fn sector(facing_rad: f64) -> usize {
    ((facing_rad.rem_euclid(TAU) / SECTOR_RAD) as usize).min(SECTORS - 1)
}

/// Costs of elements by place and direction, looked up.
#[derive(Clone, Debug)]
struct Field {
    low: Point,
    columns: usize,
    rows: usize,
    costs: Vec<[f32; SECTORS]>,
    free: Vec<bool>,
}

impl Field {
    #[allow(
        clippy::cast_precision_loss,
        clippy::cast_possible_truncation,
        clippy::cast_sign_loss
    )]
    fn new(surfaces: &SurfaceMap, grid: &Grid) -> Self {
        let cells = |count: usize| (count as f64 * grid.cell_mm() / FIELD_MM).ceil() as usize;
        let (columns, rows) = (cells(grid.columns()), cells(grid.rows()));
        let mut field = Self {
            low: grid.origin(),
            columns,
            rows,
            costs: vec![[LIMIT as f32; SECTORS]; columns * rows],
            free: Vec::new(),
        };
        for index in 0..columns * rows {
            let middle = field.middle((index % columns, index / columns));
            field.free.push(grid.cell_at(middle) == Cell::Free);
            for surfel in surfaces.near(middle, REACH_MM) {
                let off = middle.distance_mm(surfel.point) / COARSE.0;
                let cost = (off * off / (1.0 + off * off / LIMIT)) as f32;
                for sector in 0..SECTORS {
                    if faces(surfel, sector) {
                        field.costs[index][sector] = field.costs[index][sector].min(cost);
                    }
                }
            }
        }
        field
    }

    #[allow(clippy::cast_precision_loss)]
    fn middle(&self, (column, row): (usize, usize)) -> Point {
        let at = |low: f64, number: usize| low + (number as f64 + 0.5) * FIELD_MM;
        Point::new(at(self.low.x_mm, column), at(self.low.y_mm, row))
    }

    fn index(&self, (column, row): (usize, usize), step: Step) -> Option<usize> {
        // Below 0 is far beyond the last one.
        let column = column.wrapping_add_signed(step.0);
        let row = row.wrapping_add_signed(step.1);
        (column < self.columns && row < self.rows).then(|| row * self.columns + column)
    }

    fn cost(&self, at: (usize, usize), step: Step, sector: usize) -> f64 {
        let index = self.index(at, step);
        index.map_or(LIMIT, |index| self.costs[index][sector].into())
    }

    fn is_free(&self, at: (usize, usize), step: Step) -> bool {
        self.index(at, step).is_some_and(|index| self.free[index])
    }

    /// Cells where the robot may stand, every second one.
    fn floor(&self) -> impl Iterator<Item = (usize, usize)> + '_ {
        let columns = || (0..self.columns).step_by(2);
        let rows = (0..self.rows).step_by(2);
        let cells = rows.flat_map(move |row| columns().map(move |column| (column, row)));
        cells.filter(|at| self.is_free(*at, (0, 0)))
    }
}

/// Whether a surfel answers to elements whose surface faces into this sector, give or take one.
#[allow(clippy::cast_precision_loss)]
fn faces(surfel: &Surfel, sector: usize) -> bool {
    let off_rad = surfel.facing_rad - (sector as f64 + 0.5) * SECTOR_RAD;
    surfel.edge || geometry::wrap_angle(off_rad).abs() < 0.75 * SECTOR_RAD
}

#[cfg(test)]
mod tests;

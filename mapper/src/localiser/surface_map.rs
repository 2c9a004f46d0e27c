//! The map that is matched against: surface elements with the direction they face.

use std::collections::HashMap;
use std::f64::consts::PI;

use geometry::wrap_angle;
use nalgebra::Matrix3;

use super::surface::Kind;
use crate::{Cell, Grid, Point, Pose2};

/// A piece of a surface.
#[derive(Clone, Copy, Debug, PartialEq)]
pub(super) struct Surfel {
    pub point: Point,
    /// Direction of its outward normal, towards where it was seen from, rad.
    pub facing_rad: f64,
    /// An edge or a leg: seen from everywhere.
    pub edge: bool,
    /// Number of elements in the mean.
    pub weight: f64,
    /// The stretch that it was first seen in.
    record: usize,
}

/// Where the robot was when a stretch was entered, and how well it knew.
#[derive(Clone, Debug)]
pub(super) struct Record {
    position: Point,
    covariance: Matrix3<f64>,
}

impl Record {
    /// What the record's error means for a pose that is found by its surfels: they are displaced
    /// and turned about where the robot was.
    pub fn covariance_at(&self, pose: &Pose2) -> Matrix3<f64> {
        let mut lever = Matrix3::identity();
        lever[(0, 2)] = self.position.y_mm - pose.y_mm;
        lever[(1, 2)] = pose.x_mm - self.position.x_mm;
        lever * self.covariance * lever.transpose()
    }
}

/// Width of a cell, mm.
const CELL_MM: f64 = 50.0;
/// Surfels of a cell whose normals differ less are one, rad.
const SAME_RAD: f64 = 0.5;
/// The mean forgets beyond this many elements.
const LARGEST_WEIGHT: f64 = 30.0;

#[derive(Clone, Debug, Default)]
pub(super) struct SurfaceMap {
    cells: HashMap<(i32, i32), Vec<Surfel>>,
    records: Vec<Record>,
}

#[allow(clippy::cast_possible_truncation)] // saturates
fn number(mm: f64) -> i32 {
    (mm / CELL_MM).floor() as i32
}

impl SurfaceMap {
    /// Begins a stretch: what is inserted next was seen from about `pose`.
    pub fn begin(&mut self, pose: &Pose2, covariance: Matrix3<f64>) {
        self.records.push(Record {
            position: pose.position(),
            covariance,
        });
    }

    /// The stretch that a surfel of this map was first seen in.
    pub fn record(&self, surfel: &Surfel) -> &Record {
        &self.records[surfel.record]
    }

    /// Enters an element at `point`, whose surface is in direction `towards_rad` from the sensor.
    pub fn insert(&mut self, point: Point, towards_rad: f64, kind: Kind) {
        let record = self.records.len() - 1;
        let facing_rad = towards_rad + PI;
        let edge = kind == Kind::Edge;
        let cell = self
            .cells
            .entry((number(point.x_mm), number(point.y_mm)))
            .or_default();
        let same = |s: &&mut Surfel| {
            s.edge == edge && (edge || wrap_angle(s.facing_rad - facing_rad).abs() < SAME_RAD)
        };
        if let Some(surfel) = cell.iter_mut().find(same) {
            surfel.weight = (surfel.weight + 1.0).min(LARGEST_WEIGHT);
            surfel.point = surfel.point.lerp(point, 1.0 / surfel.weight);
            surfel.facing_rad += wrap_angle(facing_rad - surfel.facing_rad) / surfel.weight;
        } else {
            cell.push(Surfel {
                point,
                facing_rad,
                edge,
                weight: 1.0,
                record,
            });
        }
    }

    /// The surfels in the cells that the square of this half width around `point` meets.
    pub fn near(&self, point: Point, half_mm: f64) -> impl Iterator<Item = &Surfel> {
        let range = move |mm: f64| number(mm - half_mm)..=number(mm + half_mm);
        range(point.x_mm)
            .flat_map(move |column| range(point.y_mm).map(move |row| (column, row)))
            .filter_map(|key| self.cells.get(&key))
            .flatten()
    }

    /// The surfaces of an occupancy grid: a line through the occupied cells around each one, which
    /// faces the side or sides with free cells.
    pub fn from_grid(grid: &Grid) -> Self {
        let mut map = Self::default();
        map.begin(&Pose2::default(), Matrix3::zeros());
        let occupied = |(column, row): &(usize, usize)| grid.cell(*column, *row) == Cell::Occupied;
        for (column, row) in grid.cells().filter(occupied) {
            let middle = grid.middle(column, row);
            let around: Vec<Point> = (column.saturating_sub(3)..=column + 3)
                .flat_map(|c| (row.saturating_sub(3)..=row + 3).map(move |r| (c, r)))
                .filter(occupied)
                .map(|(c, r)| grid.middle(c, r))
                .collect();
            let line = Line::through(&around);
            let aside = [line.normal_rad, line.normal_rad + PI];
            for normal_rad in aside {
                let from = Pose2::new(middle.x_mm, middle.y_mm, normal_rad);
                let free = [2.0, 3.0, 4.0].into_iter().any(|cells| {
                    grid.cell_at(from.point_at(cells * grid.cell_mm(), 0.0)) == Cell::Free
                });
                if free {
                    let kind = if line.is_compact {
                        Kind::Edge
                    } else {
                        Kind::Wall
                    };
                    // The cells' line, at this cell.
                    let off = from.relative_to(&line.middle).point_at(0.0, 0.0);
                    let point = line.middle.point_at(off.x_mm, 0.0);
                    map.insert(point, normal_rad + PI, kind);
                }
            }
        }
        for surfel in map.cells.values_mut().flatten() {
            surfel.weight = LARGEST_WEIGHT;
        }
        map
    }
}

/// The line of least squares through points.
struct Line {
    /// On the line, heading along it.
    middle: Pose2,
    normal_rad: f64,
    /// As wide as long.
    is_compact: bool,
}

impl Line {
    fn through(points: &[Point]) -> Self {
        let count = f64::from(u32::try_from(points.len()).unwrap_or(1));
        let x = points.iter().map(|p| p.x_mm).sum::<f64>() / count;
        let y = points.iter().map(|p| p.y_mm).sum::<f64>() / count;
        let (mut xx, mut xy, mut yy) = (0.0, 0.0, 0.0);
        for point in points {
            let (dx, dy) = (point.x_mm - x, point.y_mm - y);
            (xx, xy, yy) = (xx + dx * dx, xy + dx * dy, yy + dy * dy);
        }
        let along = 0.5 * libm::atan2(2.0 * xy, xx - yy);
        let difference = libm::hypot(xx - yy, 2.0 * xy);
        Self {
            middle: Pose2::new(x, y, along),
            normal_rad: along + PI / 2.0,
            is_compact: difference < 0.5 * (xx + yy),
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn saved_walls_face_their_free_sides() {
        // A thin wall along x with free floor on both sides of its left half, and a leg.
        let leg = Point::new(300.0, 512.5);
        let (low, high) = (Point::new(-1000.0, -1000.0), Point::new(1000.0, 1000.0));
        let grid = Grid::from_fn(25.0, low, high, |p| {
            if p.y_mm.abs() < 25.0 || p.distance_mm(leg) < 30.0 {
                4.0
            } else if p.y_mm > 0.0 || p.x_mm < 0.0 {
                -4.0
            } else {
                0.0
            }
        });
        let map = SurfaceMap::from_grid(&grid);
        let facing = |at: Point, expected: f64| {
            let mut near = map.near(at, 30.0).filter(|s| !s.edge);
            near.any(|s| {
                wrap_angle(s.facing_rad - expected).abs() < 0.2 && s.point.y_mm.abs() < 6.0
            })
        };
        for (x, up, down) in [(-500.0, true, true), (500.0, true, false)] {
            assert_eq!(facing(Point::new(x, 0.0), PI / 2.0), up, "{x}");
            assert_eq!(facing(Point::new(x, 0.0), -PI / 2.0), down, "{x}");
        }
        assert!(map.near(leg, 30.0).any(|s| s.edge));
    }

    #[test]
    fn surfel_is_the_mean_of_its_latest_elements() {
        let mut map = SurfaceMap::default();
        map.begin(&Pose2::default(), Matrix3::zeros());
        let (first, later) = (Point::new(10.0, 10.0), Point::new(40.0, 10.0));
        map.insert(first, -PI, Kind::Wall);
        map.insert(later, 0.2 + PI, Kind::Wall);
        let surfel = |map: &SurfaceMap| *map.near(first, 1.0).next().unwrap();
        let mean = surfel(&map);
        assert!((mean.point.x_mm - 25.0).abs() < 1e-9 && (mean.facing_rad - 0.1).abs() < 1e-9);
        // A changed world changes the map.
        for (at, count) in [(first, 1000), (later, 30)] {
            for _ in 0..count {
                map.insert(at, -PI, Kind::Wall);
            }
        }
        assert!(surfel(&map).point.x_mm > 25.0);
        let wall = |p: Point| if p.y_mm.abs() < 25.0 { 4.0 } else { -4.0 };
        let (low, high) = (Point::new(-500.0, -500.0), Point::new(500.0, 500.0));
        let saved = SurfaceMap::from_grid(&Grid::from_fn(25.0, low, high, wall));
        let weights = saved.near(first, 50.0).map(|surfel| surfel.weight);
        assert!(weights.reduce(f64::min) >= Some(LARGEST_WEIGHT));
    }

    #[test]
    fn error_of_a_record_turns_about_its_place() {
        let mut covariance = Matrix3::zeros();
        covariance[(2, 2)] = 0.01;
        let position = Point::new(50.0, 20.0);
        let record = Record {
            position,
            covariance,
        };
        let found = record.covariance_at(&Pose2::new(150.0, 220.0, 1.0));
        // Turned to the left, what lies 100 mm ahead and 200 mm to the left moves back and left.
        let expected = [
            (0, 0, 400.0),
            (1, 1, 100.0),
            (0, 2, -2.0),
            (1, 2, 1.0),
            (2, 2, 0.01),
        ];
        for (row, column, value) in expected {
            assert!(
                (found[(row, column)] - value).abs() < 1e-9,
                "{row} {column}: {found}"
            );
        }
    }
}

//! What the grid means for driving: a lattice along the walls' directions with the clearance of
//! every node.

use std::collections::VecDeque;

use geometry::{Point, Pose2};
use mapper::{Cell, Grid};

/// Distance between neighbouring nodes, mm.
pub(crate) const STEP_MM: f64 = 50.0;
/// Longer than any way, mm.
pub(crate) const NO_WAY_MM: f64 = 1e6;
/// Occupied cells within this radius of the driven way are outdated or shifted: the body was
/// there. mm.
const DRIVEN_MM: f64 = 30.0;
/// Radius around the driven way that the body has shown to be free, mm.
const BODY_MM: f64 = 100.0;

/// Distances are computed in this fraction of a millimetre; none is beyond 65 m.
const FRACTION: f64 = 16.0;
const FARTHEST: u32 = 1 << 20;

/// A node of the lattice.
#[derive(Clone, Copy, Debug)]
pub(crate) struct Node {
    /// Distance to the nearest occupied cell, mm, within 5 %.
    pub clearance_mm: f64,
    /// Distance to the nearest cell that is not known to be free, mm, within 5 %.
    pub known_mm: f64,
    /// The cell of the grid under the node.
    pub cell: Cell,
    /// On the driven way.
    pub driven: bool,
    /// A beam that would have shown a wall has passed here.
    pub seen: bool,
}

/// The lattice. Nodes are numbered row by row.
#[derive(Clone, Debug)]
pub(crate) struct CostMap {
    /// Pose of node 0; the rows run along its heading.
    frame: Pose2,
    /// One step along the rows.
    step: Point,
    pub columns: usize,
    rows: usize,
    pub nodes: Vec<Node>,
}

impl CostMap {
    /// The lattice over the whole grid along `direction_rad`. `marks` are obstacles that are not
    /// in the grid; `driven` is the way so far.
    pub fn new(grid: &Grid, direction_rad: f64, marks: &[Point], driven: &[Point]) -> Self {
        let field = Field::new(grid, marks, driven);
        let along = Pose2::new(0.0, 0.0, direction_rad);
        let (low, high) = (field.point(0), field.point(field.cells.len().max(1) - 1));
        let corners = [
            low,
            high,
            Point::new(low.x_mm, high.y_mm),
            Point::new(high.x_mm, low.y_mm),
        ]
        .map(|corner| Pose2::new(corner.x_mm, corner.y_mm, 0.0).relative_to(&along));
        let fold = |pick: fn(f64, f64) -> f64, of: fn(&Pose2) -> f64| {
            corners.iter().map(of).reduce(pick).unwrap_or(0.0)
        };
        let (x, y) = (fold(f64::min, |p| p.x_mm), fold(f64::min, |p| p.y_mm));
        let columns = steps(fold(f64::max, |p| p.x_mm) - x) + 1;
        let rows = steps(fold(f64::max, |p| p.y_mm) - y) + 1;
        let Point { x_mm, y_mm } = along.point_at(x, y);
        let (sin, cos) = libm::sincos(direction_rad);
        let mut map = Self {
            step: Point::new(STEP_MM * cos, STEP_MM * sin),
            frame: Pose2::new(x_mm, y_mm, direction_rad),
            columns,
            rows,
            nodes: Vec::new(),
        };
        let places = (0..rows).flat_map(|row| (0..columns).map(move |column| (column, row)));
        let nodes = places.map(|(column, row)| field.node(map.place(column, row)));
        map.nodes = nodes.collect();
        for &point in driven {
            for index in map.within(point, DRIVEN_MM + 0.5 * STEP_MM) {
                map.nodes[index].driven = true;
                map.nodes[index].seen = true;
            }
        }
        map
    }

    /// Direction of the rows, radians.
    pub const fn direction_rad(&self) -> f64 {
        self.frame.heading_rad
    }

    /// Where a node is.
    pub fn point(&self, index: usize) -> Point {
        self.place(index % self.columns, index / self.columns)
    }

    #[allow(clippy::cast_precision_loss)] // some hundred
    fn place(&self, column: usize, row: usize) -> Point {
        let (column, row) = (column as f64, row as f64);
        let Point { x_mm, y_mm } = self.step;
        Point::new(
            self.frame.x_mm + column * x_mm - row * y_mm,
            self.frame.y_mm + column * y_mm + row * x_mm,
        )
    }

    /// The node nearest to a point.
    pub fn index(&self, point: Point) -> Option<usize> {
        let (dx, dy) = (point.x_mm - self.frame.x_mm, point.y_mm - self.frame.y_mm);
        let Point { x_mm, y_mm } = self.step;
        let column = ((dx * x_mm + dy * y_mm) / (STEP_MM * STEP_MM)).round();
        let row = ((dy * x_mm - dx * y_mm) / (STEP_MM * STEP_MM)).round();
        #[allow(clippy::cast_possible_truncation, clippy::cast_sign_loss)] // checked
        let number = |number: f64, count: usize| {
            (number >= 0.0 && (number as usize) < count).then_some(number as usize)
        };
        let (column, row) = number(column, self.columns).zip(number(row, self.rows))?;
        Some(row * self.columns + column)
    }

    /// The node nearest to a point; `None` beyond the grid.
    pub fn at(&self, point: Point) -> Option<&Node> {
        self.index(point).map(|index| &self.nodes[index])
    }

    /// The neighbour in one of the directions 0..4, counted counter-clockwise from the rows'.
    pub const fn neighbour(&self, index: usize, direction: usize) -> Option<usize> {
        let (column, row) = (index % self.columns, index / self.columns);
        match direction {
            0 if column + 1 < self.columns => Some(index + 1),
            1 if row + 1 < self.rows => Some(index + self.columns),
            2 if column > 0 => Some(index - 1),
            3 if row > 0 => Some(index - self.columns),
            _ => None,
        }
    }

    /// The neighbours in the four directions.
    pub fn neighbours(&self, index: usize) -> impl Iterator<Item = usize> + '_ {
        (0..4).filter_map(move |direction| self.neighbour(index, direction))
    }

    /// Way from a node to every node over `allowed` ones, mm, turns uncounted; [`NO_WAY_MM`] where
    /// none leads.
    pub fn ways_mm(&self, from: usize, allowed: impl Fn(&Node) -> bool) -> Vec<f64> {
        let mut ways_mm = vec![NO_WAY_MM; self.nodes.len()];
        ways_mm[from] = 0.0;
        let mut todo = VecDeque::from([from]);
        while let Some(index) = todo.pop_front() {
            for next in self.neighbours(index) {
                if ways_mm[next] >= NO_WAY_MM && allowed(&self.nodes[next]) {
                    ways_mm[next] = ways_mm[index] + STEP_MM;
                    todo.push_back(next);
                }
            }
        }
        ways_mm
    }

    /// Nodes within `radius_mm` of a point.
    pub fn within(&self, point: Point, radius_mm: f64) -> Vec<usize> {
        let Some(middle) = self.index(point) else {
            return Vec::new();
        };
        let reach = steps(radius_mm) + 1;
        let (column, row) = (middle % self.columns, middle / self.columns);
        let columns = column.saturating_sub(reach)..(column + reach + 1).min(self.columns);
        (row.saturating_sub(reach)..(row + reach + 1).min(self.rows))
            .flat_map(|row| columns.clone().map(move |column| (column, row)))
            .filter(|&(column, row)| {
                let off = self.place(column, row) - point;
                off.dot(off) <= radius_mm * radius_mm
            })
            .map(|(column, row)| row * self.columns + column)
            .collect()
    }

    /// Whether every node on the straight line has this predicate.
    pub fn line(&self, from: Point, to: Point, allowed: impl Fn(&Node) -> bool) -> bool {
        let count = steps(2.0 * from.distance_mm(to)).max(1);
        #[allow(clippy::cast_precision_loss)] // some hundred
        (0..=count).all(|nth| {
            let point = from.lerp(to, nth as f64 / count as f64);
            self.at(point).is_some_and(&allowed)
        })
    }
}

#[allow(clippy::cast_possible_truncation, clippy::cast_sign_loss)] // metres over millimetres
fn steps(mm: f64) -> usize {
    (mm / STEP_MM).round().max(0.0) as usize
}

/// Distances on the grid itself, in [`FRACTION`]s of a millimetre.
struct Field<'a> {
    grid: &'a Grid,
    cells: Vec<Cell>,
    clearance: Vec<u32>,
    known: Vec<u32>,
}

impl<'a> Field<'a> {
    fn new(grid: &'a Grid, marks: &[Point], driven: &[Point]) -> Self {
        let mut cells: Vec<Cell> = grid
            .cells()
            .map(|(column, row)| grid.cell(column, row))
            .collect();
        let mut field = Self {
            grid,
            cells: Vec::new(),
            clearance: Vec::new(),
            known: Vec::new(),
        };
        for &point in driven {
            field.stamp(point, BODY_MM, |index, square| {
                if cells[index] == Cell::Unknown || square <= DRIVEN_MM * DRIVEN_MM {
                    cells[index] = Cell::Free;
                }
            });
        }
        for &point in marks {
            field.stamp(point, grid.cell_mm(), |index, _| {
                cells[index] = Cell::Occupied;
            });
        }
        field.clearance = field.distances(|index| cells[index] == Cell::Occupied);
        field.known = field.distances(|index| cells[index] != Cell::Free);
        field.cells = cells;
        field
    }

    /// Calls with every cell whose middle is within `radius_mm`, and the square of its distance.
    #[allow(clippy::cast_precision_loss)] // some hundred
    fn stamp(&self, point: Point, radius_mm: f64, mut each: impl FnMut(usize, f64)) {
        let (origin, cell_mm) = (self.grid.origin(), self.grid.cell_mm());
        #[allow(clippy::cast_possible_truncation, clippy::cast_sign_loss)] // clamped
        let number = |mm: f64, count: usize| ((mm / cell_mm).floor().max(0.0) as usize).min(count);
        let span = |mm: f64, count: usize| {
            number(mm - radius_mm, count)..number(mm + radius_mm + cell_mm, count)
        };
        let off_mm = |from_mm: f64, nth: usize| (nth as f64 + 0.5) * cell_mm - from_mm;
        let (x_mm, y_mm) = (point.x_mm - origin.x_mm, point.y_mm - origin.y_mm);
        let columns = span(x_mm, self.grid.columns());
        for row in span(y_mm, self.grid.rows()) {
            let aside = off_mm(y_mm, row).powi(2);
            for column in columns.clone() {
                let square = off_mm(x_mm, column).powi(2) + aside;
                if square <= radius_mm * radius_mm {
                    each(row * self.grid.columns() + column, square);
                }
            }
        }
    }

    /// Distance of every cell to the nearest source: Borgefors' two-pass chamfer transform
    /// with the weights that err least (Borgefors, "Distance transformations in digital images",
    /// 1986), inside a frame of cells without a source.
    #[allow(clippy::cast_possible_truncation, clippy::cast_sign_loss)] // weights
    fn distances(&self, is_source: impl Fn(usize) -> bool) -> Vec<u32> {
        let (columns, rows) = (self.grid.columns(), self.grid.rows());
        let weight = |share: f64| (share * self.grid.cell_mm() * FRACTION).round() as u32;
        let (side, corner) = (weight(0.955), weight(1.369));
        let width = columns + 2;
        let mut field = vec![FARTHEST; width * (rows + 2)];
        let inside = |row: usize| (row + 1) * width + 1..(row + 1) * width + 1 + columns;
        for row in 0..rows {
            for (column, index) in inside(row).enumerate() {
                if is_source(row * columns + column) {
                    field[index] = 0;
                }
            }
        }
        // From the lower left, then the same from the upper right.
        for _ in 0..2 {
            for row in 1..=rows {
                let (before, cells) = field.split_at_mut(row * width);
                let below = before[(row - 1) * width..].windows(3);
                let mut beside = FARTHEST;
                for (cell, below) in cells[1..=columns].iter_mut().zip(below) {
                    let corners = below[0].min(below[2]) + corner;
                    let nearest = (*cell).min(below[1] + side).min(corners);
                    beside = nearest.min(beside + side);
                    *cell = beside;
                }
            }
            field.reverse();
        }
        let rows = (0..rows).map(|row| &field[inside(row)]);
        rows.collect::<Vec<_>>().concat()
    }

    fn point(&self, index: usize) -> Point {
        let columns = self.grid.columns().max(1);
        self.grid.middle(index % columns, index / columns)
    }

    fn node(&self, point: Point) -> Node {
        let (origin, cell_mm) = (self.grid.origin(), self.grid.cell_mm());
        #[allow(clippy::cast_possible_truncation, clippy::cast_sign_loss)] // checked
        let number = |mm: f64, count: usize| {
            let number = (mm / cell_mm).floor();
            (number >= 0.0 && (number as usize) < count).then_some(number as usize)
        };
        let index = number(point.x_mm - origin.x_mm, self.grid.columns())
            .zip(number(point.y_mm - origin.y_mm, self.grid.rows()))
            .map(|(column, row)| row * self.grid.columns() + column);
        let distance_mm = |distance: u32| f64::from(distance) / FRACTION;
        Node {
            clearance_mm: index.map_or(f64::INFINITY, |index| distance_mm(self.clearance[index])),
            known_mm: index.map_or(0.0, |index| distance_mm(self.known[index])),
            cell: index.map_or(Cell::Unknown, |index| self.cells[index]),
            driven: false,
            seen: false,
        }
    }
}

#[cfg(test)]
pub(crate) mod tests;

//! What the grid means for driving: a lattice along the walls' directions with the clearance of
//! every node.

use std::collections::VecDeque;
use std::ops::Range;

use geometry::{Point, Pose2};
use mapper::{Cell, Grid};

/// Distance between neighbouring nodes, mm.
pub(crate) const STEP_MM: f64 = 50.0;
/// Longer than any way, mm.
pub(crate) const NO_WAY_MM: f64 = 1e6;
/// Occupied cells within this radius of the driven way are outdated or shifted: the body was
/// there. mm.
const DRIVEN_MM: f64 = 30.0;

/// The cells of the robot's own maps, mm.
const USUAL_CELL_MM: f64 = 25.0;

/// Distances are computed in this fraction of a millimetre; none is beyond 65 m.
const FRACTION: f64 = 16.0;
const FARTHEST: u32 = 1 << 20;

/// The driven way, and the radius of the body that has shown it to be free, mm.
pub(crate) type Driven<'a> = (&'a [Point], f64);

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
    /// A beam that would have shown a wall has passed here, along the rows and across them.
    pub seen: [bool; 2],
}

impl Node {
    /// Whether any such beam has.
    pub fn is_seen(&self) -> bool {
        self.seen != [false; 2]
    }

    /// Such beams have passed it, too.
    pub fn see(&mut self, [along, across]: [bool; 2]) {
        self.seen = [self.seen[0] | along, self.seen[1] | across];
    }
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
    /// in the grid.
    pub fn new(grid: &Grid, direction_rad: f64, marks: &[Point], driven: Driven<'_>) -> Self {
        let (columns, rows) = (grid.columns().max(1) - 1, grid.rows().max(1) - 1);
        let corners = [(0, 0), (columns, 0), (columns, rows), (0, rows)];
        let corners = corners.map(|(column, row)| grid.middle(column, row));
        let frame = Pose2::new(0.0, 0.0, direction_rad);
        let whole = bounds(corners.into_iter().map(|corner| local(corner, &frame)));
        Self::over(grid, &frame, whole, (marks, driven))
    }

    /// The nodes of this lattice within `margin_mm` of the rectangle around these points, with the grid as it is
    /// now. What is nearer to a node than the rim is in its clearance.
    pub fn around(
        &self,
        points: &[Point],
        margin_mm: f64,
        grid: &Grid,
        obstacles: (&[Point], Driven<'_>),
    ) -> Self {
        let (low, high) = bounds(points.iter().map(|&point| local(point, &self.frame)));
        let number = |mm: f64| ((mm - margin_mm) / STEP_MM).floor();
        let low = Point::new(number(low.x_mm), number(low.y_mm)) * STEP_MM;
        let high = high + Point::new(margin_mm, margin_mm);
        Self::over(grid, &self.frame, (low, high), obstacles)
    }

    /// The lattice over a rectangle, both in the frame.
    fn over(
        grid: &Grid,
        frame: &Pose2,
        (low, high): (Point, Point),
        (marks, driven): (&[Point], Driven<'_>),
    ) -> Self {
        let corners = [low, Point::new(high.x_mm, low.y_mm), high];
        let corners = corners.into_iter().chain([Point::new(low.x_mm, high.y_mm)]);
        let (from, to) = bounds(corners.map(|corner| frame.point_at(corner.x_mm, corner.y_mm)));
        let (from, to) = (from - grid.origin(), to - grid.origin());
        let cell_mm = grid.cell_mm();
        let columns = span(from.x_mm, to.x_mm, cell_mm, &(0..grid.columns()));
        let rows = span(from.y_mm, to.y_mm, cell_mm, &(0..grid.rows()));
        let field = Field::new(grid, (columns, rows), marks, driven);
        let direction_rad = frame.heading_rad;
        let (sin, cos) = libm::sincos(direction_rad);
        let extent = high - low;
        let (columns, rows) = (steps(extent.x_mm) + 1, steps(extent.y_mm) + 1);
        let mut map = Self {
            step: Point::new(STEP_MM * cos, STEP_MM * sin),
            frame: Pose2::at(frame.point_at(low.x_mm, low.y_mm), direction_rad),
            columns,
            rows,
            nodes: Vec::new(),
        };
        let places = places(0..columns, 0..rows);
        let nodes = places.map(|(column, row)| field.node(map.place(column, row)));
        map.nodes = nodes.collect();
        for &point in driven.0 {
            for index in map.within(point, DRIVEN_MM + 0.5 * STEP_MM) {
                map.nodes[index].driven = true;
                map.nodes[index].seen = [true; 2];
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
        let reach = steps(radius_mm);
        let (column, row) = (middle % self.columns, middle / self.columns);
        let columns = column.saturating_sub(reach)..(column + reach + 1).min(self.columns);
        let rows = row.saturating_sub(reach)..(row + reach + 1).min(self.rows);
        places(columns, rows)
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

fn steps(mm: f64) -> usize {
    whole_number((mm / STEP_MM).round())
}

/// Rounded down, 0 at least.
#[allow(clippy::cast_possible_truncation, clippy::cast_sign_loss)] // metres over millimetres
fn whole_number(number: f64) -> usize {
    number.floor().max(0.0) as usize
}

/// Of the columns or rows `within` those from one place to another.
fn span(from_mm: f64, to_mm: f64, cell_mm: f64, within: &Range<usize>) -> Range<usize> {
    let number = |mm: f64| whole_number(mm / cell_mm).clamp(within.start, within.end);
    number(from_mm)..number(to_mm + cell_mm)
}

/// Columns and rows, row by row.
fn places(columns: Range<usize>, rows: Range<usize>) -> impl Iterator<Item = (usize, usize)> {
    rows.flat_map(move |row| columns.clone().map(move |column| (column, row)))
}

fn local(point: Point, frame: &Pose2) -> Point {
    Pose2::at(point, 0.0).relative_to(frame).position()
}

/// The smallest and the largest coordinates.
fn bounds(points: impl Iterator<Item = Point>) -> (Point, Point) {
    let infinite = Point::new(f64::INFINITY, f64::INFINITY);
    points.fold((infinite, infinite * -1.0), |(low, high), at| {
        (
            Point::new(low.x_mm.min(at.x_mm), low.y_mm.min(at.y_mm)),
            Point::new(high.x_mm.max(at.x_mm), high.y_mm.max(at.y_mm)),
        )
    })
}

/// Distances on a rectangle of the grid itself, in [`FRACTION`]s of a millimetre.
struct Field<'a> {
    grid: &'a Grid,
    columns: Range<usize>,
    rows: Range<usize>,
    cells: Vec<Cell>,
    clearance: Vec<u32>,
    known: Vec<u32>,
}

impl<'a> Field<'a> {
    fn new(
        grid: &'a Grid,
        (columns, rows): (Range<usize>, Range<usize>),
        marks: &[Point],
        (way, body_mm): Driven<'_>,
    ) -> Self {
        let places = places(columns.clone(), rows.clone());
        let mut cells: Vec<Cell> = places.map(|(column, row)| grid.cell(column, row)).collect();
        let mut field = Self {
            grid,
            columns,
            rows,
            cells: Vec::new(),
            clearance: Vec::new(),
            known: Vec::new(),
        };
        for &point in way {
            field.stamp(point, body_mm, |index, square| {
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
        let span = |mm: f64, within| span(mm - radius_mm, mm + radius_mm, cell_mm, within);
        let off_mm = |from_mm: f64, nth: usize| (nth as f64 + 0.5) * cell_mm - from_mm;
        let (x_mm, y_mm) = (point.x_mm - origin.x_mm, point.y_mm - origin.y_mm);
        let columns = span(x_mm, &self.columns);
        for row in span(y_mm, &self.rows) {
            let aside = off_mm(y_mm, row).powi(2);
            for column in columns.clone() {
                let square = off_mm(x_mm, column).powi(2) + aside;
                if square <= radius_mm * radius_mm {
                    each(self.index(column, row), square);
                }
            }
        }
    }

    fn index(&self, column: usize, row: usize) -> usize {
        (row - self.rows.start) * self.columns.len() + column - self.columns.start
    }

    /// Distance of every cell to the nearest source: Borgefors' two-pass chamfer transform
    /// with the weights that err least (Borgefors, "Distance transformations in digital images",
    /// 1986), inside a frame of cells without a source.
    #[allow(clippy::cast_possible_truncation, clippy::cast_sign_loss)] // weights
    fn distances(&self, is_source: impl Fn(usize) -> bool) -> Vec<u32> {
        let (columns, rows) = (self.columns.len(), self.rows.len());
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

    fn node(&self, point: Point) -> Node {
        let (origin, cell_mm) = (self.grid.origin(), self.grid.cell_mm());
        let number = |mm: f64, range: &Range<usize>| {
            let number = whole_number(mm / cell_mm);
            (mm >= 0.0 && range.contains(&number)).then_some(number)
        };
        let index = number(point.x_mm - origin.x_mm, &self.columns)
            .zip(number(point.y_mm - origin.y_mm, &self.rows))
            .map(|(column, row)| self.index(column, row));
        // From middle to middle of cells; what that hides at the usual cell is in the margins.
        let hidden_mm = 1.2 * (cell_mm - USUAL_CELL_MM).max(0.0);
        let distance_mm = |distance: u32| (f64::from(distance) / FRACTION - hidden_mm).max(0.0);
        Node {
            clearance_mm: index.map_or(f64::INFINITY, |index| distance_mm(self.clearance[index])),
            known_mm: index.map_or(0.0, |index| distance_mm(self.known[index])),
            cell: index.map_or(Cell::Unknown, |index| self.cells[index]),
            driven: false,
            seen: [false; 2],
        }
    }
}

#[cfg(test)]
pub(crate) mod tests;

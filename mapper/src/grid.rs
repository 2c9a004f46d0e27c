//! The map: square cells with the log-odds of being occupied.

use crate::Point;

/// State of a cell.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Cell {
    /// Probability above [`Grid::OCCUPIED`].
    Occupied,
    /// Probability below [`Grid::FREE`].
    Free,
    /// Neither.
    Unknown,
}

fn probability(log_odds: f32) -> f32 {
    1.0 - 1.0 / (1.0 + libm::expf(log_odds))
}

impl Cell {
    #[inline]
    fn of(log_odds: f32) -> Self {
        if log_odds > OCCUPIED_LOG_ODDS {
            Self::Occupied
        } else if log_odds < FREE_LOG_ODDS {
            Self::Free
        } else {
            Self::Unknown
        }
    }
}

/// A grid of log-odds that grows where it is written to. A cell that was never written has the
/// log-odds 0: probability one half.
#[derive(Clone, Debug)]
pub struct Grid {
    cell_mm: f64,
    /// Number of the first column and row: cell (0, 0) has its lower left corner at the origin.
    first: (i32, i32),
    columns: usize,
    rows: usize,
    log_odds: Vec<f32>,
}

/// The grid grows by this many cells at a time.
const GROWTH: i32 = 32;
/// Log-odds of [`Grid::OCCUPIED`] and [`Grid::FREE`].
const OCCUPIED_LOG_ODDS: f32 = 0.619_039_2;
const FREE_LOG_ODDS: f32 = -1.411_484_6;
/// Farthest cell from the origin: 50 m at 25 mm. Readings beyond come from a lost robot.
pub const FARTHEST: i32 = 2000;
/// Log-odds are limited to ± this, so that a changed world can still change the map.
const LIMIT: f32 = 6.0;

impl Grid {
    /// Probability above which a cell counts as occupied (the map server's `occupied_thresh`).
    pub const OCCUPIED: f32 = 0.65;
    /// Probability below which a cell counts as free (the map server's `free_thresh`).
    pub const FREE: f32 = 0.196;

    /// An empty grid of cells `cell_mm` wide.
    pub const fn new(cell_mm: f64) -> Self {
        Self {
            cell_mm,
            first: (0, 0),
            columns: 0,
            rows: 0,
            log_odds: Vec::new(),
        }
    }

    /// A grid over the rectangle between two corners, its cells' log-odds given by their middle.
    pub fn from_fn(cell_mm: f64, low: Point, high: Point, log_odds: impl Fn(Point) -> f32) -> Self {
        let mut grid = Self::new(cell_mm);
        let (columns, rows) = grid.cover(low.x_mm..high.x_mm, low.y_mm..high.y_mm);
        for row in rows {
            for column in columns.clone() {
                grid.add(column, row, log_odds(grid.middle(column, row)));
            }
        }
        grid
    }

    /// Width of a cell, mm.
    pub const fn cell_mm(&self) -> f64 {
        self.cell_mm
    }

    /// Columns (along x).
    pub const fn columns(&self) -> usize {
        self.columns
    }

    /// Rows (along y).
    pub const fn rows(&self) -> usize {
        self.rows
    }

    /// The lower left corner of the whole grid.
    pub fn origin(&self) -> Point {
        Point::new(self.first.0.into(), self.first.1.into()) * self.cell_mm
    }

    /// Middle of the cell in this column and row.
    #[allow(clippy::cast_precision_loss)] // at most 4000
    pub fn middle(&self, column: usize, row: usize) -> Point {
        self.origin() + Point::new(column as f64 + 0.5, row as f64 + 0.5) * self.cell_mm
    }

    /// Log-odds of the cell in this column and row; 0 outside the grid.
    #[inline]
    pub fn log_odds(&self, column: usize, row: usize) -> f32 {
        if column < self.columns && row < self.rows {
            self.log_odds[row * self.columns + column]
        } else {
            0.0
        }
    }

    /// Probability (0..1) that the cell is occupied.
    pub fn probability(&self, column: usize, row: usize) -> f32 {
        probability(self.log_odds(column, row))
    }

    /// State of the cell in this column and row.
    #[inline]
    pub fn cell(&self, column: usize, row: usize) -> Cell {
        Cell::of(self.log_odds(column, row))
    }

    /// Log-odds of the cell at a point; 0 outside the grid.
    pub fn log_odds_at(&self, point: Point) -> f32 {
        let index = |mm: f64, first: i32| usize::try_from(self.number(mm) - first);
        let column = index(point.x_mm, self.first.0);
        match (column, index(point.y_mm, self.first.1)) {
            (Ok(column), Ok(row)) => self.log_odds(column, row),
            _ => 0.0,
        }
    }

    /// State of the cell at a point; unknown outside the grid.
    pub fn cell_at(&self, point: Point) -> Cell {
        Cell::of(self.log_odds_at(point))
    }

    /// Column and row of every cell, row by row from the lower left.
    pub fn cells(&self) -> impl Iterator<Item = (usize, usize)> + '_ {
        (0..self.rows).flat_map(|row| (0..self.columns).map(move |column| (column, row)))
    }

    /// The middle of every occupied cell, in the order of [`Self::cells`].
    pub fn occupied(&self) -> impl Iterator<Item = Point> + '_ {
        self.cells()
            .filter(|&(column, row)| self.cell(column, row) == Cell::Occupied)
            .map(|(column, row)| self.middle(column, row))
    }

    /// Adds evidence to the cell at a point, within 2000 cells around the origin.
    pub fn add_at(&mut self, point: Point, log_odds: f32) {
        let Point { x_mm, y_mm } = point;
        let (columns, rows) = self.cover(x_mm..x_mm, y_mm..y_mm);
        self.add(columns.start, rows.start, log_odds);
    }

    /// Adds evidence to a cell that is inside the grid.
    pub(crate) fn add(&mut self, column: usize, row: usize, log_odds: f32) {
        if column < self.columns && row < self.rows {
            let cell = &mut self.log_odds[row * self.columns + column];
            *cell = (*cell + log_odds).clamp(-LIMIT, LIMIT);
        }
    }

    /// Makes room for the rectangle (mm) and returns the columns and rows it covers. Clipped to
    /// 2000 cells around the origin.
    pub(crate) fn cover(
        &mut self,
        x: std::ops::Range<f64>,
        y: std::ops::Range<f64>,
    ) -> (std::ops::Range<usize>, std::ops::Range<usize>) {
        let low = (self.number(x.start), self.number(y.start));
        let high = (self.number(x.end) + 1, self.number(y.end) + 1);
        self.grow(low, high);
        let part = |number: i32, first: i32| usize::try_from(number - first).unwrap_or(0);
        (
            part(low.0, self.first.0)..part(high.0, self.first.0),
            part(low.1, self.first.1)..part(high.1, self.first.1),
        )
    }

    #[allow(clippy::cast_possible_truncation)] // clamped
    fn number(&self, mm: f64) -> i32 {
        let number = (mm / self.cell_mm).floor();
        number.clamp((-FARTHEST).into(), FARTHEST.into()) as i32
    }

    fn grow(&mut self, low: (i32, i32), high: (i32, i32)) {
        let size = |cells: usize| i32::try_from(cells).unwrap_or(i32::MAX);
        let (x, y) = self.first;
        let last = (x + size(self.columns), y + size(self.rows));
        let empty = self.log_odds.is_empty();
        let inside = low.0 >= x && low.1 >= y && high.0 <= last.0 && high.1 <= last.1;
        if !empty && inside {
            return;
        }
        let down = |number: i32| number.div_euclid(GROWTH) * GROWTH;
        let up = |number: i32| (number + GROWTH - 1).div_euclid(GROWTH) * GROWTH;
        let mut first = (down(low.0), down(low.1));
        let mut end = (up(high.0), up(high.1));
        if !empty {
            first = (first.0.min(self.first.0), first.1.min(self.first.1));
            end = (end.0.max(last.0), end.1.max(last.1));
        }
        let columns = usize::try_from(end.0 - first.0).unwrap_or(0);
        let rows = usize::try_from(end.1 - first.1).unwrap_or(0);
        let mut log_odds = vec![0.0; columns * rows];
        let right = usize::try_from(self.first.0 - first.0).unwrap_or(0);
        let above = usize::try_from(self.first.1 - first.1).unwrap_or(0);
        for row in 0..self.rows {
            let to = (row + above) * columns + right;
            log_odds[to..to + self.columns]
                .copy_from_slice(&self.log_odds[row * self.columns..(row + 1) * self.columns]);
        }
        *self = Self {
            first,
            columns,
            rows,
            log_odds,
            ..*self
        };
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    fn cover_point(grid: &mut Grid, x_mm: f64, y_mm: f64) -> (usize, usize) {
        let (columns, rows) = grid.cover(x_mm..x_mm, y_mm..y_mm);
        (columns.start, rows.start)
    }

    #[test]
    fn growing_keeps_evidence_in_place() {
        let mut grid = Grid::new(25.0);
        let (column, row) = cover_point(&mut grid, 10.0, 10.0);
        grid.add(column, row, 2.0);
        cover_point(&mut grid, -3000.0, -100.0);
        cover_point(&mut grid, 100.0, 5000.0);
        let (column, row) = cover_point(&mut grid, 10.0, 10.0);
        assert!((grid.log_odds(column, row) - 2.0).abs() < 1e-6);
        let written = |&(c, r): &(usize, usize)| grid.log_odds(c, r) != 0.0;
        assert_eq!(grid.cells().filter(written).count(), 1);
        let middle = grid.middle(column, row);
        assert!(middle.distance_mm(Point::new(12.5, 12.5)) < 1e-9);
    }

    #[test]
    fn thresholds_of_log_odds_are_those_of_probability() {
        assert!((probability(OCCUPIED_LOG_ODDS) - Grid::OCCUPIED).abs() < 1e-6);
        assert!((probability(FREE_LOG_ODDS) - Grid::FREE).abs() < 1e-6);
    }

    #[test]
    fn size_is_limited_for_any_coordinates() {
        let mut grid = Grid::new(25.0);
        grid.cover(-1e9..f64::NAN, 0.0..f64::INFINITY);
        assert!(grid.columns() * grid.rows() <= 4100 * 4100);
    }

    #[test]
    fn log_odds_saturate_and_decide_state() {
        let mut grid = Grid::new(25.0);
        let (column, row) = cover_point(&mut grid, 0.0, 0.0);
        assert_eq!(grid.cell(column, row), Cell::Unknown);
        for _ in 0..100 {
            grid.add(column, row, 1.0);
        }
        assert_eq!(grid.cell(column, row), Cell::Occupied);
        assert!(grid.probability(column, row) < 0.999);
        for _ in 0..8 {
            grid.add(column, row, -1.0);
        }
        assert_eq!(grid.cell(column, row), Cell::Free);
    }
}

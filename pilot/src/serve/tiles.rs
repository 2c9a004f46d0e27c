//! The map in tiles: what changed goes to the clients, a few tiles a frame.

use super::protocol::Tile;
use mapper::{Cell, Grid, Point};
use std::collections::HashMap;

/// Cells along the side of a tile.
pub const SIDE: i32 = 32;
/// Tiles in one message, and tiles compared with the map in one frame.
pub const BATCH: usize = 8;

/// The tiles of one map, in the order of their first content.
#[derive(Default)]
pub struct Tiles {
    all: Vec<Tile>,
    numbers: HashMap<(i32, i32), usize>,
    /// The next tile to compare, row by row over the grid.
    next: usize,
}

impl Tiles {
    /// The tiles from this number on, at most [`BATCH`].
    pub fn from(&self, number: usize) -> &[Tile] {
        let rest = self.all.get(number..).unwrap_or_default();
        &rest[..rest.len().min(BATCH)]
    }

    /// Compares the next tiles with the grid; the numbers of those that changed.
    // Requirement: SERVE-map-1
    pub fn update(&mut self, grid: &Grid) -> Vec<usize> {
        let first = [grid.origin().x_mm, grid.origin().y_mm].map(|mm| nearest(mm / grid.cell_mm()));
        let span = |first: i32, cells: usize| {
            let last = first.saturating_add(i32::try_from(cells).unwrap_or(i32::MAX)) - 1;
            first.div_euclid(SIDE)..=last.div_euclid(SIDE)
        };
        let (columns, rows) = (span(first[0], grid.columns()), span(first[1], grid.rows()));
        let all = rows.flat_map(|row| columns.clone().map(move |column| (column, row)));
        let batch: Vec<_> = all.skip(self.next).take(BATCH).collect();
        let next = self.next + BATCH;
        self.next = if batch.len() < BATCH { 0 } else { next };
        let mut changed = Vec::new();
        for (column, row) in batch {
            let cells = cells(grid, first, column, row);
            match self.numbers.get(&(column, row)) {
                Some(&number) if self.all[number].cells == cells => {}
                Some(&number) => {
                    self.all[number].cells = cells;
                    changed.push(number);
                }
                None if cells.trim().is_empty() => {}
                None => {
                    self.numbers.insert((column, row), self.all.len());
                    changed.push(self.all.len());
                    self.all.push(Tile { column, row, cells });
                }
            }
        }
        changed
    }

    /// A tile by its number.
    pub fn tile(&self, number: usize) -> &Tile {
        &self.all[number]
    }
}

fn cells(grid: &Grid, first: [i32; 2], column: i32, row: i32) -> String {
    let state = |index: i32| {
        let x = column * SIDE + index % SIDE - first[0];
        let y = row * SIDE + index / SIDE - first[1];
        match (usize::try_from(x), usize::try_from(y)) {
            (Ok(x), Ok(y)) => match grid.cell(x, y) {
                Cell::Occupied => '#',
                Cell::Free => '.',
                Cell::Unknown => ' ',
            },
            _ => ' ',
        }
    };
    (0..SIDE * SIDE).map(state).collect()
}

#[allow(clippy::cast_possible_truncation)] // a grid has at most 4000 cells a side
fn nearest(cells: f64) -> i32 {
    cells.round() as i32
}

/// A grid out of tiles.
pub(crate) fn grid(tiles: &HashMap<(i32, i32), String>, cell_mm: f64) -> Grid {
    let mm = |tile: i32| f64::from(tile) * f64::from(SIDE) * cell_mm;
    let ends = |axis: fn(&(i32, i32)) -> i32| {
        let low = tiles.keys().map(axis).min().unwrap_or_default();
        (
            low,
            tiles.keys().map(axis).max().map_or(low, |high| high + 1),
        )
    };
    let ((west, east), (south, north)) = (ends(|key| key.0), ends(|key| key.1));
    // Half a cell inside: the corners name the outermost cells.
    let inside = cell_mm / 2.0;
    let low = Point::new(mm(west) + inside, mm(south) + inside);
    let high = Point::new(mm(east) - inside, mm(north) - inside);
    Grid::from_fn(cell_mm, low, high, |point| {
        let cell = [point.x_mm, point.y_mm].map(|mm| nearest((mm / cell_mm).floor()));
        let tile = (cell[0].div_euclid(SIDE), cell[1].div_euclid(SIDE));
        let index = cell[1].rem_euclid(SIDE) * SIDE + cell[0].rem_euclid(SIDE);
        let state = usize::try_from(index).ok().zip(tiles.get(&tile));
        match state.and_then(|(index, cells)| cells.as_bytes().get(index)) {
            Some(b'#') => 4.0,
            Some(b'.') => -4.0,
            _ => 0.0,
        }
    })
}

#[cfg(test)]
mod tests {
    use super::*;

    // Requirement: SERVE-map-1
    #[test]
    fn tiles_of_a_map_give_the_same_map() {
        let wall = |x_mm: f64| {
            Grid::from_fn(
                25.0,
                Point::new(-900.0, -30.0),
                Point::new(1700.0, 820.0),
                move |point| {
                    let near = (point.x_mm - x_mm).abs() < 30.0;
                    if near { 3.0 } else { -3.0 }
                },
            )
        };
        let (mut tiles, mut known) = (Tiles::default(), HashMap::new());
        for x_mm in [-500.0, 1000.0] {
            let map = wall(x_mm);
            let mut sent = 0;
            for _ in 0..10 {
                for number in tiles.update(&map) {
                    let Tile { column, row, cells } = tiles.tile(number).clone();
                    known.insert((column, row), cells);
                    sent += 1;
                }
            }
            assert!(sent > 0);
            let copy = grid(&known, 25.0);
            for (column, row) in map.cells() {
                let at = map.middle(column, row);
                assert_eq!(copy.cell_at(at), map.cell(column, row), "{at:?}");
            }
        }
        assert!((0..10).all(|_| tiles.update(&wall(1000.0)).is_empty()));
    }
}

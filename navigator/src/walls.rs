//! The direction of the walls.

use std::f64::consts::FRAC_PI_2;

use mapper::{Cell, Grid};

/// Pairs of occupied cells this many columns or rows apart vote.
const PAIR: std::ops::RangeInclusive<i32> = 5..=10;

/// The direction, radians in −π/4..=π/4, along or across which most walls run; 0 where the map
/// has none. Every pair of occupied cells some decimetres apart votes with four times its
/// direction, so that opposite and perpendicular walls agree.
pub(crate) fn direction_rad(grid: &Grid) -> f64 {
    let farthest = *PAIR.end();
    // The end of every row is a margin, so that no pair reaches into the next one.
    let width = grid.columns() + farthest.unsigned_abs() as usize;
    let mut occupied = vec![false; width * grid.rows()];
    for (column, row) in grid.cells() {
        occupied[row * width + column] = grid.cell(column, row) == Cell::Occupied;
    }
    let votes: Vec<(usize, f64, f64)> = (0..=farthest)
        .flat_map(|up| (-farthest..=farthest).map(move |right| (right, up)))
        .filter(|&(right, up)| {
            let square = right * right + up * up;
            (up > 0 || right > 0) && (PAIR.start().pow(2)..=farthest * farthest).contains(&square)
        })
        .map(|(right, up)| {
            let (sin, cos) = libm::sincos(4.0 * libm::atan2(up.into(), right.into()));
            let rows = up.unsigned_abs() as usize * width;
            (rows.saturating_add_signed(right as isize), cos, sin)
        })
        .collect();
    let mut sum = (0.0, 0.0);
    for cell in (0..occupied.len()).filter(|&cell| occupied[cell]) {
        for &(offset, cos, sin) in &votes {
            if occupied.get(cell + offset) == Some(&true) {
                sum = (sum.0 + cos, sum.1 + sin);
            }
        }
    }
    libm::atan2(sum.1, sum.0) / 4.0
}

/// Of the four directions along and across the walls the one nearest to a heading, within π/4 of it, radians.
pub(crate) fn nearest_rad(heading_rad: f64, walls_rad: f64) -> f64 {
    walls_rad + ((heading_rad - walls_rad) / FRAC_PI_2).round() * FRAC_PI_2
}

/// Whether one of these four directions is across the walls'.
pub(crate) fn is_across(direction_rad: f64, walls_rad: f64) -> bool {
    libm::sin(direction_rad - walls_rad).abs() > 0.5
}

#[cfg(test)]
mod tests {
    use super::*;
    use geometry::{Point, Segment};

    #[test]
    fn direction_of_turned_room_is_found() {
        for degrees in [-40.0f64, -20.0, 0.0, 7.0, 30.0] {
            let (sin, cos) = libm::sincos(degrees.to_radians());
            let at = |x: f64, y: f64| Point::new(x * cos - y * sin, x * sin + y * cos);
            let corners = [
                at(0.0, 0.0),
                at(2000.0, 0.0),
                at(2000.0, 1200.0),
                at(0.0, 1200.0),
            ];
            let walls: Vec<Segment> = (0..3)
                .map(|nth| Segment::new(corners[nth], corners[nth + 1]))
                .collect();
            let (low, high) = (Point::new(-2500.0, -2500.0), Point::new(2500.0, 2500.0));
            let grid = Grid::from_fn(25.0, low, high, |point| {
                let wall = walls.iter().any(|wall| wall.distance_mm(point) < 20.0);
                if wall { 4.0 } else { 0.0 }
            });
            let found = direction_rad(&grid).to_degrees();
            assert!((found - degrees).abs() < 2.0, "{found} {degrees}");
        }
        assert!(direction_rad(&Grid::new(25.0)).abs() < 1e-9);
    }
}

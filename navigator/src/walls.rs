//! The direction of the walls.

use mapper::Grid;

/// Pairs of occupied cells this many columns or rows apart vote.
const PAIR: std::ops::RangeInclusive<i32> = 5..=10;

/// The direction, radians in −π/4..=π/4, along or across which most walls run; 0 where the map
/// has none. Every pair of occupied cells some decimetres apart votes with four times its
/// direction, so that opposite and perpendicular walls agree.
pub(crate) fn direction_rad(grid: &Grid) -> f64 {
    let occupied_from = libm::logf(Grid::OCCUPIED / (1.0 - Grid::OCCUPIED));
    let occupied = |column, row| grid.log_odds(column, row) > occupied_from;
    let farthest = *PAIR.end();
    let votes: Vec<(isize, isize, f64, f64)> = (0..=farthest)
        .flat_map(|up| (-farthest..=farthest).map(move |right| (right, up)))
        .filter(|&(right, up)| {
            let square = right * right + up * up;
            (up > 0 || right > 0) && (PAIR.start().pow(2)..=farthest * farthest).contains(&square)
        })
        .map(|(right, up)| {
            let (sin, cos) = libm::sincos(4.0 * libm::atan2(up.into(), right.into()));
            (right as isize, up as isize, cos, sin)
        })
        .collect();
    let mut sum = (0.0, 0.0);
    for (column, row) in grid.cells().filter(|&(column, row)| occupied(column, row)) {
        for &(right, up, cos, sin) in &votes {
            let other = column
                .checked_add_signed(right)
                .zip(row.checked_add_signed(up));
            if other.is_some_and(|(column, row)| occupied(column, row)) {
                sum = (sum.0 + cos, sum.1 + sin);
            }
        }
    }
    libm::atan2(sum.1, sum.0) / 4.0
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

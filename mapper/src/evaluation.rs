//! How well a map agrees with walls that are known.

use crate::{Cell, Grid, Segment};

/// The comparison of a map with the truth; every figure in 0..=1.
#[derive(Clone, Copy, Debug, Default, PartialEq)]
pub struct Agreement {
    /// Share of the occupied cells whose middle lies within the tolerance of a true wall.
    pub precision: f64,
    /// Share of the true walls' length that lies within the tolerance of an occupied cell's middle.
    pub recall: f64,
    /// Both in one: see [`map_iou`].
    pub iou: f64,
}

/// Pieces that the walls are judged in, mm.
const PIECE_MM: f64 = 10.0;

/// Compares the occupied cells of `grid` with the true `walls` (in the grid's frame), with a
/// tolerance in millimetres.
///
/// With P the share of occupied cells within the tolerance of a wall (by the cell's middle) and R
/// the share of the walls' length within the tolerance of an occupied cell, the figure is the
/// intersection over union that belongs to such a precision and recall:
/// `iou = P·R / (P + R − P·R)`, that is `1/iou = 1/P + 1/R − 1`. It is 1 if and only if every
/// occupied cell is at a wall and every wall is in the map, 0 if nothing matches or either side is
/// empty, and never more than the smaller of P and R. Free and unknown cells do not enter.
///
/// `walls` should be the surfaces that can be seen at all: a wall behind a cupboard is not missing.
#[must_use]
pub fn map_iou(grid: &Grid, walls: &[Segment], tolerance_mm: f64) -> Agreement {
    let occupied: Vec<(f64, f64)> = grid
        .cells()
        .filter(|&(column, row)| grid.cell(column, row) == Cell::Occupied)
        .map(|(column, row)| grid.middle_mm(column, row))
        .collect();
    let at_wall = occupied
        .iter()
        .filter(|&&(x, y)| walls.iter().any(|wall| wall.distance(x, y) <= tolerance_mm))
        .count();
    let (mut length, mut mapped) = (0.0, 0.0);
    for wall in walls {
        let pieces = pieces(wall.length());
        let each = wall.length() / f64::from(pieces);
        for piece in 0..pieces {
            let (x, y) = wall.at((f64::from(piece) + 0.5) / f64::from(pieces));
            length += each;
            if occupied
                .iter()
                .any(|&(cx, cy)| (cx - x).hypot(cy - y) <= tolerance_mm)
            {
                mapped += each;
            }
        }
    }
    if at_wall == 0 || mapped <= 0.0 {
        return Agreement::default();
    }
    let precision = count(at_wall) / count(occupied.len());
    let recall = mapped / length;
    let iou = precision * recall / (precision + recall - precision * recall);
    Agreement {
        precision,
        recall,
        iou,
    }
}

#[allow(clippy::cast_possible_truncation, clippy::cast_sign_loss)] // metres of wall
fn pieces(length: f64) -> u32 {
    (length / PIECE_MM).ceil().max(1.0) as u32
}

#[allow(clippy::cast_precision_loss)] // far below 2^53
fn count(cells: usize) -> f64 {
    cells as f64
}

#[cfg(test)]
mod tests {
    use super::*;

    /// A map with an occupied line of cells at `y`, from 0 to `length`.
    fn line(y: f64, length: f64) -> Grid {
        let mut grid = Grid::new(25.0);
        let (columns, rows) = grid.cover(1.0..length - 1.0, y..y);
        for column in columns {
            grid.add(column, rows.start, 5.0);
        }
        grid
    }

    const WALL: Segment = Segment::new(0.0, 12.5, 1000.0, 12.5);

    #[test]
    fn a_perfect_map_scores_one_and_an_empty_one_zero() {
        let perfect = map_iou(&line(10.0, 1000.0), &[WALL], 100.0);
        assert_eq!(
            perfect,
            Agreement {
                precision: 1.0,
                recall: 1.0,
                iou: 1.0
            }
        );
        assert_eq!(
            map_iou(&Grid::new(25.0), &[WALL], 100.0),
            Agreement::default()
        );
        assert_eq!(
            map_iou(&line(10.0, 1000.0), &[], 100.0),
            Agreement::default()
        );
    }

    #[test]
    fn a_map_beside_the_wall_scores_by_the_tolerance() {
        let beside = line(80.0, 1000.0);
        assert!(map_iou(&beside, &[WALL], 100.0).iou > 0.95);
        assert_eq!(map_iou(&beside, &[WALL], 50.0), Agreement::default());
    }

    #[test]
    fn half_the_wall_is_half_the_recall() {
        let half = map_iou(&line(10.0, 500.0), &[WALL], 1.0e-9 + 12.6);
        assert!((half.precision - 1.0).abs() < 1e-9);
        assert!((half.recall - 0.5).abs() < 0.02 && (half.iou - half.recall).abs() < 1e-9);
    }

    #[test]
    fn what_is_not_there_costs_precision() {
        let walls = [Segment::new(0.0, 12.5, 500.0, 12.5)];
        let ghost = map_iou(&line(10.0, 1000.0), &walls, 13.0);
        assert!((ghost.precision - 0.5).abs() < 0.05 && (ghost.recall - 1.0).abs() < 1e-9);
        assert!((ghost.iou - ghost.precision).abs() < 1e-9);
    }
}

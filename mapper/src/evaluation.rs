//! Comparison of a map with known walls.

use crate::{Cell, Grid, Point, Segment};

/// The comparison of a map with the truth; every figure in 0..=1.
#[derive(Clone, Copy, Debug, Default, PartialEq)]
pub struct MapScore {
    /// Share of the occupied cells whose middle lies within the tolerance of a true wall.
    pub precision: f64,
    /// Share of the true walls' length that lies within the tolerance of an occupied cell's middle.
    pub recall: f64,
    /// Both in one: see [`map_iou`].
    pub iou: f64,
}

/// Length of the pieces in which walls are judged, mm.
const PIECE_MM: f64 = 10.0;

/// Compares the occupied cells of `grid` with the true `walls` (in the grid's frame), with a
/// tolerance in millimetres.
///
/// With the precision P and the recall R, the figure is the intersection over union
/// `iou = P·R / (P + R − P·R)`, that is `1/iou = 1/P + 1/R − 1`. It is 1 if and only if every
/// occupied cell is at a wall and every wall is in the map, 0 if nothing matches or either side is
/// empty, and never more than the smaller of P and R. Free and unknown cells do not count.
///
/// `walls` should hold the visible surfaces alone: a wall behind a cupboard is not missing.
#[must_use]
pub fn map_iou(grid: &Grid, walls: &[Segment], tolerance_mm: f64) -> MapScore {
    let occupied: Vec<Point> = grid
        .cells()
        .filter(|&(column, row)| grid.cell(column, row) == Cell::Occupied)
        .map(|(column, row)| grid.middle(column, row))
        .collect();
    let near = |point: Point| {
        occupied
            .iter()
            .any(|&c| c.distance_mm(point) <= tolerance_mm)
    };
    let at_wall = |&&cell: &&Point| walls.iter().any(|w| w.distance_mm(cell) <= tolerance_mm);
    let matched = occupied.iter().filter(at_wall).count();
    let (mut length, mut mapped) = (0.0, 0.0);
    for piece in walls.iter().flat_map(|wall| wall.pieces(PIECE_MM)) {
        length += piece.length_mm();
        if near(piece.from.lerp(piece.to, 0.5)) {
            mapped += piece.length_mm();
        }
    }
    if matched == 0 || mapped <= 0.0 {
        return MapScore::default();
    }
    #[allow(clippy::cast_precision_loss)] // far below 2^53
    let precision = matched as f64 / occupied.len() as f64;
    let recall = mapped / length;
    MapScore {
        precision,
        recall,
        iou: precision * recall / (precision + recall - precision * recall),
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    /// A map with an occupied line of cells at `y_mm`, from 0 to `length_mm`.
    fn line(y_mm: f64, length_mm: f64) -> Grid {
        let mut grid = Grid::new(25.0);
        let (columns, rows) = grid.cover(1.0..length_mm - 1.0, y_mm..y_mm);
        for column in columns {
            grid.add(column, rows.start, 5.0);
        }
        grid
    }

    /// A wall along y = 12.5 mm.
    fn wall(length_mm: f64) -> [Segment; 1] {
        [Segment::new(
            Point::new(0.0, 12.5),
            Point::new(length_mm, 12.5),
        )]
    }

    #[test]
    fn score_of_known_maps_matches_precision_and_recall() {
        let (full, half) = (line(10.0, 1000.0), line(10.0, 500.0));
        let (empty, beside) = (Grid::new(25.0), line(80.0, 1000.0));
        for (name, map, walls, tolerance_mm, [precision, recall, iou]) in [
            ("perfect", &full, &wall(1000.0)[..], 100.0, [1.0, 1.0, 1.0]),
            ("empty map", &empty, &wall(1000.0), 100.0, [0.0; 3]),
            ("no walls", &full, &[], 100.0, [0.0; 3]),
            ("beside, within", &beside, &wall(1000.0), 100.0, [1.0; 3]),
            ("beside, beyond", &beside, &wall(1000.0), 50.0, [0.0; 3]),
            ("half mapped", &half, &wall(1000.0), 12.6, [1.0, 0.5, 0.5]),
            ("half real", &full, &wall(500.0), 13.0, [0.5, 1.0, 0.5]),
        ] {
            let score = map_iou(map, walls, tolerance_mm);
            let off = [
                score.precision - precision,
                score.recall - recall,
                score.iou - iou,
            ];
            assert!(off.iter().all(|off| off.abs() < 0.05), "{name}: {score:?}");
        }
    }
}

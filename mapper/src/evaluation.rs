//! Comparison of a map and of estimated poses with the truth, which only the caller knows.
//!
//! Poses and map are compared after an alignment, a pose of the estimate's frame in the truth's:
//! [`best_alignment`] of the whole run, as trajectory benchmarks do, or [`start_alignment`].

use geometry::wrap_angle;

use crate::{Cell, Grid, Point, Pose2, Segment};

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
pub fn map_iou(grid: &Grid, walls: &[Segment], tolerance_mm: f64) -> MapScore {
    let occupied: Vec<Point> = grid.occupied().collect();
    let near = |point: Point| {
        let mut cells = occupied.iter();
        cells.any(|&c| c.distance_mm(point) <= tolerance_mm)
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

/// The rigid motion, without scale, that brings the positions of `estimate` nearest to those of `truth`
/// at the same times, by least squares: the estimate's frame in the truth's. Where the positions do
/// not determine the rotation (a robot that stood), the headings do. The identity without poses.
pub fn best_alignment(estimate: &[Pose2], truth: &[Pose2]) -> Pose2 {
    #[allow(clippy::cast_precision_loss)] // far below 2^53
    let count = estimate.len().min(truth.len()).max(1) as f64;
    let mean = |poses: &[Pose2]| {
        let pairs = poses.iter().take(estimate.len().min(truth.len()));
        let sum = pairs.fold(Point::default(), |sum, pose| sum + pose.position());
        Point::new(sum.x_mm / count, sum.y_mm / count)
    };
    let (from, to) = (mean(estimate), mean(truth));
    // Kabsch's rotation in the plane; each heading weighs as little as a square millimetre.
    let (mut sin, mut cos) = (0.0, 0.0);
    for (e, t) in estimate.iter().zip(truth) {
        let (a, b) = (e.position() - from, t.position() - to);
        let (turn_sin, turn_cos) = libm::sincos(t.heading_rad - e.heading_rad);
        sin += a.cross(b) + turn_sin;
        cos += a.dot(b) + turn_cos;
    }
    let rotation = Pose2::new(0.0, 0.0, libm::atan2(sin, cos));
    let turned = rotation.point_at(from.x_mm, from.y_mm);
    Pose2::at(to - turned, rotation.heading_rad)
}

/// The alignment that makes the first poses equal.
pub fn start_alignment(estimate: &Pose2, truth: &Pose2) -> Pose2 {
    truth.compose(&Pose2::default().relative_to(estimate))
}

/// Differences of aligned poses from the truth.
#[derive(Clone, Copy, Debug, Default, PartialEq)]
pub struct PoseErrors {
    /// Median of the position's error, mm.
    pub position_mm_median: f64,
    /// Largest error of the position, mm.
    pub position_mm_max: f64,
    /// Largest error of the heading, degrees.
    pub heading_deg_max: f64,
}

/// The errors of `estimate` at each pose, mm and degrees, after this alignment with `truth`.
pub fn pose_error_series<'a>(
    estimate: &'a [Pose2],
    truth: &'a [Pose2],
    alignment: &'a Pose2,
) -> impl Iterator<Item = (f64, f64)> + 'a {
    estimate.iter().zip(truth).map(|(estimate, truth)| {
        let aligned = alignment.compose(estimate);
        let turn = wrap_angle(truth.heading_rad - aligned.heading_rad);
        (aligned.distance_mm(truth), turn.abs().to_degrees())
    })
}

/// Median and worst of [`pose_error_series`]; zeros without poses.
pub fn pose_errors(estimate: &[Pose2], truth: &[Pose2], alignment: &Pose2) -> PoseErrors {
    let (mut positions, headings): (Vec<f64>, Vec<f64>) =
        pose_error_series(estimate, truth, alignment).unzip();
    positions.sort_by(f64::total_cmp);
    PoseErrors {
        position_mm_median: positions.get(positions.len() / 2).copied().unwrap_or(0.0),
        position_mm_max: positions.last().copied().unwrap_or(0.0),
        heading_deg_max: headings.into_iter().fold(0.0, f64::max),
    }
}

/// Surfaces of the truth's frame in the estimate's, for [`map_iou`].
pub fn in_estimate_frame(surfaces: &[Segment], alignment: &Pose2) -> Vec<Segment> {
    let moved = |point| Pose2::at(point, 0.0).relative_to(alignment).position();
    let moved = |s: &Segment| Segment::new(moved(s.from), moved(s.to));
    surfaces.iter().map(moved).collect()
}

/// Share, 0..=1, of the reachable floor (points in the truth's frame) that the map calls free; 0
/// without such points.
pub fn coverage(grid: &Grid, floor: &[Point], alignment: &Pose2) -> f64 {
    let free = |point: &&Point| {
        let at = Pose2::at(**point, 0.0).relative_to(alignment);
        grid.cell_at(at.position()) == Cell::Free
    };
    #[allow(clippy::cast_precision_loss)] // far below 2^53
    let share = floor.iter().filter(free).count() as f64 / floor.len().max(1) as f64;
    share
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
        let ends = [0.0, length_mm].map(|x_mm| Point::new(x_mm, 12.5));
        [Segment::new(ends[0], ends[1])]
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
            let found = [score.precision, score.recall, score.iou];
            let mut pairs = found.into_iter().zip([precision, recall, iou]);
            assert!(
                pairs.all(|(a, b)| (a - b).abs() < 0.05),
                "{name}: {score:?}"
            );
        }
    }

    /// A run of an ell, seen from a frame that lies at `frame` in the truth's.
    fn run(frame: &Pose2) -> (Vec<Pose2>, Vec<Pose2>) {
        let ahead = (0..50).map(|nth| Pose2::new(20.0 * f64::from(nth), 0.0, 0.0));
        let left = (0..30).map(|nth| Pose2::new(1000.0, 20.0 * f64::from(nth), 1.5));
        let truth: Vec<Pose2> = ahead.chain(left).collect();
        let estimate = truth.iter().map(|pose| pose.relative_to(frame)).collect();
        (estimate, truth)
    }

    #[test]
    fn alignment_recovers_frame_of_estimate() {
        let frame = Pose2::new(300.0, -40.0, 2.5);
        let (estimate, truth) = run(&frame);
        let start = start_alignment(&estimate[0], &truth[0]);
        for found in [best_alignment(&estimate, &truth), start] {
            assert!(found.distance_mm(&frame) < 1e-6 && found.turn_to_rad(&frame).abs() < 1e-9);
            let errors = pose_errors(&estimate, &truth, &found);
            assert!(errors.position_mm_max < 1e-6 && errors.heading_deg_max < 1e-6);
        }
        let stood = best_alignment(&estimate[..1], &truth[..1]);
        assert!(stood.distance_mm(&frame) < 1e-6 && stood.turn_to_rad(&frame).abs() < 1e-9);
        assert_eq!(best_alignment(&[], &[]), Pose2::default());
        assert_eq!(pose_errors(&[], &[], &frame), PoseErrors::default());
    }

    #[test]
    fn pose_errors_have_median_worst_and_wrapped_heading() {
        let (_, truth) = run(&Pose2::default());
        let mut estimate = truth.clone();
        for pose in &mut estimate[..30] {
            pose.y_mm += 8.0;
        }
        estimate[79].heading_rad += std::f64::consts::TAU - 0.1;
        let errors = pose_errors(&estimate, &truth, &Pose2::default());
        assert!(errors.position_mm_median.abs() < 1e-9, "{errors:?}");
        assert!((errors.position_mm_max - 8.0).abs() < 1e-9, "{errors:?}");
        let turned = 0.1_f64.to_degrees();
        assert!((errors.heading_deg_max - turned).abs() < 1e-9, "{errors:?}");
        // The whole run aligned is nearer than the start alone; a scale error is not taken out.
        let best = best_alignment(&estimate, &truth);
        assert!(pose_errors(&estimate, &truth, &best).position_mm_max < 7.9);
        let long: Vec<Pose2> = truth
            .iter()
            .map(|p| Pose2::new(1.1 * p.x_mm, 1.1 * p.y_mm, 0.0))
            .collect();
        assert!(pose_errors(&long, &truth, &best_alignment(&long, &truth)).position_mm_max > 40.0);
    }

    #[test]
    fn coverage_and_map_agreement_follow_alignment() {
        // A free strip and a wall in a map whose frame is turned by 90° and moved.
        let mut grid = line(10.0, 1000.0);
        let (columns, rows) = grid.cover(1.0..999.0, -90.0..-60.0);
        for (column, row) in columns.flat_map(|c| rows.clone().map(move |r| (c, r))) {
            grid.add(column, row, -5.0);
        }
        let frame = Pose2::new(500.0, 100.0, std::f64::consts::FRAC_PI_2);
        let seen = |p: Point| frame.point_at(p.x_mm, p.y_mm);
        let true_walls = wall(1000.0).map(|s| Segment::new(seen(s.from), seen(s.to)));
        let seen = in_estimate_frame(&true_walls, &frame);
        assert!(map_iou(&grid, &seen, 20.0).iou > 0.95);
        let floor: Vec<Point> = (1..80)
            .map(|nth| frame.point_at(25.0 * f64::from(nth), -75.0))
            .collect();
        let covered = coverage(&grid, &floor, &frame);
        assert!((covered - 0.5).abs() < 0.02, "{covered}");
        assert!(coverage(&grid, &floor, &Pose2::default()) < 0.1);
        assert!(coverage(&grid, &[], &frame).abs() < 1e-9);
    }
}

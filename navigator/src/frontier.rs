//! Places worth going to: borders of the unknown, and surfaces that were seen from afar alone.

use std::collections::{BTreeSet, VecDeque};

use geometry::Point;
use mapper::{Cell, Grid};
use rustc_hash::{FxHashMap, FxHashSet};

use crate::cost_map::{CostMap, STEP_MM};
use crate::planner::Reach;
use crate::sight::Sight;

/// Targets of fewer nodes or cells are noise.
const SMALLEST: usize = 4;
/// A target extends this far from its first node, mm; what lies farther is another.
const EXTENT_MM: f64 = 500.0;
/// The middle of a border lies at most this far beyond a door that is drawn too narrow at both its ends, mm.
const BEYOND_MM: f64 = 260.0;
/// New floor counts as gain this many steps behind its border.
const DEPTH: u32 = 8;
/// A border is looked at from this near, mm.
const VIEW_MM: f64 = 220.0;
/// A gap is looked at from this near, mm, and from a place this far from the earlier ones, mm: what the map draws
/// into it by two echoes of equal range goes where it is looked at squarely.
const GAP_VIEW_MM: f64 = 450.0;
const APART_MM: f64 = 150.0;
/// Distances from which a surface is looked at, mm.
const SURFACE_VIEW_MM: (f64, f64) = (230.0, 550.0);

/// What makes a place worth going to.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(crate) enum Kind {
    /// Unknown floor begins there.
    Frontier,
    /// It begins behind a gap that is narrower than the robot on the map.
    Gap,
    /// A surface was seen from afar alone: two door jambs look like a wall across the door.
    Surface,
}

/// A place to look at, and from where.
#[derive(Clone, Copy, Debug)]
pub(crate) struct Target {
    pub kind: Kind,
    /// Its middle.
    pub centre: Point,
    /// The node to look from.
    pub view: usize,
    /// New floor behind it, m², or unseen surface, m.
    pub gain: f64,
    /// Clearance of the ways to that floor, mm.
    pub clearance_mm: f64,
}

/// The borders between known and unknown floor to which a robot of this clearance finds ways.
pub(crate) fn frontiers(reach: &Reach) -> Vec<Target> {
    let view = |centre| view_of(centre, VIEW_MM, reach, |_| true);
    borders(Kind::Frontier, reach, reach, view)
}

/// The borders to which only a robot of this clearance would find ways, `floor`; each is looked at from where
/// `reach` leads, apart from the places that earlier ones were looked at from.
pub(crate) fn gaps(floor: &Reach, reach: &Reach, viewed: &[Point]) -> Vec<Target> {
    let is_near = |from: Point, other: &Point| other.distance_mm(from) <= APART_MM;
    let is_apart = |from| !viewed.iter().any(|other| is_near(from, other));
    let view = |centre| view_of(centre, GAP_VIEW_MM, reach, is_apart);
    borders(Kind::Gap, floor, reach, view)
}

/// The node to look at a border from: the one with the shortest way that sees it from near, or the nearest.
fn view_of(
    centre: Point,
    near_mm: f64,
    reach: &Reach,
    allowed: impl Fn(Point) -> bool,
) -> Option<usize> {
    let map = reach.map;
    let sees = |from: Point| map.line(from, centre, |node| node.cell != Cell::Occupied);
    let near = map.within(centre, near_mm).into_iter();
    near.filter(|&index| allowed(map.point(index)) && sees(map.point(index)))
        .filter_map(|index| Some((reach.cost(index)?, index)))
        .min()
        .map(|(_, index)| index)
        .or_else(|| reach.nearest(centre, 2.0 * reach.inflation_mm + BEYOND_MM))
        .filter(|&index| allowed(map.point(index)))
}

/// The borders at `floor` of what is beyond the robot's `reach`, and the nodes to look at them from. Beyond a gap
/// that was looked through begins floor that is known.
fn borders(
    kind: Kind,
    floor: &Reach,
    reach: &Reach,
    view: impl Fn(Point) -> Option<usize>,
) -> Vec<Target> {
    let map = floor.map;
    let is_new = |index: usize| {
        let node = &map.nodes[index];
        let is_open = node.cell != Cell::Occupied && node.clearance_mm >= floor.inflation_mm;
        is_open && reach.cost(index).is_none()
    };
    let is_border = |index: usize| {
        let node = &map.nodes[index];
        let is_floor = node.cell == Cell::Unknown || node.clearance_mm >= reach.inflation_mm;
        is_floor && is_new(index)
    };
    let beside = floor.nodes().flat_map(|index| map.neighbours(index));
    // In order and each once.
    let border: BTreeSet<usize> = beside.filter(|&index| is_border(index)).collect();
    let border = Vec::from_iter(border);
    let points: Vec<Point> = border.iter().map(|&index| map.point(index)).collect();
    let mut targets = Vec::new();
    for group in groups(&points, 1.5 * STEP_MM) {
        let nodes: Vec<usize> = group.iter().map(|&nth| border[nth]).collect();
        let behind = flood(map, &nodes, is_new);
        let near: Vec<Point> = group.iter().map(|&nth| points[nth]).collect();
        let (Some(centre), true) = (middle(&near), behind >= SMALLEST) else {
            continue;
        };
        #[allow(clippy::cast_precision_loss)] // some hundred
        let gain = behind as f64 * (STEP_MM / 1000.0).powi(2);
        targets.extend(view(centre).map(|view| Target {
            kind,
            centre,
            view,
            gain,
            clearance_mm: floor.inflation_mm,
        }));
    }
    targets
}

/// The occupied cells at reachable floor that were never seen closely.
pub(crate) fn unseen_surfaces(reach: &Reach, grid: &Grid, sight: &Sight) -> Vec<Target> {
    let map = reach.map;
    let points: Vec<Point> = grid
        .occupied()
        .filter(|&point| !sight.is_seen_closely(point))
        .collect();
    let mut targets = Vec::new();
    for group in groups(&points, 2.0 * grid.cell_mm()) {
        let near: Vec<Point> = group.iter().map(|&nth| points[nth]).collect();
        let (Some(centre), true) = (middle(&near), group.len() >= SMALLEST) else {
            continue;
        };
        let (nearest, farthest) = SURFACE_VIEW_MM;
        let view = map
            .within(centre, farthest)
            .into_iter()
            .filter(|&index| map.point(index).distance_mm(centre) >= nearest)
            .filter(|&index| {
                let from = map.point(index);
                let short = 1.0 - 1.5 * STEP_MM / from.distance_mm(centre);
                map.line(from, from.lerp(centre, short), |node| {
                    node.cell != Cell::Occupied
                })
            })
            .filter_map(|index| Some((reach.cost(index)?, index)))
            .min();
        #[allow(clippy::cast_precision_loss)] // some hundred
        let gain = near.len() as f64 * grid.cell_mm() / 1000.0;
        targets.extend(view.map(|(_, view)| Target {
            kind: Kind::Surface,
            centre,
            view,
            gain,
            clearance_mm: reach.inflation_mm,
        }));
    }
    targets
}

/// Groups of points whose neighbours are within `gap_mm`, each at most [`EXTENT_MM`] from its
/// first point.
fn groups(points: &[Point], gap_mm: f64) -> Vec<Vec<usize>> {
    #[allow(clippy::cast_possible_truncation)] // within the grid
    let square = |point: Point| {
        (
            (point.x_mm / gap_mm).floor() as i32,
            (point.y_mm / gap_mm).floor() as i32,
        )
    };
    let mut squares: FxHashMap<(i32, i32), Vec<usize>> = FxHashMap::default();
    for (nth, &point) in points.iter().enumerate() {
        squares.entry(square(point)).or_default().push(nth);
    }
    let mut taken = vec![false; points.len()];
    let mut groups = Vec::new();
    for first in 0..points.len() {
        if taken[first] {
            continue;
        }
        let mut group = Vec::new();
        let mut todo = vec![first];
        taken[first] = true;
        while let Some(nth) = todo.pop() {
            group.push(nth);
            let (x, y) = square(points[nth]);
            let around = (-1..=1).flat_map(|dx| (-1..=1).map(move |dy| (x + dx, y + dy)));
            for &other in around.filter_map(|at| squares.get(&at)).flatten() {
                let joins = points[other].distance_mm(points[nth]) <= gap_mm
                    && points[other].distance_mm(points[first]) <= EXTENT_MM;
                if joins && !taken[other] {
                    taken[other] = true;
                    todo.push(other);
                }
            }
        }
        groups.push(group);
    }
    groups
}

/// The point of the group nearest to its mean.
fn middle(points: &[Point]) -> Option<Point> {
    #[allow(clippy::cast_precision_loss)] // some hundred
    let mean = |of: fn(&Point) -> f64| points.iter().map(of).sum::<f64>() / points.len() as f64;
    let mean = Point::new(mean(|p| p.x_mm), mean(|p| p.y_mm));
    let nearer = |a: &&Point, b: &&Point| a.distance_mm(mean).total_cmp(&b.distance_mm(mean));
    points.iter().min_by(nearer).copied()
}

/// Number of new nodes behind a border, [`DEPTH`] steps deep.
fn flood(map: &CostMap, border: &[usize], is_new: impl Fn(usize) -> bool) -> usize {
    let mut seen: FxHashSet<usize> = border.iter().copied().collect();
    let mut todo: VecDeque<(usize, u32)> = border.iter().map(|&index| (index, 0)).collect();
    while let Some((index, depth)) = todo.pop_front() {
        if depth < DEPTH {
            for next in map.neighbours(index) {
                if is_new(next) && seen.insert(next) {
                    todo.push_back((next, depth + 1));
                }
            }
        }
    }
    seen.len()
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::cost_map::tests::draw;
    use geometry::Pose2;

    const HALF: [&str; 8] = [
        "##########          ",
        "#........#          ",
        "#.........          ",
        "#.........          ",
        "#.........          ",
        "#.........          ",
        "#........#          ",
        "##########          ",
    ];

    fn targets(rows: &[&str], see: impl Fn(&mut Sight)) -> (Vec<Target>, Vec<Target>) {
        let grid = draw(rows);
        let map = CostMap::new(&grid, 0.0, &[], (&[], 100.0));
        let reach = Reach::new(&map, &Pose2::new(400.0, 400.0, 0.0), 120.0);
        let mut seen = Sight::default();
        see(&mut seen);
        (frontiers(&reach), unseen_surfaces(&reach, &grid, &seen))
    }

    #[test]
    fn open_door_is_frontier_and_closed_room_has_none() {
        let (found, _) = targets(&HALF, |_| {});
        assert_eq!(found.len(), 1, "{found:?}");
        let centre = found[0].centre;
        let off_mm = centre.distance_mm(Point::new(1000.0, 400.0));
        assert!(off_mm < 100.0, "{centre:?}");
        assert!(found[0].gain > 0.05 && found[0].gain < 0.5, "{found:?}");
        let closed = HALF.map(|row| row.replace(".          ", "#          "));
        let closed: Vec<&str> = closed.iter().map(String::as_str).collect();
        assert!(targets(&closed, |_| {}).0.is_empty());
    }

    #[test]
    fn gap_below_the_robots_width_is_found_with_less_clearance() {
        let row = ["#........#          ", "#.........          "];
        let rows = [0, 0, 0, 0, 1, 1, 0, 0].map(|nth: usize| row[nth]);
        let rows = [&[HALF[0]], &rows[..], &[HALF[0]]].concat();
        let map = CostMap::new(&draw(&rows), 0.0, &[], (&[], 100.0));
        // Beside the wall, from where the gap is not seen.
        let from = |clearance_mm| Reach::new(&map, &Pose2::new(780.0, 700.0, 0.0), clearance_mm);
        let (reach, floor) = (from(120.0), from(60.0));
        let wide = frontiers(&reach);
        assert!(wide.is_empty(), "{wide:?}");
        let view = |viewed: &[Point]| {
            let found = gaps(&floor, &reach, viewed);
            assert_eq!(found.len(), 1, "{found:?}");
            assert!(reach.cost(found[0].view).is_some(), "{found:?}");
            let view = map.point(found[0].view);
            assert!(map.line(view, found[0].centre, |node| node.cell != Cell::Occupied));
            view
        };
        let first = view(&[]);
        let second = view(&[first]);
        assert!(second.distance_mm(first) > APART_MM, "{second:?}");
    }

    #[test]
    fn gap_to_floor_that_was_seen_through_it_is_a_target() {
        for (behind, is_target) in [("........", true), ("########", false)] {
            let wall = "#".repeat(18);
            let row = |door: &str| format!("#........{door}{behind}#");
            let rows = ["#", "#", ".", ".", "#", "#"].map(row);
            let rows = [&wall].into_iter().chain(&rows).chain([&wall]);
            let rows: Vec<&str> = rows.map(String::as_str).collect();
            let map = CostMap::new(&draw(&rows), 0.0, &[], (&[], 100.0));
            let from =
                |clearance_mm| Reach::new(&map, &Pose2::new(400.0, 400.0, 0.0), clearance_mm);
            let (reach, floor) = (from(120.0), from(60.0));
            let found = gaps(&floor, &reach, &[]);
            assert_eq!(!found.is_empty(), is_target, "{found:?}");
            let is_large = |gap: &Target| reach.cost(gap.view).is_some() && gap.gain > 0.3;
            assert!(found.iter().all(is_large), "{found:?}");
        }
    }

    #[test]
    fn surfaces_seen_closely_are_no_targets() {
        let all = |seen: &mut Sight| {
            for step in 0..100 {
                let x_mm = 10.0 * f64::from(step);
                for y_mm in [60.0, 740.0] {
                    seen.see_surface(
                        &Pose2::new(x_mm, y_mm - 100.0, 0.5 * std::f64::consts::PI),
                        100.0,
                    );
                }
                seen.see_surface(&Pose2::new(150.0, x_mm, std::f64::consts::PI), 100.0);
                if !(200.0..=600.0).contains(&x_mm) {
                    seen.see_surface(&Pose2::new(850.0, x_mm, 0.0), 100.0);
                }
            }
        };
        let (_, unseen) = targets(&HALF, |_| {});
        assert!(unseen.len() >= 4, "{unseen:?}");
        let (_, unseen) = targets(&HALF, all);
        assert!(unseen.is_empty(), "{unseen:?}");
    }
}

//! The cheapest ways from the robot to everywhere: Dijkstra over the lattice and four directions.
//!
//! Only the walls' directions are driven along, because an ultrasonic sensor sees smooth walls
//! within about 25° of their normal alone; a turn costs as much as a detour of some decimetres.

use std::f64::consts::FRAC_PI_2;

use geometry::{Point, Pose2};
use mapper::Cell;
use pathfinding::directed::dijkstra::dijkstra_reach;

use crate::cost_map::{CostMap, Node, STEP_MM};

/// Cost of a quarter turn, mm of way.
const TURN: u32 = 200;
/// Clearance above which more is worth nothing, mm, and what it is above the least.
const AMPLE_MM: (f64, f64) = (300.0, 180.0);
/// Radius around the start in which too little clearance is no obstacle, mm beyond the clearance: the robot
/// stands there.
const ESCAPE_MM: f64 = 80.0;

/// A node and a direction in one number.
type State = usize;

/// The ways from one place.
pub(crate) struct Reach<'a> {
    pub map: &'a CostMap,
    /// Clearance that they keep, mm.
    pub inflation_mm: f64,
    /// Per state the state before it; its own for the start.
    parents: Vec<Option<State>>,
    /// Per node the cheapest state and its cost, mm.
    best: Vec<Option<(u32, State)>>,
}

/// Whether the robot's middle may be at a node.
pub(crate) fn passable(node: &Node, inflation_mm: f64) -> bool {
    node.cell == Cell::Free && node.clearance_mm >= inflation_mm || node.driven
}

/// Cost of one step to a node, mm.
#[allow(clippy::cast_possible_truncation, clippy::cast_sign_loss)] // at most some hundred
fn cost(node: &Node, inflation_mm: f64) -> u32 {
    let ample_mm = AMPLE_MM.0.max(inflation_mm + AMPLE_MM.1);
    let lack = |mm: f64| ((ample_mm - mm) / (ample_mm - inflation_mm)).clamp(0.0, 2.0);
    let (tight, unknown) = (lack(node.clearance_mm), lack(node.known_mm + inflation_mm));
    let unseen = if node.is_seen() { 0.0 } else { 1.0 };
    (STEP_MM * (1.0 + 2.0 * tight * tight + unknown + unseen)) as u32
}

impl<'a> Reach<'a> {
    /// All ways from `pose` with at least `inflation_mm` of clearance.
    pub fn new(map: &'a CostMap, pose: &Pose2, inflation_mm: f64) -> Self {
        let at = pose.position();
        let off_mm = |index: usize| map.point(index).distance_mm(at);
        let nearest = map
            .within(at, inflation_mm + ESCAPE_MM)
            .into_iter()
            .filter(|&index| passable(&map.nodes[index], inflation_mm))
            .min_by(|&a, &b| off_mm(a).total_cmp(&off_mm(b)));
        let quarter = ((pose.heading_rad - map.direction_rad()) / FRAC_PI_2).round();
        #[allow(clippy::cast_possible_truncation, clippy::cast_sign_loss)] // 0..4
        let direction = quarter.rem_euclid(4.0) as usize % 4;
        let start = nearest.or_else(|| map.index(at));
        let start: Option<State> = start.map(|index| index * 4 + direction);
        let successors = |&state: &State| {
            let (index, direction) = (state / 4, state % 4);
            let ahead = map
                .neighbour(index, direction)
                .filter(|&next| passable(&map.nodes[next], inflation_mm))
                .map(|next| (next * 4 + direction, cost(&map.nodes[next], inflation_mm)));
            let turn = |by: usize| (index * 4 + (direction + by) % 4, TURN);
            ahead.into_iter().chain([turn(1), turn(3)])
        };
        let mut parents = vec![None; map.nodes.len() * 4];
        let mut best = vec![None; map.nodes.len()];
        // From beyond the lattice leads no way.
        let ways = start
            .iter()
            .flat_map(|start| dijkstra_reach(start, successors));
        for reached in ways {
            parents[reached.node] = reached.parent.or(start);
            best[reached.node / 4].get_or_insert((reached.total_cost, reached.node));
        }
        Self {
            map,
            inflation_mm,
            parents,
            best,
        }
    }

    /// Cost of the way to a node, mm; `None` where none leads.
    pub fn cost(&self, index: usize) -> Option<u32> {
        self.best[index].map(|(cost, _)| cost)
    }

    /// The nodes that can be reached.
    pub fn nodes(&self) -> impl Iterator<Item = usize> + '_ {
        (0..self.best.len()).filter(|&index| self.best[index].is_some())
    }

    /// The reachable node nearest to a point within `radius_mm` of it.
    pub fn nearest(&self, point: Point, radius_mm: f64) -> Option<usize> {
        let distance = |index: usize| self.map.point(index).distance_mm(point);
        let near = self.map.within(point, radius_mm).into_iter();
        near.filter(|&index| self.best[index].is_some())
            .min_by(|&a, &b| distance(a).total_cmp(&distance(b)))
    }

    /// The way to a reachable node: where it begins, its corners and its end.
    pub fn path(&self, index: usize) -> Vec<Point> {
        let mut states: Vec<State> = Vec::new();
        let mut next = self.best[index].map(|(_, state)| state);
        while let Some(state) = next {
            states.push(state);
            next = self.parents[state].filter(|&before| before != state);
        }
        let mut nodes: Vec<usize> = states.iter().rev().map(|state| state / 4).collect();
        nodes.dedup();
        let straight = |nth: usize| {
            let step = |nth: usize| nodes[nth].wrapping_sub(nodes[nth - 1]);
            nth > 0 && nth + 1 < nodes.len() && step(nth) == step(nth + 1)
        };
        let corners = (0..nodes.len()).filter(|&nth| !straight(nth));
        corners.map(|nth| self.map.point(nodes[nth])).collect()
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::cost_map::tests::draw;

    const ROOM: [&str; 10] = [
        "####################",
        "#........#.........#",
        "#........#.........#",
        "#........#.........#",
        "#..................#",
        "#..................#",
        "#..................#",
        "#........#.........#",
        "#........#.........#",
        "####################",
    ];

    fn plan(rows: &[&str], from: (f64, f64), to: (f64, f64)) -> Option<Vec<Point>> {
        plan_with(rows, from, to, &[])
    }

    fn plan_with(
        rows: &[&str],
        from: (f64, f64),
        to: (f64, f64),
        driven: &[Point],
    ) -> Option<Vec<Point>> {
        let map = CostMap::new(&draw(rows), 0.0, &[], (driven, 100.0));
        let reach = Reach::new(&map, &Pose2::new(from.0, from.1, 0.0), 120.0);
        reach
            .nearest(Point::new(to.0, to.1), 50.0)
            .map(|node| reach.path(node))
    }

    #[test]
    fn step_costs_more_beside_walls_and_on_unknown_or_unseen_floor() {
        for (clearance_mm, known_mm, seen, expected) in [
            (300.0, 300.0, true, 50),
            (500.0, 500.0, false, 100),
            (120.0, 300.0, true, 150),
            (210.0, 300.0, true, 75),
            (30.0, 300.0, true, 275),
            (300.0, 0.0, true, 100),
            (300.0, 90.0, true, 75),
            (210.0, 90.0, false, 150),
        ] {
            let node = Node {
                clearance_mm,
                known_mm,
                cell: Cell::Free,
                driven: false,
                seen: [false, seen],
            };
            assert_eq!(cost(&node, 120.0), expected, "{node:?}");
        }
    }

    #[test]
    fn path_leads_through_door_with_clearance() {
        let path = plan(&ROOM, (300.0, 700.0), (1600.0, 700.0)).expect("a way");
        let (from, to) = (path[0], path[path.len() - 1]);
        assert!(from.distance_mm(Point::new(300.0, 700.0)) < 50.0);
        assert!(to.distance_mm(Point::new(1600.0, 700.0)) < 50.0);
        let in_door = |p: &Point| (420.0..=480.0).contains(&p.y_mm);
        assert!(
            path.iter().any(in_door),
            "through the middle of the door: {path:?}"
        );
        assert!(path.len() <= 6, "few corners: {path:?}");
    }

    #[test]
    fn gap_below_inflation_is_no_way() {
        let mut closed = ROOM;
        (closed[4], closed[6]) = (closed[3], closed[3]);
        let (from, to) = ((300.0, 700.0), (1600.0, 700.0));
        assert_eq!(plan(&closed, from, to), None);
        // The robot has come through it.
        let driven = (16..=22).map(|step| Point::new(f64::from(step) * STEP_MM, 450.0));
        let driven: Vec<Point> = driven.collect();
        assert!(plan_with(&closed, from, to, &driven).is_some());
    }

    #[test]
    fn path_of_adjacent_leg_is_straight() {
        let path = plan(&ROOM, (300.0, 450.0), (1500.0, 450.0)).expect("a way");
        assert_eq!(path.len(), 2, "{path:?}");
    }

    #[test]
    fn start_beside_obstacle_finds_way_out_and_start_beyond_the_map_none() {
        assert!(plan(&ROOM, (130.0, 700.0), (600.0, 700.0)).is_some());
        assert_eq!(plan(&ROOM, (-5000.0, 700.0), (600.0, 700.0)), None);
    }
}

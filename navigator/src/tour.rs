//! The order in which to visit all targets: a short way from the robot through them to its home.

use crate::cost_map::{NO_WAY_MM, Node};
use crate::frontier::Target;
use crate::planner::{Reach, passable};

/// The order is improved this many times at most.
const ROUNDS: usize = 50;
/// A change that saves less than this is none, mm.
const LEAST_MM: f64 = 1.0;
/// Cost of a way with its turns per length.
const LONGER: f64 = 1.2;

/// The ways between the places of a tour, mm.
pub(crate) struct Tour {
    /// From the robot to every target.
    pub from: Vec<f64>,
    /// From every target to every target.
    pub between: Vec<Vec<f64>>,
    /// From the end of the tour to every target.
    pub home: Vec<f64>,
}

impl Tour {
    /// The targets in the order of a short tour: cheapest insertion, then reversals of a part (2-opt)
    /// and moves of one target while they shorten the tour.
    pub fn order(&self) -> Vec<usize> {
        let mut order = Vec::new();
        for target in 0..self.from.len() {
            self.insert(&mut order, target);
        }
        for _ in 0..ROUNDS {
            if !self.reverse(&mut order) && !self.relocate(&mut order) {
                break;
            }
        }
        order
    }

    /// Way between two places; `None` is the robot before a target, home after one.
    fn way(&self, from: Option<usize>, to: Option<usize>) -> f64 {
        match (from, to) {
            (Some(from), Some(to)) => self.between[from][to],
            (None, Some(to)) => self.from[to],
            (Some(from), None) => self.home[from],
            (None, None) => 0.0,
        }
    }

    /// The places before and after position `at`.
    fn around(order: &[usize], at: usize) -> (Option<usize>, Option<usize>) {
        let before = at.checked_sub(1).map(|nth| order[nth]);
        (before, order.get(at).copied())
    }

    /// Inserts a target where it costs least; returns what it costs.
    fn insert(&self, order: &mut Vec<usize>, target: usize) -> f64 {
        let cost = |at: usize| {
            let (before, after) = Self::around(order, at);
            self.way(before, Some(target)) + self.way(Some(target), after) - self.way(before, after)
        };
        let costs = (0..=order.len()).map(|at| (cost(at), at));
        let (cost, at) = costs.min_by(|a, b| a.0.total_cmp(&b.0)).unwrap_or_default();
        order.insert(at, target);
        cost
    }

    /// Reverses the part whose reversal saves most, if one saves.
    fn reverse(&self, order: &mut [usize]) -> bool {
        let mut best = (LEAST_MM, 0..0);
        for from in 0..order.len() {
            for end in from + 2..=order.len() {
                let (before, first) = Self::around(order, from);
                let (last, after) = Self::around(order, end);
                let now = self.way(before, first) + self.way(last, after);
                let saved = now - self.way(before, last) - self.way(first, after);
                if saved > best.0 {
                    best = (saved, from..end);
                }
            }
        }
        order[best.1.clone()].reverse();
        !best.1.is_empty()
    }

    /// Moves the first target whose move saves.
    fn relocate(&self, order: &mut Vec<usize>) -> bool {
        for at in 0..order.len() {
            let mut moved = order.clone();
            let target = moved.remove(at);
            let (before, after) = Self::around(&moved, at);
            let now = self.way(before, Some(target)) + self.way(Some(target), after)
                - self.way(before, after);
            if self.insert(&mut moved, target) < now - LEAST_MM {
                *order = moved;
                return true;
            }
        }
        false
    }
}

/// The first target of a short tour over all of them that ends at `home`.
pub(crate) fn next_of_tour(
    reach: &Reach,
    targets: &[Target],
    home: Option<usize>,
) -> Option<Target> {
    let ways = |from: usize| {
        let allowed = |node: &Node| passable(node, reach.inflation_mm);
        let ways_mm = reach.map.ways_mm(from, allowed);
        targets.iter().map(|to| LONGER * ways_mm[to.view]).collect()
    };
    let cost = |target: &Target| reach.cost(target.view).map_or(NO_WAY_MM, f64::from);
    let tour = Tour {
        from: targets.iter().map(cost).collect(),
        between: targets.iter().map(|from| ways(from.view)).collect(),
        home: home.map_or_else(|| vec![0.0; targets.len()], ways),
    };
    tour.order().first().map(|&nth| targets[nth])
}

#[cfg(test)]
mod tests {
    use super::*;
    use geometry::Point;
    use plant::Rng;

    fn tour(robot: Point, targets: &[Point], home: Point) -> Tour {
        let ways = |at: Point| targets.iter().map(|to| to.distance_mm(at)).collect();
        Tour {
            from: ways(robot),
            between: targets.iter().map(|&target| ways(target)).collect(),
            home: ways(home),
        }
    }

    fn length(tour: &Tour, order: &[usize]) -> f64 {
        let legs = |at| Tour::around(order, at);
        let way = |at| tour.way(legs(at).0, legs(at).1);
        (0..=order.len()).map(way).sum()
    }

    #[test]
    fn order_of_few_random_targets_is_nearly_shortest() {
        let mut rng = Rng::new(7);
        let (mut found, mut shortest) = (0.0, 0.0);
        for _ in 0..50 {
            let mut point = || Point::new(4000.0 * rng.unit(), 4000.0 * rng.unit());
            let (robot, home) = (point(), point());
            let targets = [(); 6].map(|()| point());
            let tour = tour(robot, &targets, home);
            let mut orders = vec![Vec::new()];
            for target in 0..targets.len() {
                let inserted = |order: Vec<usize>| {
                    (0..=order.len()).map(move |at| {
                        let mut longer = order.clone();
                        longer.insert(at, target);
                        longer
                    })
                };
                orders = orders.into_iter().flat_map(inserted).collect();
            }
            let lengths = orders.iter().map(|order| length(&tour, order));
            shortest += lengths.fold(f64::INFINITY, f64::min);
            found += length(&tour, &tour.order());
        }
        assert!(
            found >= shortest - 1e-6 && found < 1.02 * shortest,
            "{found} {shortest}"
        );
    }

    #[test]
    fn no_reversal_and_no_move_of_one_target_shortens_the_order() {
        let mut rng = Rng::new(11);
        for _ in 0..60 {
            let mut point = || Point::new(4000.0 * rng.unit(), 4000.0 * rng.unit());
            let (robot, home) = (point(), point());
            let targets = [(); 12].map(|()| point());
            let tour = tour(robot, &targets, home);
            let order = tour.order();
            let mut all = order.clone();
            all.sort_unstable();
            assert_eq!(all, (0..12).collect::<Vec<_>>());
            let shortest = length(&tour, &order) - LEAST_MM - 1e-6;
            for (from, to) in (0..12).flat_map(|from| (0..12).map(move |to| (from, to))) {
                let mut moved = order.clone();
                let target = moved.remove(from);
                moved.insert(to, target);
                assert!(length(&tour, &moved) >= shortest, "{from} {to}");
                let mut turned = order.clone();
                turned[from.min(to)..=from.max(to)].reverse();
                assert!(length(&tour, &turned) >= shortest, "{from} {to}");
            }
        }
    }
}

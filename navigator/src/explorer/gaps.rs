//! Gaps that are narrower than the robot on the map: the echoes of wide beams draw the ends of walls too long.

use std::iter::successors;

use geometry::Pose2;

use super::{Explorer, Goal, SAME_MM, TRIES};
use crate::Status;
use crate::follower::Follower;
use crate::frontier::{Kind, Target, gaps};
use crate::planner::Reach;

/// Shares of the clearance that gaps have, the widest first, which are looked at last, and unknown floor behind them,
/// m²: wide beams draw the ends of walls too long, by a decimetre or two.
const SHARES: [f64; 5] = [0.875, 0.75, 0.625, 0.5, 0.375];
const GAP_GAIN_M2: f64 = 0.16;
/// A beam has to have passed a gap of a lower share.
const UNSEEN: f64 = 0.5;
/// Fruitless looks nearer than this to a gap count as looks at it, mm: there the wall does not answer.
const GAP_MM: f64 = 500.0;
/// Time for gaps, s, which time for other targets that are reached gives back: a far one costs up to a minute. Cost of
/// the way per second, mm.
const GAPS_S: f64 = 90.0;
const PACE: f64 = 100.0;
/// Longest way through a gap, mm.
const WAY_MM: f64 = 1000.0;
/// Fruitless looks and tries after which a gap is gone through no more.
const PASSES: usize = 5;

impl Explorer {
    /// The gaps to look at next, at every place the widest: those that a beam has passed, whatever the time for gaps,
    /// or else those near enough.
    pub(super) fn gaps(&self, pose: &Pose2, reach: &Reach) -> Vec<Target> {
        // One that has shown a wider gap, or twice the floor behind it, was not in vain.
        let in_vain = |target: &Target, tried: &Target| {
            target.clearance_mm <= tried.clearance_mm && target.gain <= 2.0 * tried.gain
        };
        let looks = |target: &Target| {
            let near = self.tries(target.centre, GAP_MM);
            near.filter(|tried| in_vain(target, tried)).count()
        };
        let left_mm = PACE * (GAPS_S - self.gaps_s);
        // The first may be anywhere.
        let is_near = |target: &Target| {
            let cost = reach.cost(target.view);
            self.gaps_s <= 0.0 || cost.is_some_and(|cost| f64::from(cost) < left_mm)
        };
        let of_width = |share: f64| {
            let floor = Reach::new(reach.map, pose, share * reach.inflation_mm);
            gaps(&floor, reach, &self.gap_views)
        };
        let mut found: Vec<Target> = SHARES.into_iter().flat_map(of_width).collect();
        found.retain(|target| looks(target) < TRIES && target.gain > GAP_GAIN_M2);
        let widest = |counts: &dyn Fn(&Target) -> bool| {
            let mut widest: Vec<Target> = Vec::new();
            for target in found.iter().filter(|target| counts(target)) {
                let off_mm = |other: &Target| other.centre.distance_mm(target.centre);
                if widest.iter().all(|other| off_mm(other) >= GAP_MM) {
                    widest.push(*target);
                }
            }
            widest
        };
        let passed = widest(&|target| is_passed(reach, target));
        let is_wide = |target: &Target| target.clearance_mm >= UNSEEN * reach.inflation_mm;
        let near = || widest(&|target| is_wide(target) && is_near(target));
        Some(passed)
            .filter(|passed| !passed.is_empty())
            .unwrap_or_else(near)
    }

    /// Goes through the gap that was just looked at, where only the map is too narrow for it. Returns whether a way
    /// leads through.
    // Requirement: NAV-explore-1
    pub(super) fn pass(
        &mut self,
        last: Target,
        others: &[Target],
        reach: &Reach,
        status: &Status,
    ) -> bool {
        let off_mm = |other: &Target| other.centre.distance_mm(last.centre);
        let is_here = |other: &&Target| off_mm(other) < GAP_MM;
        // A frontier needs no narrow way.
        let mut here = others.iter().filter(is_here);
        let tries = self.tries(last.centre, GAP_MM).count();
        if tries > PASSES || here.any(|other| other.kind == Kind::Frontier) {
            return false;
        }
        let through = |share: f64| {
            let width_mm = share * reach.inflation_mm;
            let floor = Reach::new(reach.map, &status.estimate.pose, width_mm);
            let found = gaps(&floor, reach, &[]).into_iter();
            let found = found.filter(|gap| is_here(&gap) && gap.gain > GAP_GAIN_M2);
            let found = found.filter(|gap| share >= UNSEEN || is_passed(reach, gap));
            let nodes = found.filter_map(|gap| Some((floor.nearest(gap.centre, SAME_MM)?, gap)));
            let (node, gap) = nodes.min_by_key(|&(node, _)| floor.cost(node))?;
            let way_mm = Follower::new(floor.path(node)).remaining_mm();
            (way_mm < WAY_MM).then_some((floor, node, gap))
        };
        let Some((floor, node, gap)) = SHARES.into_iter().find_map(through) else {
            return false;
        };
        self.driver.follow(&floor, node, status.time_s);
        self.chosen = Some((Kind::Gap, status.time_s));
        self.goal = Goal::Pass(gap);
        true
    }
}

/// Whether beams that a wall in the gap would have answered have gone through, straight from the robot's floor to the
/// middle of what is beyond, and beside it.
pub(super) fn is_passed(reach: &Reach, gap: &Target) -> bool {
    let map = reach.map;
    let leads = |node: usize, back: usize| {
        let line = successors(Some(node), |&index| map.neighbour(index, back));
        let mut seen = line.take_while(|&index| map.nodes[index].seen[back % 2]);
        seen.any(|index| reach.cost(index).is_some())
    };
    let beside = |node: usize, back: usize| {
        let aside = [back + 1, back + 3].map(|aside| map.neighbour(node, aside % 4));
        aside.into_iter().flatten().any(|node| leads(node, back))
    };
    let passed = |node: usize| (0..4).any(|back| leads(node, back) && beside(node, back));
    map.index(gap.centre).is_some_and(passed)
}

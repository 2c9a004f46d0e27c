//! Goes to a point of a known map.

use geometry::Point;
use mapper::Grid;

use crate::driver::{Driver, Step};
use crate::planner::Reach;
use crate::{Action, Config, Outcome, Status, Velocity};

/// The reachable node taken for the target is at most this far from it, mm.
const NEAR_MM: f64 = 100.0;
/// Plans made before the target is given up.
const PLANS: u32 = 6;

/// Drives to a point, planning on the map.
#[derive(Clone, Debug)]
pub struct GoTo {
    driver: Driver,
    target: Point,
    plans: u32,
}

impl GoTo {
    /// A way to `target`, in the frame of the grid.
    pub fn new(config: Config, target: Point) -> Self {
        Self {
            driver: Driver::new(config),
            target,
            plans: 0,
        }
    }

    /// Takes a frame: the map and the robot's report.
    pub fn step(&mut self, grid: &Grid, status: &Status) -> Action {
        match self.driver.step(grid, status) {
            Step::Act(action) => return action,
            Step::Arrived if self.plans > 0 => return Action::Done(Outcome::Complete),
            Step::Arrived | Step::Interrupted => self.plans += 1,
        }
        let pose = status.estimate.pose;
        let map = self.driver.survey(grid, status.time_s);
        let reach = Reach::new(&map, &pose, self.driver.config.inflation_mm);
        match reach.nearest(self.target, NEAR_MM) {
            Some(node) if self.plans <= PLANS => {
                self.driver.follow(&reach, node, status.time_s);
                Action::Drive(Velocity::default())
            }
            _ => Action::Done(Outcome::Unreachable),
        }
    }
}

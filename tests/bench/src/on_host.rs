//! Program for the host. One line a candidate: the name of its step, its state after
//! [`TICKS_ON_CORE`] ticks (three numbers in hexadecimal), and its distance from the exact position
//! after a kilometre of curves and one straight on, micrometres.
#![forbid(unsafe_code)]

use fw_core::eeprom::Config;
use fw_core::types::Turns;
use odometry_bench::{
    Candidate, Course, TICKS_ON_CORE, Tick, drive, first_board, for_each_candidate, per_count,
};

#[path = "../../../fw-core/src/motion/odometry/tests/exact_arcs.rs"]
#[allow(
    dead_code,
    reason = "the tests of the odometry compare the heading too"
)]
mod exact_arcs;

use exact_arcs::ExactArcs;

/// A kilometre of a course and its exact end.
struct Kilometre {
    ticks: Vec<Tick>,
    exact: ExactArcs,
}

impl Kilometre {
    fn of(course: Course) -> Self {
        let config = first_board();
        let per_count = per_count(config.left().diameter.0, &config);
        let mut exact = ExactArcs::new(config);
        let mut ticks = Vec::new();
        let mut path = 0.0;
        for tick in course {
            path += f64::from(tick.left + tick.right).abs() / 2.0 * per_count;
            if path > 1e6 {
                break;
            }
            exact.step(tick.left.into(), tick.right.into());
            ticks.push(tick);
        }
        Self { ticks, exact }
    }

    /// Micrometres between a candidate's end of the course and the exact one.
    fn error<C: Candidate>(&self) -> f64 {
        let (x, y) = drive::<C>(self.ticks.iter().copied()).position();
        self.exact.x.less(x).hypot(self.exact.y.less(y)) * 1000.0
    }
}

fn run<C: Candidate>(_number: usize, name: &str, curves: &Kilometre, straight: &Kilometre) {
    let ticks = curves.ticks.iter().copied().take(TICKS_ON_CORE);
    let [x, y, angle] = drive::<C>(ticks).bits();
    let (curves, straight) = (curves.error::<C>(), straight.error::<C>());
    println!("{name} {x:x} {y:x} {angle:x} {curves} {straight}");
}

fn main() {
    let curves = Kilometre::of(Course::curves());
    let straight = Kilometre::of(Course::straight());
    for_each_candidate!(run, &curves, &straight);
}

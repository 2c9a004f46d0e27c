//! The program for the host: what every way comes to after [`ON_CORE`] ticks, to be compared with what
//! the core came to, and how far it is from the exact position after a kilometre. One line a way:
//! the name of its step, three numbers in hexadecimal, and the two distances in micrometres.
#![forbid(unsafe_code)]

use fw_core::eeprom::Platform;
use odometry_bench::{every_way, Course, Tick, Way, ON_CORE};

#[path = "../../../fw-core/src/motion/odometry/tests/exact_arcs.rs"]
#[allow(
    dead_code,
    reason = "the tests of the odometry compare the heading too"
)]
mod exact_arcs;

use exact_arcs::ExactArcs;
use fw_core::types::Turns;

/// A course of a kilometre and where it ends.
struct Kilometre {
    ticks: Vec<Tick>,
    exact: ExactArcs,
}

impl Kilometre {
    fn of(course: Course) -> Self {
        let platform = Platform::FIRST_BOARD;
        let per_count = f64::from(platform.wheel_diameter_left) / 1000.0 * std::f64::consts::PI
            / f64::from(platform.counts_per_turn);
        let mut exact = ExactArcs::new(platform);
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

    /// Micrometres between a way's end of the course and the exact one.
    fn error<W: Way>(&self) -> f64 {
        let way = drive::<W>(&self.ticks);
        let (x, y) = way.position();
        self.exact.x.less(x).hypot(self.exact.y.less(y)) * 1000.0
    }
}

fn drive<W: Way>(ticks: &[Tick]) -> W {
    let mut way = W::new(&Platform::FIRST_BOARD);
    let (mut left, mut right) = (0_u32, 0_u16);
    for tick in ticks {
        // The first board's encoders count down going ahead.
        left = left.wrapping_sub(tick.left as u32);
        right = right.wrapping_sub(tick.right as u16);
        way.tick(left, right);
    }
    way
}

fn run<W: Way>(_number: usize, name: &str, curves: &Kilometre, straight: &Kilometre) {
    let start = drive::<W>(&curves.ticks[..ON_CORE]);
    let [x, y, angle] = start.bits();
    let (curves, straight) = (curves.error::<W>(), straight.error::<W>());
    println!("{name} {x:x} {y:x} {angle:x} {curves} {straight}");
}

fn main() {
    let curves = Kilometre::of(Course::curves());
    let straight = Kilometre::of(Course::straight());
    every_way!(run, &curves, &straight);
}

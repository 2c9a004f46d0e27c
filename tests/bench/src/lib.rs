//! Comparison of odometries: the document's formulas (4.1) in several types of numbers beside
//! `fw-core`'s, each a [`Candidate`] with a `step` that is not inlined, over the same courses.
#![no_std]
#![forbid(unsafe_code)]

mod candidates;
mod course;
mod exercise;

pub use candidates::{Candidate, Cordic, Double, FwCore, Idsp, Micromath, Single, per_count};
pub use course::{Course, Tick};
pub use exercise::exercise;

use fw_core::eeprom::{Config, Image};

/// Ticks driven on the core: enough for a mean, few enough for software doubles.
pub const TICKS_ON_CORE: usize = 1_000;

/// Number of candidates.
pub const CANDIDATES: usize = 6;

/// Calls `$run::<Candidate>(number, name of its step)` for every candidate.
#[macro_export]
macro_rules! for_each_candidate {
    ($run:ident $(, $more:expr)*) => {
        $run::<$crate::FwCore>(0, "Odometry::step" $(, $more)*);
        $run::<$crate::Double>(1, "Double::step" $(, $more)*);
        $run::<$crate::Single>(2, "Single::step" $(, $more)*);
        $run::<$crate::Micromath>(3, "Micromath::step" $(, $more)*);
        $run::<$crate::Cordic>(4, "Cordic::step" $(, $more)*);
        $run::<$crate::Idsp>(5, "Idsp::step" $(, $more)*);
    };
}

/// The first board's configuration.
pub fn first_board() -> Config {
    Config::decode(&Image::FIRST_BOARD).expect("accepted")
}

/// Drives a new candidate on the first board.
pub fn drive<C: Candidate>(ticks: impl Iterator<Item = Tick>) -> C {
    let mut candidate = C::new(&first_board());
    let (mut left, mut right) = (0_u32, 0_u16);
    for tick in ticks {
        // The first board's encoders count down going ahead.
        left = left.wrapping_sub(tick.left as u32);
        right = right.wrapping_sub(tick.right as u16);
        candidate.tick(left, right);
    }
    candidate
}

//! The document's odometry (4.1) in several ways, each a type with a `step` of its own that is a
//! function of its own, and the courses they are driven over.
#![no_std]
#![forbid(unsafe_code)]

mod course;
mod ways;

pub use course::{Course, Tick};
pub use ways::{Cordic, Double, Idsp, Micromath, Ours, Single, Way};

/// Ticks that are driven on the core: enough for a mean, few enough for software doubles.
pub const ON_CORE: usize = 1_000;

/// Calls `$run::<Way>(number, name of its step)` for every way.
#[macro_export]
macro_rules! every_way {
    ($run:ident $(, $more:expr)*) => {
        $run::<$crate::Ours>(0, "Odometry::step" $(, $more)*);
        $run::<$crate::Double>(1, "Double::step" $(, $more)*);
        $run::<$crate::Single>(2, "Single::step" $(, $more)*);
        $run::<$crate::Micromath>(3, "Micromath::step" $(, $more)*);
        $run::<$crate::Cordic>(4, "Cordic::step" $(, $more)*);
        $run::<$crate::Idsp>(5, "Idsp::step" $(, $more)*);
    };
}

/// How many ways there are.
pub const WAYS: usize = 6;

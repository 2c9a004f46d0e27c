//! Where the robot is and how it gets where it should be.
#![allow(
    clippy::cast_possible_truncation,
    clippy::cast_possible_wrap,
    clippy::cast_sign_loss,
    reason = "fixed point: every cast states or follows from a range"
)]

pub mod controller;
pub mod deadline;
pub mod odometry;
pub mod pid;
pub mod plausibility;
#[cfg(test)]
mod simulation;
pub mod trig;
pub mod wheels;

pub use controller::Controller;
pub use deadline::StopDeadline;
pub use odometry::{Delta, Odometry};
pub use plausibility::Plausibility;
pub use wheels::Wheels;

//! What the robot senses beside its wheels: the battery's cells and the distance to what is around.
#![allow(
    clippy::cast_possible_truncation,
    clippy::cast_possible_wrap,
    clippy::cast_sign_loss,
    reason = "fixed point: every cast states or follows from a range"
)]

pub mod battery;
pub mod rangefinder;

pub use battery::Battery;
pub use rangefinder::{Echo, Rangefinders};

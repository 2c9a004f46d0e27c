//! What the robot senses beside its wheels: the battery's cells, the distance to what is around and
//! where it looks for that, how warm the air is that carries the sound, and whether it turns as its
//! wheels say.
#![allow(
    clippy::cast_possible_truncation,
    clippy::cast_possible_wrap,
    clippy::cast_sign_loss,
    reason = "fixed point: every cast states or follows from a range"
)]

pub mod battery;
pub mod gyro;
pub mod mpu6050;
pub mod rangefinder;
#[cfg_attr(not(feature = "sweep"), path = "no_sweep.rs")]
pub mod sweep;
#[cfg(feature = "acoustics")]
pub mod thermometer;

pub use battery::Battery;
pub use gyro::Gyro;
pub use mpu6050::Mpu6050;
pub use rangefinder::{Echo, Rangefinders, Reading, Tally};
pub use sweep::Sweep;
#[cfg(feature = "acoustics")]
pub use thermometer::{Calibration, Thermometer};

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
pub mod servo_scan;
pub mod temperature;

pub use battery::Battery;
pub use gyro::GyroFusion;
pub use mpu6050::Mpu6050;
pub use rangefinder::{Echo, EchoStats, Rangefinders, Reading};
pub use servo_scan::ServoScan;
pub use temperature::{Calibration, Thermometer};

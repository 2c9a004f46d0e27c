//! Sensors other than the encoders: battery, rangefinders and their servo, temperature, gyroscope.
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
pub use temperature::{Calibration, SupplyCorrection, Thermometer};

//! T5, T6, T9 and T10: sensors.

pub mod battery;
pub mod gyro;
pub mod rangefinder;
pub mod servo_scan;
pub mod temperature;

//! T5, T6, T9 and T10: sensors.
//!
//! | module | properties |
//! |---|---|
//! | [`rangefinder`] | T5, T9: echoes to distances |
//! | [`servo_scan`] | T9: the servo and the bearing of a reading |
//! | [`temperature`] | T5, T9: the chip's temperature |
//! | [`battery`] | T5, T10: ADC words to cell voltages |
//! | [`gyro`] | T5, T6: the driver of the gyroscope and the corrections of the heading |

pub mod battery;
pub mod gyro;
pub mod rangefinder;
pub mod servo_scan;
pub mod temperature;

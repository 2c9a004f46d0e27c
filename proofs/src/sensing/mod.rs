//! T5, T6, T9 and T10: what the robot senses beside its wheels.
//!
//! | module | theorems |
//! |---|---|
//! | [`rangefinder`] | T9: echoes to distances |
//! | [`sweep`] | T9: the servo and the bearing of a reading |
//! | [`thermometer`] | T5, T9: the chip's temperature |
//! | [`battery`] | T10: ADC words to cells |
//! | [`gyro`] | T5, T6: the gyroscope and what it may add to the heading |

pub mod battery;
pub mod gyro;
pub mod rangefinder;
pub mod servo_scan;
pub mod temperature;

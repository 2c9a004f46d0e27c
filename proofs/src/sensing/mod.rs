//! T9 and T10: what the robot senses beside its wheels.
//!
//! | module | theorems |
//! |---|---|
//! | [`rangefinder`] | T9: echoes to distances |
//! | [`battery`] | T10: ADC words to cells |

pub mod battery;
pub mod rangefinder;

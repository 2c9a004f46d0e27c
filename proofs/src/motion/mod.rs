//! T5 to T8: where the robot is, its regulators, and the stop deadline.
//!
//! | module | theorems |
//! |---|---|
//! | [`trig`] | T6: sine, cosine and direction |
//! | [`odometry`] | T6: heading and position |
//! | [`pid`] | T7: the regulator's limits |
//! | [`deadline`] | T8: silence stops the robot |

pub mod deadline;
pub mod odometry;
pub mod pid;
pub mod trig;

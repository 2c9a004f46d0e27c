//! T5 to T8, T14: where the robot is, its regulators, its wheels, and the stop deadline.
//!
//! | module | theorems |
//! |---|---|
//! | [`trig`] | T6: sine, cosine and direction |
//! | [`odometry`] | T6: heading and position |
//! | [`pid`] | T7: the regulator's limits |
//! | [`wheels`] | T7: the wheels' limits |
//! | [`plausibility`] | T14: a wheel that does not do what it is told |
//! | [`controller`] | T5: the pose controller |
//! | [`deadline`] | T8: silence stops the robot |

pub mod deadline;
pub mod drive_monitor;
pub mod mixer;
pub mod odometry;
pub mod pid;
pub mod pose_controller;
pub mod trig;

//! T5 to T8, T14: pose, controllers, mixer, drive monitor and stop deadline.
//!
//! | module | properties |
//! |---|---|
//! | [`trig`] | T6: sine, cosine and direction |
//! | [`odometry`] | T5, T6: heading and position |
//! | [`pid`] | T7: limits and anti wind-up of the PID |
//! | [`mixer`] | T7: limits and gain balance of the motors |
//! | [`drive_monitor`] | T14: wheels that do not follow their commands |
//! | [`pose_controller`] | T5: any pose and target |
//! | [`deadline`] | T8: silence stops the robot |

pub mod deadline;
pub mod drive_monitor;
pub mod mixer;
pub mod odometry;
pub mod pid;
pub mod pose_controller;
pub mod trig;

//! T5 to T8, T14 to T16: pose, controllers, mixer, drive monitor, stop deadline and obstacle stop.
//!
//! | module | properties |
//! |---|---|
//! | [`trig`] | T6: sine, cosine and direction |
//! | [`odometry`] | T5, T6: heading and position |
//! | [`pid`] | T7: limits and anti wind-up of the PID |
//! | [`mixer`] | T7: limits and gain balance of the motors |
//! | [`drive_monitor`] | T14: wheels that do not follow their commands |
//! | [`pose_controller`] | T5: any pose and target |
//! | [`obstacle_limit`] | T15: the commanded speed stops before the stop distance |
//! | [`velocity_controller`] | T16: limits of the velocity, and zero holds |
//! | [`deadline`] | T8: silence stops the robot |

pub mod deadline;
pub mod drive_monitor;
pub mod mixer;
pub mod obstacle_limit;
pub mod odometry;
pub mod pid;
pub mod pose_controller;
pub mod trig;
pub mod velocity_controller;

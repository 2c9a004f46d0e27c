//! T5 to T8, T14 to T17: pose, controllers, mixer, drive monitor, stop deadline, obstacle stop and arrival.

pub mod arc;
pub mod arrival;
pub mod deadline;
pub mod drive_monitor;
pub mod mixer;
pub mod obstacle_limit;
pub mod odometry;
pub mod pid;
pub mod pose_controller;
pub mod stopping;
pub mod trig;
pub mod velocity_controller;

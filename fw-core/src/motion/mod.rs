//! Where the robot is and how it gets where it should be.
#![allow(
    clippy::cast_possible_truncation,
    clippy::cast_possible_wrap,
    clippy::cast_sign_loss,
    reason = "fixed point: every cast states or follows from a range"
)]

pub mod arrival_timer;
pub mod deadline;
pub mod drive_monitor;
pub mod mixer;
pub mod obstacle_limit;
pub mod odometry;
pub mod pid;
pub mod pose_controller;
pub mod trig;
pub mod velocity_controller;

pub use arrival_timer::ArrivalTimer;
pub use deadline::StopDeadline;
pub use drive_monitor::DriveMonitor;
pub use obstacle_limit::ObstacleLimit;
pub use odometry::Odometry;
pub use pose_controller::PoseController;
pub use velocity_controller::VelocityController;

#[cfg(test)]
mod tests;

//! The robot in ROS 2: a client of the server that publishes what the robot reports and drives it by what
//! other nodes publish. The DDS is [`RustDDS`](https://docs.rs/rustdds); no ROS has to be installed.

#[cfg(feature = "ros2")]
mod bridge;
pub mod commands;
#[cfg(feature = "ros2")]
mod node;
pub mod reports;

#[cfg(feature = "ros2")]
pub use {
    bridge::run,
    node::{Options, Ros2Node},
};

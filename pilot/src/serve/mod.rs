//! One process owns the robot, many look on: the control loop and its clients.

pub mod board;
pub mod control;
mod failure;
pub mod hub;
pub mod listener;
mod pacer;
pub mod protocol;
pub mod tiles;
pub mod token;

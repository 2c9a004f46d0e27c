//! The jobs of the program `robot`: tours, maps, tuning and calibration. Its commands are in `cli`.
//!
//! ```
//! use pilot::waypoints;
//!
//! // Millimetres, millimetres, degrees.
//! let tour = waypoints::parse("1000 0 90   # to the door\n0 0 0   # and back").unwrap();
//! assert_eq!(tour[0].distance_mm(tour[1]), 1000.0);
//! ```
#![forbid(unsafe_code)]

pub mod borrowed;
pub mod calibrate;
pub mod client;
pub mod doctor;
pub mod drive;
pub mod exploring;
pub mod gamepad;
pub mod ground_truth;
pub mod hints;
pub mod mapping;
pub mod mode;
pub mod recording;
#[cfg(any(test, feature = "ros2"))]
pub mod ros2;
pub mod ros_messages;
pub mod serve;
pub mod teleop;
pub mod tune;
#[cfg(feature = "virtual")]
pub mod virtual_board;
pub mod waypoints;
#[cfg(feature = "web")]
pub mod web;

//! The jobs of the program `robot`: tours, maps, tuning and calibration. Its commands are in `cli`.
//!
//! ```
//! use pilot::waypoints;
//!
//! // Millimetres, millimetres, degrees.
//! let tour = waypoints::parse("1000 0 90   # to the door\n0 0 0   # and back").unwrap();
//! assert_eq!(tour[0].distance_mm(tour[1]), 1000.0);
//! ```
//!
//! | module | content |
//! |---|---|
//! | [`waypoints`] | way-point files |
//! | [`mode`] | another mode on both ends |
//! | [`hints`] | what counters and faults indicate |
//! | [`doctor`] | checks from the kernel to the wheels |
//! | [`tune`] | steps, model, gains, dividers |
//! | [`calibrate`] | wheel diameters and track from measured runs |
//! | [`ground_truth`] | the true end of a run |
//! | [`exploring`] | driving by a plan with localisation |
//! | [`mapping`] | mapping while driving |
//! | [`recording`] | MCAP with ROS 2 messages |
//! | [`client`] | a client of a server |
//! | [`serve`] | one process owns the robot, many look on |
//! | `web` | the page of `serve --web` (feature `web`) |
//! | `virtual_board` | the firmware's ELF on the virtual board (feature `virtual`) |
#![forbid(unsafe_code)]

pub mod calibrate;
pub mod client;
pub mod doctor;
pub mod exploring;
pub mod ground_truth;
pub mod hints;
pub mod mapping;
pub mod mode;
pub mod recording;
pub mod serve;
pub mod tune;
#[cfg(feature = "virtual")]
pub mod virtual_board;
pub mod waypoints;
#[cfg(feature = "web")]
pub mod web;

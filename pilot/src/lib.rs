//! What the program `robot` does for people: drive tours, map, tune, calibrate.
//!
//! | module | idea |
//! |---|---|
//! | [`waypoints`] | way-point files |
//! | [`mode`] | another mode on both ends |
//! | [`hints`] | what counters and faults mean, in sentences |
//! | [`tune`] | steps, model, gains, dividers |
//! | [`calibrate`] | wheel diameters and track from measured runs |
//! | [`ground_truth`] | where a run truly ended |
//! | [`mapping`] | mapping while driving; recordings |
//! | `virtual_board` | the firmware's ELF on the virtual board (feature `virtual`) |
#![forbid(unsafe_code)]

pub mod calibrate;
pub mod ground_truth;
pub mod hints;
pub mod mapping;
pub mod mode;
pub mod tune;
#[cfg(feature = "virtual")]
pub mod virtual_board;
pub mod waypoints;

//! What crosses crates: firmware in the loop, the demo, the figures.
#![forbid(unsafe_code)]
#![allow(
    clippy::missing_panics_doc,
    reason = "a helper of tests panics where what it is to do or to find fails"
)]

pub mod disturbance;
pub mod exploration;
pub mod linked_robot;
#[cfg(target_os = "linux")]
pub mod pi_devices;
pub mod reference;
pub mod serving;
pub mod stack;
pub mod test_board;
pub mod throughput;
pub mod truth_track;
pub mod wires;

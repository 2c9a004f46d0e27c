//! What crosses crates: firmware in the loop, the demo, the figures.
#![forbid(unsafe_code)]

pub mod disturbance;
pub mod exploration;
pub mod io_faults;
#[cfg(target_os = "linux")]
pub mod pi_devices;
pub mod reference;
pub mod serving;
pub mod stack;
pub mod test_board;
pub mod throughput;
pub mod truth_track;

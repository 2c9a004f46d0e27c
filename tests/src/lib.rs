//! What crosses crates: firmware in the loop, the demo, the figures.
//!
//! | module | what it is |
//! |---|---|
//! | [`test_board`] | the release ELF on the virtual board, and its frames byte by byte |
//! | [`io_faults`] | a board whose I/O fails at a chosen call |
//! | [`mod@reference`] | EEPROM images and frames written by hand from the document's tables |
//! | [`disturbance`] | disturbed frames |
//! | [`throughput`] | how fast frames may come, for how long, and what a torn one costs |
//! | [`exploration`] | a room explored, and its comparison with the truth |
//! | [`truth_track`] | the true pose at each report |
//! | [`serving`] | the robot served to clients |
//! | [`stack`] | how much of its stack the firmware has used |
#![forbid(unsafe_code)]

pub mod disturbance;
pub mod exploration;
pub mod io_faults;
pub mod reference;
pub mod serving;
pub mod stack;
pub mod test_board;
pub mod throughput;
pub mod truth_track;

//! What crosses crates: firmware in the loop, the demo, the figures.
//!
//! | module | what it is |
//! |---|---|
//! | [`test_board`] | the release ELF on the virtual board, and its wires byte by byte |
//! | [`io_faults`] | wires on which a chosen call goes wrong |
//! | [`reference`] | EEPROM images and frames written by hand from the document's tables |
//! | [`throughput`] | how fast frames may come, for how long, and what a torn one costs |
//! | [`stack`] | how much of its stack the firmware has used |
#![forbid(unsafe_code)]

pub mod io_faults;
pub mod reference;
pub mod stack;
pub mod test_board;
pub mod throughput;

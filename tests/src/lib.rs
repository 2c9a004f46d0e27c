//! What crosses crates: firmware in the loop, the demo, the figures.
#![forbid(unsafe_code)]

//! The vectors of `tests/vectors`, made by an independent program from the documents' tables, through
//! the core in both directions: what it writes is exactly the bytes, what it reads exactly the values.

mod codes;
mod eeprom;
mod ends;
mod frames;
mod json;
mod sessions;
mod strategies;

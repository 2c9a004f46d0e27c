//! `docs/interfaces.md` says what the code does: every table of it is read and compared, so that
//! neither can change without the other.

mod eeprom;
mod table;
mod wire;

//! `docs/interfaces.md` says what the code does: every table of it is read and compared, so that
//! neither can change without the other; and the places that `docs/extending.md` names exist.

mod eeprom;
mod extending;
mod table;
mod wire;

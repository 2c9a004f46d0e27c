//! The virtual robot: the firmware ELF on an emulated STM32F411 with the parts of the board.

pub mod devices;
pub mod part;

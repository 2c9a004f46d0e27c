//! The virtual robot: the firmware ELF on an emulated STM32F411 with the parts of the board.

pub mod board;
pub mod devices;
pub mod emulation;
pub mod faults;
pub mod hal;
pub mod machine;
pub mod measure;
pub mod part;
pub mod parts;
pub mod report;
pub mod surroundings;
pub mod wiring;

pub use board::{Board, Options, Reset, ResetBy, Truth};
pub use emulation::{Debugger, Ended};
pub use faults::{Disturbance, Faults};
pub use parts::spi_master::Step;
pub use plant;

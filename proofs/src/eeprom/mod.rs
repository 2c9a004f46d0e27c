//! T3: the EEPROM's image and the configuration.

pub mod accepted;
pub mod burst;
pub mod checksum;
pub mod contract;
pub mod image;

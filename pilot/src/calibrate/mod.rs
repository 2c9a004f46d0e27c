//! Calibration of the wheels and the track from runs measured on the floor.
//!
//! The robot only knows how far each wheel turned. Its diameters give the distance, and with the
//! track the rotation; all three are in its EEPROM's page 0x03. A drive whose true end was measured
//! shows how far off they are.

pub mod distance;
pub mod explored;
pub mod least_squares;
pub mod run;
pub mod umbmark;
pub mod wheel_geometry;
pub mod wheel_path;

#[cfg(test)]
mod tests;

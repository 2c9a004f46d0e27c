//! Calibration of the wheels and the track from runs measured on the floor.
//!
//! The robot only knows how far each wheel turned. Its diameters give the distance, and with the
//! track the rotation; all three are figures of its EEPROM's page 0x03. A drive whose true end a person
//! measured says how far off they are.
//!
//! | file | idea |
//! |---|---|
//! | [`wheel_geometry`] | the three figures, and which of them no robot has |
//! | [`wheel_path`] | what the robot believed it drove, and where other figures say that ends |
//! | [`distance`] | a straight drive: the scale of everything |
//! | [`umbmark`] | squares both ways (Borenstein and Feng): the wheels' ratio and the track |
//! | [`least_squares`] | the two figures that explain the ends best |
//! | [`run`] | the drives themselves, bounded, and stopped whatever happens |

pub mod distance;
pub mod least_squares;
pub mod run;
pub mod umbmark;
pub mod wheel_geometry;
pub mod wheel_path;

#[cfg(test)]
mod tests;

//! The configuration: the EEPROM's register map as one table, raw [`Image`], checked [`Config`].
//!
//! Pages 0x00 to 0x02 are the original register map; page 0x03 adds the platform's own figures. An
//! accepted [`Config`] excludes every overflow and division by zero downstream.
//!
//! ```
//! use fw_core::eeprom::{fields, Config, Image};
//!
//! let mut image = Image::FIRST_BOARD;
//! image.set(fields::TRACK, 130_000);
//! image.seal();
//! let config = Config::decode(&image).expect("130 mm are accepted");
//! assert_eq!(config.track().0, 130_000);
//!
//! image.set(fields::TRACK, 0);
//! image.seal();
//! let error = Config::decode(&image).expect_err("0 mm are not");
//! assert_eq!((error.address, error.field()), (0x030C, "track"));
//! ```

mod config;
mod constraint;
mod crc32;
mod error;
mod field;
pub mod fields;
mod image;
mod parts;

pub use config::{Config, MAX_CELLS};
pub use constraint::{CONSTRAINTS, Constraint};
pub use crc32::crc32;
pub use error::{ConfigError, Expected, FieldValue};
pub use field::{Accepted, Field, Kind, Unit};
pub use fields::FIELDS;
pub use image::{CRC_ADDRESS, IMAGE_LEN, Image, KEY, LAYOUT, PLATFORM, PLATFORM_LEN, SPANS, Span};
pub use parts::{Divider, Gain, Gains, ObstacleStop, Servo, VelocityLimits, Wheel};

#[cfg(test)]
pub(crate) use tests::{config_with, first_board};

#[cfg(test)]
#[allow(
    clippy::cast_possible_truncation,
    clippy::cast_possible_wrap,
    clippy::cast_sign_loss,
    reason = "values are drawn from within their ranges"
)]
mod tests;

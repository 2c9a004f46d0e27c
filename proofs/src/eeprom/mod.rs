//! T3: the EEPROM's image and the configuration.
//!
//! | module | properties |
//! |---|---|
//! | [`image`] | T3: what is accepted, and that it survives the way to the image and back |
//! | [`checksum`] | T3: CRC-32 and the errors it catches |
//! | [`contract`] | T5: what an accepted configuration promises to everything downstream |
//! | [`accepted`] | configurations that are accepted, for the other areas |

pub mod accepted;
pub mod checksum;
pub mod contract;
pub mod image;

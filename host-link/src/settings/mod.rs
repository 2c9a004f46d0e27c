//! The configuration file: TOML with comments and units ↔ the EEPROM's [`Image`], along
//! [`fw_core::eeprom::FIELDS`].
//!
//! Without a `[platform]` section the image is an original one: page 0x03 stays unwritten and the
//! first board's values apply.

mod format;
mod migrate;
mod parse;
mod render;

pub use render::{Change, changes, render};

use crate::error::{Error, IN_EEPROM};
use crate::file;
use fw_core::eeprom::{Config, Field, Image, PLATFORM, fields};
use fw_core::wire::Mode;
use std::path::Path;

/// An accepted image and its configuration.
#[derive(Clone, Debug, PartialEq, Eq)]
pub struct Settings {
    image: Image,
    config: Config,
}

impl Settings {
    /// Reads a configuration file.
    ///
    /// # Errors
    /// [`Error::Unreadable`]; [`Error::Content`] with each line for what is no configuration file at
    /// all, an unknown or a missing key, and a value that is not accepted.
    pub fn load(path: &Path) -> Result<Self, Error> {
        Self::parse(&file::read_text(path)?, path)
    }

    /// [`Self::load`] from memory; `path` is for the messages.
    ///
    /// # Errors
    /// Those of [`Self::load`] but the first.
    pub fn parse(text: &str, path: &Path) -> Result<Self, Error> {
        parse::parse(text, path)
    }

    /// The first board's, page 0x03 written.
    ///
    /// # Errors
    /// None.
    pub fn first_board() -> Result<Self, Error> {
        Self::from_image(&Image::FIRST_BOARD)
    }

    /// The sample to start from: the first board's in Guarded Velocity with the gyroscope on, in which every
    /// command drives.
    ///
    /// # Errors
    /// None.
    pub fn sample() -> Result<Self, Error> {
        let mode = Mode::GuardedVelocity.code().into();
        Self::first_board()?.with(&[(fields::MODE, mode), (fields::GYRO, 1)])
    }

    /// What an image holds.
    ///
    /// # Errors
    /// [`Error::Rejected`] names address, field, value and accepted range.
    pub fn from_image(image: &Image) -> Result<Self, Error> {
        let rejected = |what| Error::Rejected(IN_EEPROM.into(), what);
        if *image == Image::BLANK {
            let blank = "it is blank; `robot eeprom init` makes a file to start from";
            return Err(rejected(blank.into()));
        }
        if migrate::from_layout_1(image).is_some() {
            let old = "it is of layout 1, which `robot eeprom migrate` converts";
            return Err(rejected(old.into()));
        }
        let config = Config::decode(image).map_err(|error| rejected(error.to_string()))?;
        let image = image.clone();
        Ok(Self { image, config })
    }

    /// The same of an image to edit: one of layout 1, which the STM rejects, is converted.
    ///
    /// # Errors
    /// Those of [`Self::from_image`].
    pub fn migrated(image: &Image) -> Result<Self, Error> {
        Self::from_image(migrate::from_layout_1(image).as_ref().unwrap_or(image))
    }

    /// With other raw values in some fields; page 0x03 is written where one of them lies there.
    ///
    /// # Errors
    /// [`Error::Rejected`].
    pub fn with(&self, changes: &[(&Field, u64)]) -> Result<Self, Error> {
        let on_platform = |&(field, _): &(&Field, u64)| field.address >= PLATFORM;
        let mut image = if changes.iter().any(on_platform) {
            self.platform_written()
        } else {
            self.image.clone()
        };
        for &(field, raw) in changes {
            image.set(field, raw);
        }
        image.seal();
        Self::from_image(&image).map_err(|error| match error {
            Error::Rejected(_, what) => Error::Rejected("with what would be written".into(), what),
            error => error,
        })
    }

    /// The image to write. Undefined bytes are those of the image that it was read from.
    pub const fn image(&self) -> &Image {
        &self.image
    }

    /// The image with page 0x03 written, though it only holds the first board's values.
    pub fn platform_written(&self) -> Image {
        let mut image = self.image.clone();
        for field in &fields::FIELDS {
            image.set(field, self.get(field));
        }
        image.seal();
        image
    }

    /// In units.
    pub const fn config(&self) -> &Config {
        &self.config
    }

    /// Whether page 0x03 is written; without it the image is an original one.
    pub const fn platform_page(&self) -> bool {
        !self.image.is_original()
    }

    /// The raw value of a field; of an unwritten page 0x03 the first board's.
    pub fn get(&self, field: &Field) -> u64 {
        if field.address >= PLATFORM && self.image.is_original() {
            Image::FIRST_BOARD.get(field)
        } else {
            self.image.get(field)
        }
    }

    /// As JSON: the sections and keys of the file.
    pub fn json(&self) -> serde_json::Value {
        // What was rendered is read back: one way from fields to keys.
        toml::from_str(&render(self)).unwrap_or_default()
    }
}

/// The configuration of an image, page 0x03 or the first board's values.
///
/// # Errors
/// [`Error::Rejected`] names address, field, value and accepted range.
pub fn decode(image: &Image) -> Result<Config, Error> {
    Ok(Settings::from_image(image)?.config)
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn change_that_is_rejected_does_not_blame_the_eeprom() {
        let first = Settings::first_board().unwrap();
        let refused = first.with(&[(fields::TRACK, 1)]).unwrap_err().to_string();
        let whose = "rejected with what would be written: ";
        assert!(refused.contains(whose), "{refused}");
    }

    #[test]
    fn blank_image_is_rejected_with_the_command_that_starts_one() {
        let blank = Settings::from_image(&Image::BLANK).unwrap_err().to_string();
        assert!(blank.contains("`robot eeprom init`"), "{blank}");
    }

    #[test]
    fn with_changes_in_any_order_on_original_image_keeps_all() {
        let mut image = Image::FIRST_BOARD;
        image.make_original();
        let original = Settings::from_image(&image).unwrap();
        let mut changes = [(fields::MODE, 0x10), (fields::GYRO, 1)];
        for _ in 0..2 {
            let settings = original.with(&changes).unwrap();
            for (field, raw) in changes {
                assert_eq!(settings.get(field), raw, "{}", field.name());
            }
            changes.reverse();
        }
    }
}

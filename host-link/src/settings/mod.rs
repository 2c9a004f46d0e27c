//! The configuration file: TOML with comments and units ↔ the EEPROM's [`Config`].
//!
//! Without a `[platform]` section the image is an original one: page 0x03 stays unwritten and the
//! first board's figures apply.

mod fields;
mod number;
mod parse;
mod render;

pub use render::{changes, render, Change};

use crate::error::Error;
use fw_core::eeprom::{self, Config, Image};
use std::fs;
use std::path::Path;

/// A configuration and whether its page 0x03 is written.
#[derive(Clone, Debug, PartialEq, Eq)]
pub struct Settings {
    /// The figures.
    pub config: Config,
    /// Whether page 0x03 carries the platform's figures; without it the image is an original one.
    pub platform_page: bool,
}

/// First address of page 0x03.
const PAGE_3: usize = 0x300;

impl Settings {
    /// Reads a configuration file.
    ///
    /// # Errors
    /// [`Error::Unreadable`]; [`Error::Content`] with the line for what is no configuration file at
    /// all, an unknown or a missing key, a wrong type or a number that the field cannot store;
    /// [`Error::Rejected`] for figures that no robot may drive with.
    pub fn load(path: &Path) -> Result<Self, Error> {
        let text = fs::read_to_string(path).map_err(|cause| Error::unreadable(path, &cause))?;
        Self::parse(&text, path)
    }

    /// [`Self::load`] from memory; `path` is for the messages.
    ///
    /// # Errors
    /// Those of [`Self::load`] but the first.
    pub fn parse(text: &str, path: &Path) -> Result<Self, Error> {
        parse::parse(text, path)
    }

    /// The image to write.
    #[must_use]
    pub fn image(&self) -> Image {
        let mut image = [0xFF; eeprom::IMAGE_LEN];
        if self.platform_page {
            eeprom::encode(&self.config, &mut image);
        } else {
            eeprom::encode_original(&self.config, &mut image);
        }
        image
    }

    /// As JSON: the sections and keys of the file.
    #[must_use]
    pub fn json(&self) -> serde_json::Value {
        // What was rendered is read back: one table of the fields for both.
        toml::from_str(&render(self)).unwrap_or_default()
    }

    /// What an image says.
    ///
    /// # Errors
    /// [`Error::Rejected`] names address, field, value and accepted range.
    pub fn from_image(image: &Image) -> Result<Self, Error> {
        let config = decode(image)?;
        let page = image.get(PAGE_3..).unwrap_or_default();
        Ok(Self {
            config,
            platform_page: page.iter().any(|&byte| byte != 0xFF),
        })
    }
}

/// What an image says, page 0x03 or the first board's figures.
///
/// # Errors
/// [`Error::Rejected`] names address, field, value and accepted range.
pub fn decode(image: &Image) -> Result<Config, Error> {
    let rejected = |what| Error::Rejected {
        location: "in the EEPROM's image".into(),
        what,
    };
    if image.iter().all(|&byte| byte == 0xFF) {
        return Err(rejected("it is blank, every cell reads 0xFF".into()));
    }
    eeprom::decode(image).map_err(|error| rejected(error.to_string()))
}

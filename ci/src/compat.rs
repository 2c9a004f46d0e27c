//! Names of earlier versions, for the modules that move to crates of their own.

use std::fmt::Display;

use crate::error::{anyhow, Result};
pub use crate::workspace::Workspace as Place;

pub fn failed<T>(text: impl Into<String>) -> Result<T> {
    Err(anyhow!(text.into()))
}

pub trait Of<T> {
    fn of(self, what: impl Display) -> Result<T>;
}

impl<T> Of<T> for std::io::Result<T> {
    fn of(self, what: impl Display) -> Result<T> {
        self.map_err(|error| anyhow!("{what}: {error}"))
    }
}

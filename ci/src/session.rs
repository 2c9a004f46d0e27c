//! What the commands and gates share: found and built once, at the first that needs it.

use std::cell::OnceCell;

use crate::error::Result;
use crate::firmware::{self, Image};
use crate::toolchain::{Provider, Toolchain};
use crate::workspace::Workspace;

pub struct Session {
    pub workspace: Workspace,
    provider: Option<Provider>,
    toolchain: OnceCell<Toolchain>,
    image: OnceCell<Image>,
}

impl Session {
    /// With the toolchain of this provider, or of the first that works.
    pub fn new(provider: Option<Provider>) -> Result<Self> {
        Ok(Self {
            workspace: Workspace::find()?,
            provider,
            toolchain: OnceCell::new(),
            image: OnceCell::new(),
        })
    }

    pub fn toolchain(&self) -> Result<&Toolchain> {
        if let Some(toolchain) = self.toolchain.get() {
            return Ok(toolchain);
        }
        let toolchain = Toolchain::find(&self.workspace, self.provider)?;
        Ok(self.toolchain.get_or_init(|| toolchain))
    }

    /// What is flashed.
    pub fn image(&self) -> Result<&Image> {
        if let Some(image) = self.image.get() {
            return Ok(image);
        }
        let image = self.build("")?;
        Ok(self.image.get_or_init(|| image))
    }

    /// The firmware with these features.
    pub fn build(&self, features: &str) -> Result<Image> {
        firmware::build(&self.workspace, self.toolchain()?, features)
    }
}

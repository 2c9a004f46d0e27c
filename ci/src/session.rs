//! What commands and gates share: found and built once, at the first that needs it.

use std::cell::OnceCell;
use std::ops::Deref;

use crate::error::Result;
use crate::firmware::{self, Image};
use crate::toolchain::{Provider, Toolchain};
use crate::workspace::Workspace;

pub struct Session {
    workspace: Workspace,
    provider: Option<Provider>,
    toolchain: OnceCell<Toolchain>,
    image: OnceCell<Image>,
}

impl Deref for Session {
    type Target = Workspace;

    fn deref(&self) -> &Workspace {
        &self.workspace
    }
}

impl Session {
    /// With the firmware's toolchain of this provider, or of the first that works.
    pub fn new(provider: Option<Provider>) -> Result<Self> {
        let workspace = Workspace::find()?;
        let (toolchain, image) = (OnceCell::new(), OnceCell::new());
        Ok(Self {
            workspace,
            provider,
            toolchain,
            image,
        })
    }

    pub fn toolchain(&self) -> Result<&Toolchain> {
        if let Some(toolchain) = self.toolchain.get() {
            return Ok(toolchain);
        }
        let toolchain = Toolchain::find(self, self.provider)?;
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
        firmware::build(self, self.toolchain()?, features)
    }
}

//! What commands and gates share: found and built once, at the first that needs it.

use std::cell::OnceCell;
use std::ops::Deref;
use std::path::PathBuf;

use crate::elf::Sizes;
use crate::error::{Context, Result};
use crate::toolchain::{Provider, Toolchain};
use crate::workspace::Workspace;

pub struct Session {
    workspace: Workspace,
    provider: Option<Provider>,
    toolchain: OnceCell<Toolchain>,
    /// What is flashed.
    pub image: OnceCell<Image>,
}

/// A built ELF, kept apart from builds with other features.
pub struct Image {
    pub path: PathBuf,
    pub bytes: Vec<u8>,
    pub sizes: Sizes,
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
        Ok(Self {
            workspace: Workspace::find()?,
            provider,
            toolchain: OnceCell::new(),
            image: OnceCell::new(),
        })
    }

    pub fn toolchain(&self) -> Result<&Toolchain> {
        once(&self.toolchain, || Toolchain::find(self, self.provider))
    }
}

/// What the cell holds, after finding it where it is empty.
pub fn once<T>(cell: &OnceCell<T>, find: impl FnOnce() -> Result<T>) -> Result<&T> {
    if cell.get().is_none() {
        let _ = cell.set(find()?);
    }
    cell.get().context("just found")
}

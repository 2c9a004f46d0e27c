//! What commands and gates share: found and built once, at the first that needs it.

use std::cell::OnceCell;
use std::ops::Deref;
use std::path::{Path, PathBuf};

use crate::error::{Context, Result};
use crate::firmware::{self, Image, Program, RELEASE};
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

    /// What is flashed.
    pub fn image(&self) -> Result<&Image> {
        once(&self.image, || self.build(RELEASE))
    }

    /// The firmware of a copy of the workspace; where cargo left it.
    pub fn build_copy(&self, root: &Path) -> Result<PathBuf> {
        firmware::build_in(self, self.toolchain()?, root, &root.join("target"), RELEASE)
    }

    /// A program of `fw-pac`.
    pub fn build(&self, program: Program) -> Result<Image> {
        firmware::build(self, self.toolchain()?, program)
    }
}

fn once<T>(cell: &OnceCell<T>, find: impl FnOnce() -> Result<T>) -> Result<&T> {
    if cell.get().is_none() {
        let _ = cell.set(find()?);
    }
    cell.get().context("just found")
}

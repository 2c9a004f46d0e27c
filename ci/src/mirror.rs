//! A copy of the workspace to spoil.

use std::path::Path;

use crate::compat::Of;
use crate::error::Result;
use crate::shell;

/// Makes `to` a copy of `root` without what was built; files that are equal are left alone and keep
/// their time, so that cargo builds only what changed.
///
/// # Errors
/// Names the file that cannot be copied.
pub fn mirror(root: &Path, target: &Path, to: &Path) -> Result<()> {
    std::fs::create_dir_all(to).of(to.display())?;
    let mut kept = Vec::new();
    for entry in std::fs::read_dir(root).of(root.display())?.flatten() {
        let (path, name) = (entry.path(), entry.file_name());
        if path == target || name == "target" || name == ".git" {
            continue;
        }
        let copy = to.join(&name);
        kept.push(name);
        if path.is_dir() {
            mirror(&path, target, &copy)?;
        } else if std::fs::read(&path).of(path.display())?
            != std::fs::read(&copy).unwrap_or_default()
        {
            shell::copy(&path, &copy)?;
        }
    }
    // What is gone from the workspace must not be built here.
    for entry in std::fs::read_dir(to).of(to.display())?.flatten() {
        if !kept.contains(&entry.file_name()) {
            let gone = entry.path();
            let removed = if gone.is_dir() {
                std::fs::remove_dir_all(&gone)
            } else {
                std::fs::remove_file(&gone)
            };
            removed.of(gone.display())?;
        }
    }
    Ok(())
}

//! The lock: one process at a time uses a robot.

use host_link::error::Error;
use rustix::io::Errno;
use rustix::process::{Pid, Signal, kill_process};
use std::fs::{self, File, Permissions, TryLockError};
use std::io::{self, ErrorKind, Write};
use std::os::unix::fs::{MetadataExt, PermissionsExt, fchown};
use std::path::Path;

/// One process at a time uses a robot. The system releases the lock when the process ends, also by a
/// kill; the file is emptied by an orderly end only.
pub struct Lock {
    file: File,
    /// The last holder was killed, and that has not been repaired yet.
    pub killed: bool,
}

impl Lock {
    /// Takes the lock; it has the group of `device`.
    ///
    /// # Errors
    /// [`Error::Busy`], [`Error::Unwritable`].
    pub fn take(path: &Path, device: Option<&Path>) -> Result<Self, Error> {
        let unwritable = |cause| Error::unwritable(path, &cause);
        if let Some(folder) = path.parent() {
            fs::create_dir_all(folder).map_err(|cause| Error::unwritable(folder, &cause))?;
        }
        let mut file = open_lock(path, device).map_err(unwritable)?;
        match file.try_lock() {
            Ok(()) => {}
            Err(TryLockError::WouldBlock) => return Err(Error::Busy(path.into(), holder(&file))),
            Err(TryLockError::Error(cause)) => return Err(unwritable(cause)),
        }
        let killed = file.metadata().map_err(unwritable)?.len() > 0;
        file.write_all(b"held\n").map_err(unwritable)?;
        Ok(Self { file, killed })
    }
}

/// The process that holds the lock, by the kernel's list: what the file says may be forged.
fn holder(file: &File) -> Option<i32> {
    let (file, locks) = (
        file.metadata().ok()?,
        fs::read_to_string("/proc/locks").ok()?,
    );
    let (major, minor) = (rustix::fs::major(file.dev()), rustix::fs::minor(file.dev()));
    let id = format!("{major:02x}:{minor:02x}:{}", file.ino());
    locks.lines().find_map(|line| {
        let words: Vec<_> = line.split_whitespace().collect();
        match words[..] {
            // 0 is a process that this namespace does not show.
            [_, "FLOCK", _, _, process, of, ..] if of == id => {
                process.parse().ok().filter(|&id| id > 0)
            }
            _ => None,
        }
    })
}

/// Asks the process that holds a lock to end, as Ctrl-C does: it stops the robot first.
///
/// # Errors
/// [`Error::Device`].
pub fn end(process: i32) -> Result<(), Error> {
    let ended = Pid::from_raw(process).map_or(Err(Errno::SRCH), |id| kill_process(id, Signal::INT));
    ended.map_err(|cause| {
        let advice = "end it as its user, or as root";
        Error::device(format!("process {process}"), cause, advice)
    })
}

/// Opens or makes a lock file. In a shared folder a link, or a file that is more than a lock, may wait in
/// its place.
fn open_lock(path: &Path, device: Option<&Path>) -> io::Result<File> {
    let mut options = File::options();
    options.write(true);
    // Not `create`: the kernel refuses it for the file of another user in /var/tmp.
    let file = match fs::symlink_metadata(path) {
        Err(cause) if cause.kind() == ErrorKind::NotFound => {
            let file = options.create_new(true).open(path)?;
            if let Some(device) = device {
                let group = fs::metadata(device).map(|device| device.gid());
                // Only a member of the group can give it to the group.
                let _ = group.and_then(|group| {
                    fchown(&file, None, Some(group))?;
                    file.set_permissions(Permissions::from_mode(0o660))
                });
            }
            file
        }
        Err(cause) => return Err(cause),
        Ok(present) if present.is_file() => options.open(path)?,
        Ok(_) => return Err(io::Error::other("it is a link, a folder or a device")),
    };
    let (opened, there) = (file.metadata()?, fs::symlink_metadata(path)?);
    if (opened.dev(), opened.ino()) != (there.dev(), there.ino()) || opened.len() > MAX_LOCK {
        return Err(io::Error::other("it is no lock of this program"));
    }
    Ok(file)
}

/// Longest lock file, bytes.
const MAX_LOCK: u64 = 16;

impl Drop for Lock {
    fn drop(&mut self) {
        if !self.killed {
            // If that fails, the next run repairs what needs none.
            let _ = self.file.set_len(0);
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use std::os::unix::fs::symlink;

    #[test]
    fn lock_is_shared_by_group_exclusive_and_no_link() {
        let folder = tempfile::tempdir().unwrap();
        let folder = folder.path();
        let (path, device) = (folder.join("lock"), folder.join("device"));
        fs::write(&device, "").unwrap();
        let take = |path: &Path| Lock::take(path, Some(&device));
        let held = take(&path).unwrap();
        assert!(!held.killed);
        assert_eq!(fs::metadata(&path).unwrap().mode() & 0o777, 0o660);
        let own = i32::try_from(std::process::id()).ok();
        let refused = take(&path).map(|_| ()).unwrap_err();
        assert_eq!(refused, Error::Busy(path.clone(), own));
        drop(held);
        fs::write(&path, "held\n").unwrap();
        assert!(take(&path).unwrap().killed);
        fs::write(&device, "a letter, not a lock").unwrap();
        let link = folder.join("link");
        symlink(&device, &link).unwrap();
        for wrong in [&link, &device, folder] {
            assert!(
                matches!(take(wrong), Err(Error::Unwritable { .. })),
                "{wrong:?}"
            );
        }
    }
}

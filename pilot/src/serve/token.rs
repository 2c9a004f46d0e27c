//! The token that clients over a network show: a file that its owner alone can read.

use host_link::error::Error;
use host_link::file::{self, Kind};
use std::fs::{self, File};
use std::io::{ErrorKind, Read};
use std::os::unix::fs::MetadataExt;
use std::path::Path;

/// Random bytes of a new token.
const BYTES: usize = 16;

/// Reads the token; a file that does not exist is made with a new one.
///
/// # Errors
/// Those of [`file::ensure_trusted`], [`file::read_text`] and [`file::save`]; [`Error::Content`] of a file that
/// others can read, or of less than 16 characters.
// Requirement: SERVE-client-3
pub fn load(path: &Path) -> Result<String, Error> {
    let found = fs::symlink_metadata(path);
    if found.is_err_and(|cause| cause.kind() == ErrorKind::NotFound) {
        let mut random = [0; BYTES];
        let source = Path::new("/dev/urandom");
        let filled = File::open(source).and_then(|mut file| file.read_exact(&mut random));
        filled.map_err(|cause| Error::unreadable(source, &cause))?;
        let token = format!("{:032x}", u128::from_ne_bytes(random));
        file::save(path, Kind::Token, format!("{token}\n").as_bytes())?;
        return Ok(token);
    }
    file::ensure_trusted(path)?;
    let metadata = fs::metadata(path).map_err(|cause| Error::unreadable(path, &cause))?;
    if metadata.mode() & 0o077 != 0 {
        let what = "others can read the token; `chmod 600` it, or remove it for a new one";
        return Err(Error::content(path, None, what));
    }
    let text = file::read_text(path)?;
    let token = text.trim();
    if token.len() < BYTES {
        let what =
            format!("a token has at least {BYTES} characters; remove the file for a new one");
        return Err(Error::content(path, None, what));
    }
    Ok(token.into())
}

/// Whether two tokens are the same, in a time that does not depend on where they differ.
#[must_use]
pub fn same(one: &str, other: &str) -> bool {
    let (one, other) = (one.as_bytes(), other.as_bytes());
    let differ = one.iter().zip(other).fold(0, |sum, (a, b)| sum | (a ^ b));
    one.len() == other.len() && differ == 0
}

#[cfg(test)]
mod tests {
    use super::*;
    use std::os::unix::fs::PermissionsExt;

    // Requirement: SERVE-client-3
    #[test]
    fn token_file_is_private_or_refused() {
        let folder = tempfile::tempdir().unwrap();
        let path = folder.path().join("token");
        let token = load(&path).unwrap();
        assert_eq!(token.len(), 2 * BYTES);
        assert_eq!(fs::metadata(&path).unwrap().mode() & 0o777, 0o600);
        assert_eq!(load(&path).as_ref(), Ok(&token));
        assert!(
            same(&token, &token) && !same(&token, &token[1..]) && !same(&token, &"0".repeat(32))
        );
        for mode in [0o640, 0o604] {
            fs::set_permissions(&path, fs::Permissions::from_mode(mode)).unwrap();
            assert!(matches!(load(&path), Err(Error::Content { .. })));
        }
        fs::set_permissions(&path, fs::Permissions::from_mode(0o600)).unwrap();
        fs::write(&path, "short\n").unwrap();
        assert!(matches!(load(&path), Err(Error::Content { .. })));
    }
}

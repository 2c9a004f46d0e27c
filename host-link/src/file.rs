//! Files: inputs are bounded, outputs are written whole or not at all and never over a foreign file.

use crate::error::Error;
pub use crate::file_fault::FileFault;
use fw_core::eeprom::KEY;
use std::fs::{self, File};
use std::io::{ErrorKind, Read, Write};
use std::path::{Path, PathBuf};

/// Largest text that is read, bytes: configuration, tour, room.
pub const MAX_TEXT: u64 = 1 << 20;

/// Pages 0x00 to 0x02: what an original image has at least.
pub const ORIGINAL_LEN: usize = 0x300;

/// The largest EEPROM of the original map, bytes.
pub const LARGEST_LEN: usize = 0x1_0000;

/// Reads a file of at most `max` bytes. A device that never ends is refused after that many.
///
/// # Errors
/// [`Error::Unreadable`]; [`Error::Content`] for a larger file.
pub fn read(path: &Path, max: u64) -> Result<Vec<u8>, Error> {
    let mut bytes = Vec::new();
    File::open(path)
        .and_then(|file| file.take(max + 1).read_to_end(&mut bytes))
        .map_err(|cause| Error::unreadable(path, &cause))?;
    if u64::try_from(bytes.len()).is_ok_and(|len| len > max) {
        let what = format!("it has more than the accepted {max} bytes");
        return Err(Error::content(path, None, what));
    }
    Ok(bytes)
}

/// Reads a text of at most [`MAX_TEXT`] bytes.
///
/// # Errors
/// Those of [`read`]; [`Error::Content`] for what is not UTF-8.
pub fn read_text(path: &Path) -> Result<String, Error> {
    String::from_utf8(read(path, MAX_TEXT)?)
        .map_err(|_| Error::content(path, None, "it is no text in UTF-8"))
}

/// Whether bytes are an EEPROM's content: it begins with the EEPROM key, or has the unwritten cells of page
/// 0x00 that no other file has.
fn is_image(bytes: &[u8]) -> bool {
    let unwritten = bytes.get(0xF0..0x100).unwrap_or_default();
    (ORIGINAL_LEN..=LARGEST_LEN).contains(&bytes.len())
        && (bytes.starts_with(&KEY) || unwritten.iter().all(|&byte| byte == 0xFF))
}

/// What an output file holds. A file that is there already is replaced only by one of its kind.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Kind {
    /// A picture.
    Png,
    /// A map's cells.
    Pgm,
    /// A map's metadata.
    MapYaml,
    /// Samples of a tuning.
    Samples,
    /// What a calibration keeps.
    Json,
    /// The STM's log.
    Log,
    /// An EEPROM image.
    Image,
    /// A recording (MCAP).
    Recording,
    /// Whatever the user allows to be replaced.
    Any,
}

impl Kind {
    /// Its name, and how its files begin.
    const fn signature(self) -> (&'static str, &'static [&'static [u8]]) {
        match self {
            Self::Png => ("PNG picture", &[b"\x89PNG\r\n\x1a\n"]),
            Self::Pgm => ("PGM picture", &[b"P5\n"]),
            Self::MapYaml => ("map's YAML", &[b"image: "]),
            Self::Samples => ("table of samples", &[b"seconds,percent,"]),
            Self::Json => ("JSON object", &[b"{"]),
            Self::Log => ("log of the STM", &[b"I0", b"W0", b"E0"]),
            Self::Image => ("EEPROM image", &[]),
            Self::Recording => ("recording", &[b"\x89MCAP"]),
            Self::Any => ("file", &[b""]),
        }
    }

    /// Whether a file of which these are the first bytes, [`LONGEST_HEAD`] at most, is of this kind.
    fn holds(self, head: &[u8]) -> bool {
        let (_, starts) = self.signature();
        let begins = starts.iter().any(|start| head.starts_with(start));
        begins || self == Self::Image && is_image(head)
    }
}

/// So much of a file shows its kind: an EEPROM's image is not longer.
const LONGEST_HEAD: u64 = LARGEST_LEN as u64 + 1;

/// # Errors
/// [`Error::Unwritable`] if what is at `path` must not be replaced.
fn check_target(path: &Path, kind: Kind) -> Result<(), Error> {
    let present = match fs::symlink_metadata(path) {
        Err(cause) if cause.kind() == ErrorKind::NotFound => return Ok(()),
        present => present.map_err(|cause| Error::unwritable(path, &cause))?,
    };
    if !present.is_file() {
        return Err(Error::unwritable(
            path,
            &"it is a link, a folder or a device",
        ));
    }
    let mut head = Vec::new();
    if kind != Kind::Any {
        File::open(path)
            .and_then(|file| file.take(LONGEST_HEAD).read_to_end(&mut head))
            .map_err(|cause| Error::unwritable(path, &cause))?;
    }
    if !head.is_empty() && !kind.holds(&head) {
        let (kind, _) = kind.signature();
        let cause = format!("the file that is there is no {kind}; name another one");
        return Err(Error::unwritable(path, &cause));
    }
    Ok(())
}

/// A file to write: a temporary one beside its place until it is complete.
#[derive(Debug)]
pub struct OutputFile {
    path: PathBuf,
    beside: PathBuf,
    file: File,
}

impl OutputFile {
    // Requirement: WIRE-program-1
    /// Checks that `path` may be written, makes its folder and the temporary file.
    ///
    /// # Errors
    /// [`Error::Unwritable`].
    pub fn create(path: &Path, kind: Kind) -> Result<Self, Error> {
        check_target(path, kind)?;
        let unwritable = |cause| Error::unwritable(path, &cause);
        let Some(name) = path.file_name() else {
            return Err(unwritable(ErrorKind::IsADirectory.into()));
        };
        fs::create_dir_all(folder(path)).map_err(unwritable)?;
        let beside = path.with_file_name(format!(".{}.robot-new", name.to_string_lossy()));
        // Left by a killed run, or a link that leads elsewhere: a new file is made in any case.
        match fs::remove_file(&beside) {
            Err(cause) if cause.kind() != ErrorKind::NotFound => return Err(unwritable(cause)),
            _ => {}
        }
        let file = File::create_new(&beside).map_err(unwritable)?;
        Ok(Self {
            path: path.into(),
            beside,
            file,
        })
    }

    /// Writes the bytes and puts the file in its place.
    ///
    /// # Errors
    /// [`Error::Unwritable`].
    pub fn save(mut self, bytes: &[u8]) -> Result<(), Error> {
        let written = self.file.write_all(bytes);
        written.map_err(|cause| Error::unwritable(&self.path, &cause))?;
        self.publish()
    }

    /// Another handle of the file, with which it is written before and after [`OutputFile::publish`].
    ///
    /// # Errors
    /// [`Error::Unwritable`].
    pub fn handle(&self) -> Result<File, Error> {
        let file = self.file.try_clone();
        file.map_err(|cause| Error::unwritable(&self.path, &cause))
    }

    /// Puts the file in its place as it is.
    ///
    /// # Errors
    /// [`Error::Unwritable`].
    pub fn publish(self) -> Result<(), Error> {
        let published = self.file.sync_all().and_then(|()| {
            fs::rename(&self.beside, &self.path)?;
            sync_folder(&self.path)
        });
        published.map_err(|cause| Error::unwritable(&self.path, &cause))
    }
}

impl Drop for OutputFile {
    fn drop(&mut self) {
        // After `publish` there is none.
        let _ = fs::remove_file(&self.beside);
    }
}

fn folder(path: &Path) -> &Path {
    let parent = path.parent();
    let parent = parent.filter(|parent| !parent.as_os_str().is_empty());
    parent.unwrap_or(Path::new("."))
}

/// A rename survives a power failure once its folder is written.
pub(crate) fn sync_folder(path: &Path) -> std::io::Result<()> {
    File::open(folder(path))?.sync_all()
}

/// Writes a file whole, or leaves what was there.
///
/// # Errors
/// [`Error::Unwritable`], also for a device, a link, or a file of another kind at `path`.
pub fn save(path: &Path, kind: Kind, bytes: &[u8]) -> Result<(), Error> {
    OutputFile::create(path, kind)?.save(bytes)
}

/// Whether `path` can be written, before something moves.
///
/// # Errors
/// Those of [`save`].
pub fn check(path: &Path, kind: Kind) -> Result<(), Error> {
    OutputFile::create(path, kind).map(drop)
}

/// `path` with `suffix` added to its name.
pub fn with_suffix(path: &Path, suffix: &str) -> PathBuf {
    let mut name = path.as_os_str().to_owned();
    name.push(suffix);
    name.into()
}

#[cfg(test)]
mod tests {
    use super::*;
    use std::os::unix::fs::symlink;

    fn names(folder: &Path) -> Vec<String> {
        let name = |entry: std::io::Result<fs::DirEntry>| entry.unwrap().file_name();
        let mut names: Vec<_> = fs::read_dir(folder).unwrap().map(name).collect();
        names.sort();
        let text = |name: &std::ffi::OsString| name.to_string_lossy().into();
        names.iter().map(text).collect()
    }

    // Requirement: WIRE-program-1
    #[test]
    fn save_device_link_folder_or_foreign_file_is_refused() {
        let here = tempfile::tempdir().unwrap();
        let here = here.path();
        let (foreign, link, folder) =
            (here.join("foreign"), here.join("link"), here.join("folder"));
        fs::write(&foreign, "a letter").unwrap();
        symlink(&foreign, &link).unwrap();
        fs::create_dir(&folder).unwrap();
        // Links are not followed, even where nothing foreign is at their ends.
        let (picture, dangling) = (here.join("picture"), here.join("dangling"));
        symlink(here.join("nothing"), &dangling).unwrap();
        let own = here.join("own.png");
        fs::write(&own, b"\x89PNG\r\n\x1a\n").unwrap();
        symlink(&own, &picture).unwrap();
        let socket = here.join("socket");
        let _listener = std::os::unix::net::UnixListener::bind(&socket).unwrap();
        let before = names(here);
        let inside = here.join("foreign/x");
        for path in [
            &foreign, &link, &picture, &dangling, &folder, &socket, &inside,
        ] {
            let refused = save(path, Kind::Png, b"\x89PNG\r\n\x1a\n");
            assert!(matches!(refused, Err(Error::Unwritable { .. })), "{path:?}");
            assert!(check(path, Kind::Png).is_err());
        }
        assert_eq!(fs::read(&foreign).unwrap(), b"a letter");
        assert_eq!(names(here), before);
        save(&foreign, Kind::Any, b"replaced").unwrap();
        assert_eq!(fs::read(&link).unwrap(), b"replaced");
    }

    // Requirement: WIRE-program-1
    #[test]
    fn save_replaces_its_kind_and_follows_no_planted_link() {
        let here = tempfile::tempdir().unwrap();
        let here = here.path();
        let (map, victim) = (here.join("map.pgm"), here.join("victim"));
        fs::write(&victim, "kept").unwrap();
        symlink(&victim, here.join(".map.pgm.robot-new")).unwrap();
        for bytes in [b"P5\n1", b"P5\n2"] {
            save(&map, Kind::Pgm, bytes).unwrap();
            assert_eq!(fs::read(&map).unwrap(), bytes);
        }
        check(&map, Kind::Pgm).unwrap();
        assert_eq!(fs::read(&victim).unwrap(), b"kept");
        assert_eq!(names(here), ["map.pgm", "victim"]);
    }

    #[test]
    fn image_is_told_from_other_files_by_key_or_unwritten_cells() {
        let here = tempfile::tempdir().unwrap();
        let here = here.path();
        let path = here.join("image.bin");
        let is_replaced = |bytes: &[u8]| {
            fs::write(&path, bytes).unwrap();
            assert_eq!(read(&path, bytes.len() as u64).unwrap(), bytes);
            assert!(read(&path, bytes.len() as u64 - 1).is_err());
            check(&path, Kind::Image).is_ok()
        };
        let unwritten = |len: usize, cells: std::ops::Range<usize>| {
            let mut bytes = vec![0; len];
            bytes[cells].fill(0xFF);
            bytes
        };
        assert!(is_replaced(&unwritten(ORIGINAL_LEN, 0xF0..0x100)));
        for cells in [0xF1..0x100, 0xF0..0xFF] {
            assert!(!is_replaced(&unwritten(ORIGINAL_LEN, cells)));
        }
        for (len, is_image) in [
            (ORIGINAL_LEN - 1, false),
            (ORIGINAL_LEN, true),
            (LARGEST_LEN, true),
            (LARGEST_LEN + 1, false),
        ] {
            let mut keyed = vec![0; len];
            keyed[..KEY.len()].copy_from_slice(&KEY);
            assert_eq!(is_replaced(&keyed), is_image, "{len}");
            assert_eq!(is_replaced(&unwritten(len, 0xF0..0x100)), is_image, "{len}");
        }
    }

    #[test]
    fn log_is_replaced_whatever_its_first_line_reports() {
        let here = tempfile::tempdir().unwrap();
        let path = here.path().join("stm.log");
        for (first, is_log) in [("I0", true), ("W0", true), ("E0", true), ("D0", false)] {
            fs::write(&path, first.to_owned() + "0000: line\n").unwrap();
            assert_eq!(check(&path, Kind::Log).is_ok(), is_log, "{first}");
        }
    }

    #[test]
    fn file_is_replaced_by_its_own_kind_alone() {
        let here = tempfile::tempdir().unwrap();
        let path = here.path().join("output");
        let files: [(_, &[u8]); 5] = [
            (Kind::Pgm, b"P5\n4 4\n"),
            (Kind::MapYaml, b"image: map.pgm\n"),
            (Kind::Samples, b"seconds,percent,mm\n"),
            (Kind::Json, b"{}\n"),
            (Kind::Recording, b"\x89MCAP0\r\n"),
        ];
        for (present, bytes) in files {
            fs::write(&path, bytes).unwrap();
            for (kind, _) in files {
                assert_eq!(check(&path, kind).is_ok(), kind == present, "{kind:?}");
            }
        }
    }

    #[test]
    fn suffix_is_added_to_whole_name_and_bare_name_lies_here() {
        assert_eq!(with_suffix(Path::new("b/a.x"), ".y"), Path::new("b/a.x.y"));
        assert_eq!(folder(Path::new("b/a.x")), Path::new("b"));
        assert_eq!(folder(Path::new("a.x")), Path::new("."));
    }

    #[test]
    fn text_that_is_not_utf_8_is_refused() {
        let here = tempfile::tempdir().unwrap();
        let path = here.path().join("a.toml");
        fs::write(&path, b"mode = \"\xFF\"").unwrap();
        assert!(matches!(read_text(&path), Err(Error::Content { .. })));
    }

    #[test]
    fn read_endless_device_is_refused() {
        for refused in [
            read(Path::new("/dev/zero"), 1 << 16),
            read_text(Path::new("/dev/zero")).map(String::into),
        ] {
            let error = refused.unwrap_err().to_string();
            assert!(error.contains("/dev/zero: it has more than"), "{error}");
        }
    }

    #[test]
    fn fault_shows_line_and_caret() {
        let text = "one\n\tç = bad # no\n";
        let at = text.find("bad").unwrap();
        let fault = FileFault::at(text, at..at + 3, "accepted is good");
        let expected = "f.toml, line 2: accepted is good\n    \tç = bad # no\n    \t    ^^^";
        assert_eq!(fault.describe(Path::new("f.toml")), expected);
        let end = FileFault::at(text, text.len()..text.len() + 9, "cut");
        assert_eq!(end.line, Some(3));
    }
}

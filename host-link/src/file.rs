//! Files: inputs are bounded, outputs are written whole or not at all and never over a foreign file.

use crate::error::Error;
pub use crate::file_fault::FileFault;
use fw_core::eeprom::KEY;
use rustix::process::geteuid;
use std::fs::{self, File, Metadata};
use std::io::{self, ErrorKind, Read, Write};
use std::os::unix::fs::{MetadataExt, OpenOptionsExt};
use std::path::{Path, PathBuf};

#[cfg(test)]
mod tests;

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

/// Reads a text of at most [`MAX_TEXT`] bytes, without the byte order mark of some editors.
///
/// # Errors
/// Those of [`read`]; [`Error::Content`] for what is not UTF-8.
pub fn read_text(path: &Path) -> Result<String, Error> {
    let text = String::from_utf8(read(path, MAX_TEXT)?)
        .map_err(|_| Error::content(path, None, "it is no text in UTF-8"))?;
    Ok(text.trim_start_matches('\u{FEFF}').into())
}

/// Checks that a file kept between runs can be trusted: a regular file, and in a world-writable folder one of this
/// user or of root.
///
/// # Errors
/// [`Error::Unreadable`].
pub fn ensure_trusted(path: &Path) -> Result<(), Error> {
    let unreadable = |cause| Error::unreadable(path, &cause);
    let file = fs::symlink_metadata(path).map_err(unreadable)?;
    let folder = fs::metadata(folder(path)).map_err(unreadable)?;
    let own = geteuid().as_raw();
    let refused = if !file.is_file() {
        "it is a link, a folder or a device"
    } else if folder.mode() & 0o002 != 0 && ![0, own].contains(&file.uid()) {
        "it is another user's: run this as that user, or remove it"
    } else {
        return Ok(());
    };
    Err(unreadable(io::Error::other(refused)))
}

/// Whether bytes are an EEPROM's content: it begins with the EEPROM key, or has the unwritten cells of page
/// 0x00 that no other file has.
pub fn is_image(bytes: &[u8]) -> bool {
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
    /// A secret, which its owner alone may read.
    Token,
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
            Self::Token | Self::Any => ("file", &[b""]),
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

/// Whether the user `own` may replace a file: in a sticky folder root, its owner and the folder's may.
fn may_replace(own: u32, file: &Metadata, folder: &Metadata) -> bool {
    folder.mode() & 0o1000 == 0 || own == 0 || [file.uid(), folder.uid()].contains(&own)
}

/// # Errors
/// Why what is at `path` must not be replaced.
fn check_target(path: &Path, kind: Kind) -> io::Result<()> {
    let present = match fs::symlink_metadata(path) {
        Err(cause) if cause.kind() == ErrorKind::NotFound => return Ok(()),
        present => present?,
    };
    if !present.is_file() {
        return Err(io::Error::other("it is a link, a folder or a device"));
    }
    if !may_replace(geteuid().as_raw(), &present, &fs::metadata(folder(path))?) {
        let why = "it is another user's in a sticky folder; name another file";
        return Err(io::Error::other(why));
    }
    let mut head = Vec::new();
    if kind != Kind::Any {
        let file = File::open(path)?;
        file.take(LONGEST_HEAD).read_to_end(&mut head)?;
    }
    if !head.is_empty() && !kind.holds(&head) {
        let (kind, _) = kind.signature();
        let why = format!("the file that is there is no {kind}; name another one");
        return Err(io::Error::other(why));
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
        let unwritable = |cause| Error::unwritable(path, &cause);
        check_target(path, kind).map_err(unwritable)?;
        let Some(name) = path.file_name() else {
            return Err(unwritable(ErrorKind::IsADirectory.into()));
        };
        fs::create_dir_all(folder(path)).map_err(unwritable)?;
        let beside = path.with_file_name(format!(".{}.robot-new", name.to_string_lossy()));
        // Left by a killed run, or a link that leads elsewhere: a new file is made, or none.
        let _ = fs::remove_file(&beside);
        let mode = if kind == Kind::Token { 0o600 } else { 0o666 };
        let mut options = File::options();
        let new = options.read(true).write(true).create_new(true).mode(mode);
        let file = new.open(&beside).map_err(unwritable)?;
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
pub(crate) fn sync_folder(path: &Path) -> io::Result<()> {
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

//! EEPROM images in files, and the difference between two.

use crate::error::Error;
use crate::file;
pub use crate::file::{LARGEST_LEN, ORIGINAL_LEN};
use fw_core::eeprom::{IMAGE_LEN, Image};
use std::fmt::Write as _;
use std::ops::Range;
use std::path::Path;

/// Reads an image: 0x300 bytes (original, page 0x03 then counts as unwritten) to 64 KiB, of which
/// pages 0x00 to 0x03 are taken.
///
/// # Errors
/// [`Error::Unreadable`], [`Error::Content`].
pub fn load(path: &Path) -> Result<Image, Error> {
    let bytes = file::read(path, LARGEST_LEN as u64)?;
    if !(ORIGINAL_LEN..=LARGEST_LEN).contains(&bytes.len()) {
        let accepted = format!("{ORIGINAL_LEN} (pages 0x00 to 0x02) to {LARGEST_LEN} bytes");
        let len = bytes.len();
        let what = format!("{len} bytes are no EEPROM image: accepted are {accepted}");
        return Err(Error::content(path, None, what));
    }
    let mut image = Image::BLANK;
    for (cell, byte) in image.0.iter_mut().zip(bytes) {
        *cell = byte;
    }
    Ok(image)
}

/// Hexadecimal with addresses, sixteen bytes a line; lines of unwritten cells only are left out.
pub fn hex(image: &Image) -> String {
    let mut text = String::new();
    for (address, row) in (0usize..).step_by(16).zip(image.0.chunks(16)) {
        if row.iter().all(|&byte| byte == 0xFF) {
            continue;
        }
        let bytes: Vec<String> = row.iter().map(|byte| format!("{byte:02X}")).collect();
        let _ = writeln!(text, "{address:04X}  {}", bytes.join(" "));
    }
    if text.is_empty() {
        text.push_str("blank: every cell reads 0xFF\n");
    }
    text
}

/// The stretches in which two images differ.
pub fn differences(before: &Image, after: &Image) -> Vec<Range<usize>> {
    let mut stretches: Vec<Range<usize>> = Vec::new();
    for at in (0..IMAGE_LEN).filter(|&at| before.0.get(at) != after.0.get(at)) {
        match stretches.last_mut() {
            Some(last) if last.end == at => last.end = at + 1,
            _ => stretches.push(at..at + 1),
        }
    }
    stretches
}

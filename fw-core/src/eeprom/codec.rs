//! Image → configuration and back, along the tables.

use super::field::{Accepted, Field, Kind, FIELDS};
use super::rule::RULES;
use super::{crc32, first_board, Config, ConfigError, Image, Value};

/// What stands at 0x0000 of every configured EEPROM (document, 6.0.1).
// Requirement: DOC-6.0.1-1
pub const KEY: [u8; 10] = [0x15, 0x26, 0x37, 0x48, 0x59, 0x6A, 0x7B, 0x8C, 0x9D, 0xAE];

/// Bytes of page 0x03 that its layout defines, checksum included.
pub const PLATFORM_LEN: usize = 0x38;

/// Where the checksum stands: behind the last byte that it covers.
pub const CRC_ADDRESS: u16 = 0x0334;

/// Where page 0x03 begins.
const PLATFORM: u16 = 0x0300;

/// The configuration of an image, if all of it is right.
///
/// # Errors
/// The first field that is not: the EEPROM key, then version, length and checksum of page 0x03
/// (unless that is blank: the first board's figures), then the fields by address, then what they
/// must hold together.
// Requirement: DOC-6-4, DOC-6-5, WIRE-refused-2
pub fn decode(image: &Image) -> Result<Config, ConfigError> {
    let key: [u8; 10] = array(image, 0);
    if !key
        .iter()
        .zip(&KEY)
        .all(|(found, expected)| found == expected)
    {
        return Err(ConfigError {
            address: 0,
            field: "EEPROM key",
            unit: "",
            value: Value::Key(key),
            expected: Accepted::Key,
        });
    }
    let original = is_blank(image);
    if !original {
        for field in FIELDS {
            if matches!(field.address, 0x0300 | 0x0301) {
                accepted(field, read(image, field), u8::MAX)?;
            }
        }
        let found = u32::from_le_bytes(array(image, CRC_ADDRESS));
        let computed = checksum(image);
        if found != computed {
            return Err(ConfigError {
                address: CRC_ADDRESS,
                field: "crc",
                unit: "",
                value: Value::Checksum(found),
                expected: Accepted::Checksum(computed),
            });
        }
    }
    let mut config = first_board();
    for field in FIELDS {
        if original && field.address >= PLATFORM {
            continue;
        }
        let raw = read(image, field);
        // The cells stand before the taps.
        accepted(field, raw, config.cells)?;
        field.set(&mut config, raw);
    }
    rules(&config)?;
    Ok(config)
}

/// Whether a configuration that did not come from an image is one that [`decode`] accepts.
///
/// # Errors
/// The first field that is not.
pub fn check(config: &Config) -> Result<(), ConfigError> {
    for field in FIELDS {
        accepted(field, field.get(config), config.cells)?;
    }
    rules(config)
}

/// Writes a configuration into an image: the EEPROM key, every field, the checksum. Bytes that no
/// field claims stay as they are, and the checksum covers them as they are.
pub fn encode(config: &Config, image: &mut Image) {
    encode_fields(config, image, u16::MAX);
    let sum = checksum(image);
    put(image, CRC_ADDRESS, &sum.to_le_bytes());
}

/// Writes a configuration into an image as the original knows it: pages 0x00 to 0x02, and a blank
/// page 0x03. The platform's figures are lost: the first board's apply.
pub fn encode_original(config: &Config, image: &mut Image) {
    encode_fields(config, image, PLATFORM);
    put(image, PLATFORM, &[0xFF; PLATFORM_LEN]);
}

// Requirement: DOC-6.0.1-3, WIRE-eeprom-9
fn encode_fields(config: &Config, image: &mut Image, end: u16) {
    put(image, 0, &KEY);
    for field in FIELDS {
        if field.address >= end {
            continue;
        }
        let raw = field.get(config).to_le_bytes();
        let bytes = raw.get(..field.kind.len()).unwrap_or_default();
        put(image, field.address, bytes);
    }
}

fn accepted(field: &Field, raw: u64, cells: u8) -> Result<(), ConfigError> {
    if field.takes(raw, cells) {
        Ok(())
    } else {
        Err(rejected(field, raw, *field.accepted))
    }
}

fn rules(config: &Config) -> Result<(), ConfigError> {
    for rule in RULES {
        if (rule.holds)(config) {
            continue;
        }
        broken(config, rule.address, rule.expected)?;
    }
    Ok(())
}

/// The field at `address` is not what the configuration or the firmware takes; `Ok` where none is
/// there.
#[cold]
#[inline(never)]
pub(super) fn broken(
    config: &Config,
    address: u16,
    expected: &'static str,
) -> Result<(), ConfigError> {
    match Field::at(address) {
        Some(field) => {
            let raw = field.get(config);
            Err(rejected(field, raw, Accepted::Rule(expected)))
        }
        None => Ok(()),
    }
}

fn rejected(field: &Field, raw: u64, expected: Accepted) -> ConfigError {
    ConfigError {
        address: field.address,
        field: field.name,
        unit: field.unit,
        value: field.value(raw),
        expected,
    }
}

/// Whether page 0x03 was never written.
// Requirement: WIRE-eeprom-1
fn is_blank(image: &Image) -> bool {
    // Byte by byte, here and for the key: comparing whole arrays would link a routine of its own.
    array::<PLATFORM_LEN>(image, PLATFORM)
        .iter()
        .all(|&byte| byte == 0xFF)
}

/// CRC-32 over everything before the checksum: pages 0x00 to 0x02 and the page's own fields.
// Requirement: WIRE-eeprom-2
fn checksum(image: &Image) -> u32 {
    let covered = image.get(..usize::from(CRC_ADDRESS)).unwrap_or_default();
    crc32(covered)
}

/// `N` bytes from `address`; those beyond the image, which no field has, read as a blank EEPROM.
fn array<const N: usize>(image: &Image, address: u16) -> [u8; N] {
    let from = image.get(usize::from(address)..).unwrap_or_default();
    from.first_chunk().copied().unwrap_or([0xFF; N])
}

// Requirement: WIRE-eeprom-8
fn read(image: &Image, field: &Field) -> u64 {
    match field.kind {
        Kind::U8 => u8::from_le_bytes(array(image, field.address)).into(),
        Kind::U16 => u16::from_le_bytes(array(image, field.address)).into(),
        Kind::U32 => u32::from_le_bytes(array(image, field.address)).into(),
        Kind::Binary64 => u64::from_le_bytes(array(image, field.address)),
    }
}

fn put(image: &mut Image, address: u16, bytes: &[u8]) {
    let slots = image.get_mut(usize::from(address)..).unwrap_or_default();
    for (slot, &byte) in slots.iter_mut().zip(bytes) {
        *slot = byte;
    }
}

//! T3: decoding is total, encoding its inverse.

use fw_core::eeprom::{
    check, crc32, decode, encode, encode_original, first_board, Config, Image, Platform,
    CRC_ADDRESS, FIELDS, IMAGE_LEN, KEY,
};

use super::accepted::AcceptedConfig;
use crate::property::Seen;

/// Where page 0x03 begins, and where what it defines ends.
const PLATFORM: usize = 0x300;
/// The first byte that nothing covers.
const UNCOVERED: usize = 0x338;

/// Puts the checksum that belongs to the image.
pub fn mend(image: &mut Image) {
    let at = usize::from(CRC_ADDRESS);
    let sum = crc32(&image[..at]).to_le_bytes();
    image[at..at + 4].copy_from_slice(&sum);
}

/// An image of the first board, its unclaimed bytes `filler`.
#[must_use]
pub fn first_image(filler: u8) -> Image {
    let mut image = [filler; IMAGE_LEN];
    encode(&first_board(), &mut image);
    image
}

/// A configuration that [`check`] accepts comes back from its image as it went in, and the image from
/// the configuration, whatever its unclaimed bytes hold.
// Requirement: DOC-6-4
pub fn configuration_survives_the_image(config: AcceptedConfig, filler: u8) -> Seen {
    let AcceptedConfig(config) = config;
    assert!(check(&config).is_ok());
    let mut image = [filler; IMAGE_LEN];
    encode(&config, &mut image);
    assert!(decode(&image).as_ref() == Ok(&config));
    let mut again = [filler; IMAGE_LEN];
    encode(&config, &mut again);
    assert!(image == again);
    Seen::NOTHING
        .case(0, config.platform.servo)
        .case(1, config.cells == 8)
        .case(2, config.cells == 1)
}

/// The original's image, page 0x03 blank, means the same configuration on the first board.
// Requirement: WIRE-eeprom-1
pub fn original_image_means_the_first_board(config: AcceptedConfig, filler: u8) -> Seen {
    let AcceptedConfig(config) = config;
    let expected = Config {
        platform: Platform::FIRST_BOARD,
        ..config
    };
    let mut image = [filler; IMAGE_LEN];
    encode_original(&expected, &mut image);
    match decode(&image) {
        Ok(found) => assert!(found == expected),
        // The one mode that the first board cannot run.
        Err(_) => assert!(check(&expected).is_err()),
    }
    Seen::NOTHING
        .case(0, check(&expected).is_ok())
        .case(1, check(&expected).is_err())
}

/// Any image decodes to a configuration or an error, without a panic; what is accepted would be
/// accepted again, and writing it back changes no byte. `writes` are what somebody wrote over a good
/// image; `mended` puts the right checksum after it.
pub fn accepted_image_is_its_configuration(
    filler: u8,
    writes: [(u16, u64); 3],
    mended: bool,
) -> Seen {
    let mut image = first_image(filler);
    for (at, value) in writes {
        for (place, byte) in value.to_le_bytes().into_iter().enumerate() {
            if let Some(slot) = image.get_mut(usize::from(at % 0x400) + place) {
                *slot = byte;
            }
        }
    }
    if mended {
        mend(&mut image);
    }
    let decoded = decode(&image);
    if let Ok(config) = &decoded {
        assert!(check(config).is_ok());
        assert!(image[..KEY.len()] == KEY);
        let mut back = image;
        encode(config, &mut back);
        assert!(back == image);
    }
    Seen::NOTHING
        .case(0, decoded.is_ok() && mended)
        .case(1, decoded.is_err() && mended)
        .case(2, decoded.is_err() && !mended)
}

/// One field of a good image holds `raw`, and the checksum agrees, or page 0x03 is blank as in the
/// `original`: it is accepted exactly when the table takes it and the rules hold, and then every other
/// field is as it was.
// Requirement: DOC-6.0.2-1, WIRE-eeprom-10
pub fn field_is_taken_by_its_table(which: u8, raw: u64, original: bool) -> Seen {
    let field = &FIELDS[usize::from(which) % FIELDS.len()];
    let original = original && usize::from(field.address) < PLATFORM;
    let mut image = [0xFF; IMAGE_LEN];
    if original {
        encode_original(&first_board(), &mut image);
    } else {
        encode(&first_board(), &mut image);
    }
    let bytes = raw.to_le_bytes();
    let at = usize::from(field.address);
    let width = field.kind.len();
    image[at..at + width].copy_from_slice(&bytes[..width]);
    if !original {
        mend(&mut image);
    }
    let raw = raw & (u64::MAX >> (64 - 8 * width));
    let decoded = decode(&image);
    if let Ok(found) = &decoded {
        assert!(field.takes(raw, found.cells));
        for other in FIELDS {
            if other.address == field.address {
                assert!(other.get(found) == raw);
            } else if other.tap <= found.cells {
                assert!(other.get(found) == other.get(&first_board()));
            }
        }
    } else {
        let mut wanted = first_board();
        field.set(&mut wanted, raw);
        assert!(!field.takes(raw, wanted.cells) || check(&wanted).is_err());
    }
    Seen::NOTHING
        .case(0, decoded.is_ok())
        .case(1, decoded.is_err())
}

/// One wrong bit in what the checksum covers, or in the checksum, is an image that is rejected; one
/// beyond changes nothing.
// Requirement: WIRE-eeprom-2
pub fn single_wrong_bit_is_rejected(bit: u16, filler: u8) -> Seen {
    let good = first_image(filler);
    let at = usize::from(bit / 8);
    let mut image = good;
    let Some(byte) = image.get_mut(at) else {
        return Seen::NOTHING;
    };
    *byte ^= 1 << (bit % 8);
    let decoded = decode(&image);
    assert!(decoded.is_err() == (at < UNCOVERED));
    if let Ok(config) = &decoded {
        assert!(*config == first_board());
    }
    Seen::NOTHING
        .case(0, at < PLATFORM)
        .case(1, (PLATFORM..UNCOVERED).contains(&at))
        .case(2, at >= UNCOVERED)
}

/// A burst of up to 32 wrong bits anywhere in what the checksum covers, the checksum included, is an
/// image that is rejected. `pattern`'s lowest bit is the burst's first: bits of a byte go out lowest
/// first, as the checksum takes them.
// Requirement: WIRE-eeprom-2
pub fn image_burst_is_rejected(start: u16, pattern: u32, filler: u8) -> Seen {
    let start = usize::from(start);
    let length = 32 - pattern.leading_zeros() as usize;
    if pattern & 1 == 0 || start + length > UNCOVERED * 8 {
        return Seen::NOTHING;
    }
    let mut image = first_image(filler);
    let shifted = u64::from(pattern) << (start % 8);
    for (place, change) in shifted.to_le_bytes().into_iter().enumerate() {
        image[start / 8 + place] ^= change;
    }
    assert!(decode(&image).is_err());
    Seen::NOTHING
        .case(0, start / 8 >= usize::from(CRC_ADDRESS) - 4)
        .case(1, pattern >> 31 == 1)
        .case(2, start / 8 < KEY.len())
}

crate::properties! {
    property T3 configuration_survives_the_image(config: AcceptedConfig, filler: u8) {
        cases ["a servo", "eight cells", "one cell"];
        sampled 50_000;
    }
    property T3 original_image_means_the_first_board(config: AcceptedConfig, filler: u8) {
        cases ["accepted", "a mode that the first board cannot run"];
        sampled 50_000;
    }
    property T3 accepted_image_is_its_configuration(
        filler: u8, writes: [(u16, u64); 3], mended: bool
    ) {
        cases ["accepted", "rejected for a field", "rejected for the checksum"];
        sampled 50_000;
    }
    property T3 field_is_taken_by_its_table(which: u8, raw: u64, original: bool) {
        cases ["taken", "rejected"];
        stepped (0..=255_u8).flat_map(|which| {
            [0, 1, 2, 3, 8, 9, 0xFF, 0x1_0000, u64::MAX, 1.0_f64.to_bits()].into_iter()
                .chain((0..64).map(|bit| 1 << bit))
                .flat_map(move |raw| [(which, raw, false), (which, raw, true)])
        });
        sampled 50_000;
    }
    theorem T3 single_wrong_bit_is_rejected(bit: u16, filler: u8) {
        cases ["in the document's pages", "in the platform's page", "beyond the checksum"];
        exhaustive (0..8 * 0x400).flat_map(|bit| [(bit, 0), (bit, 0xFF)]);
    }
    property T3 image_burst_is_rejected(start: u16, pattern: u32, filler: u8) {
        cases ["in the checksum", "the longest", "in the key"];
        needs [checksum32_is_the_catalogues];
        stepped (0..0x338 * 8).flat_map(|start| {
            [1, 3, 0x8000_0001, u32::MAX, 0xEDB8_8321, 0xDB71_0641].map(|p| (start, p, 0xFF))
        });
        sampled 100_000;
    }
}

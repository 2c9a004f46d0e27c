//! T3: the image is read and written field by field, and decoding is total.

use fw_core::eeprom::{CRC_ADDRESS, Config, FIELDS, Field, IMAGE_LEN, Image, KEY, PLATFORM, SPANS};

#[cfg(kani)]
use fw_core::eeprom::fields::{
    CELLS, COUNTS_PER_TURN, FORWARD_P, MOTOR_LEFT_REVERSED, SIGNS_RESERVED, TRACK,
};

use super::accepted::AcceptedConfig;
use crate::property::Seen;

/// Whether the byte at an address means something.
fn is_defined(address: usize) -> bool {
    SPANS.iter().any(|span| {
        let start = usize::from(span.address);
        (start..start + usize::from(span.len)).contains(&address)
    })
}

/// An image of these values, its undefined bytes `filler`.
fn image_of(values: &AcceptedConfig, filler: u8) -> Image {
    let mut image = Image([filler; IMAGE_LEN]);
    for field in &FIELDS {
        image.set(field, values.get(field));
    }
    image.seal();
    image
}

fn field_of(which: u8) -> &'static Field {
    &FIELDS[usize::from(which) % FIELDS.len()]
}

/// A field's bytes hold what was stored, and the other bits what they held. A bit of the field depends on
/// none but its own, in one kind of field as in another, at any address.
// Requirement: DOC-6-4
pub fn stored_value_is_read_back(which: u8, raw: u64, filler: u64) -> Seen {
    let field = field_of(which);
    let mut image = Image([0; IMAGE_LEN]);
    let start = usize::from(field.address);
    let bytes = &mut image.0[start..start + 8];
    bytes.copy_from_slice(&filler.to_le_bytes());
    image.set(field, raw);
    assert!(image.get(field) == raw & field.kind.max());
    let mut after = [0; 8];
    after.copy_from_slice(&image.0[start..start + 8]);
    assert!((u64::from_le_bytes(after) ^ filler) & !field.kind.mask() == 0);
    Seen::NOTHING
        .case(0, u64::from_le_bytes(after) != filler)
        .case(1, raw > field.kind.max() || field.kind.max() == u64::MAX)
}

/// What is stored in a field is read from it, in the bytes of the table and nowhere else, and no other
/// field changes.
// Requirement: DOC-6-4
pub fn field_is_read_as_written(which: u8, raw: u64, filler: u8) -> Seen {
    let field = field_of(which);
    let before = Image([filler; IMAGE_LEN]);
    let mut after = before.clone();
    after.set(field, raw);
    assert!(after.get(field) == raw & field.kind.max());
    for other in &FIELDS {
        assert!(other.index == field.index || after.get(other) == before.get(other));
    }
    let start = usize::from(field.address);
    let end = start + usize::from(field.kind.bytes());
    assert!(after.0[..start] == before.0[..start] && after.0[end..] == before.0[end..]);
    seen!(after != before, raw > field.kind.max())
}

/// Accepted raw values come back from their image, whatever its undefined bytes hold.
pub fn configuration_survives_the_image(values: AcceptedConfig, filler: u8) -> Seen {
    given!(let Some(config) = values.config());
    let image = image_of(&values, filler);
    assert!(Config::decode(&image).as_ref() == Ok(&config));
    Seen::NOTHING
        .case(0, config.servo().is_some())
        .case(1, config.cells() == 8)
        .case(2, config.cells() == 1)
}

/// The original's image, page 0x03 blank, is the same configuration on the first board.
// Requirement: WIRE-eeprom-1
pub fn original_image_means_the_first_board(values: AcceptedConfig, filler: u8) -> Seen {
    let mut image = image_of(&values, filler);
    image.make_original();
    let platform = FIELDS.iter().filter(|field| field.address >= PLATFORM);
    let expected = platform.fold(values, |values, field| {
        values.with(field, AcceptedConfig::FIRST_BOARD.get(field))
    });
    // None in the one mode that the first board cannot run.
    let expected = expected.config();
    assert!(Config::decode(&image).ok() == expected);
    seen!(expected.is_some(), expected.is_none())
}

/// Any image decodes to a configuration or an error, without a panic: to what its raw values say, if
/// the EEPROM key and the checksum are right. `writes` go over a good image; `sealed` puts the right
/// checksum after them.
pub fn accepted_image_is_its_configuration(
    filler: u8,
    writes: [(u16, u64); 3],
    sealed: bool,
) -> Seen {
    let mut image = image_of(&AcceptedConfig::FIRST_BOARD, filler);
    for (at, value) in writes {
        for (place, byte) in value.to_le_bytes().into_iter().enumerate() {
            if let Some(slot) = image.0.get_mut(usize::from(at % 0x400) + place) {
                *slot = byte;
            }
        }
    }
    if sealed {
        image.seal();
    }
    let decoded = Config::decode(&image);
    let is_protected = image.0[..KEY.len()] == KEY && image.checksum() == image.stored_checksum();
    if is_protected && !image.is_original() {
        let expected = Config::from_fields(|field| image.get(field));
        assert!(decoded.as_ref().ok() == expected.as_ref().ok());
    }
    assert!(decoded.is_err() || is_protected || image.is_original());
    Seen::NOTHING
        .case(0, decoded.is_ok() && sealed)
        .case(1, decoded.is_err() && sealed)
        .case(2, decoded.is_err() && !sealed)
}

/// One field of a good image holds `raw`, and the checksum agrees, or page 0x03 is blank as in the
/// `original`: it is accepted exactly when the table and the constraints accept it.
// Requirement: DOC-6.0.2-1, WIRE-eeprom-10
pub fn field_is_accepted_by_its_table(which: u8, raw: u64, original: bool) -> Seen {
    let field = field_of(which);
    let original = original && field.address < PLATFORM;
    let raw = raw & field.kind.max();
    let mut image = Image::FIRST_BOARD.with(field, raw);
    if original {
        image.make_original();
    }
    let decoded = Config::decode(&image);
    let values = AcceptedConfig::FIRST_BOARD.with(field, raw);
    assert!(decoded.as_ref().ok() == values.config().as_ref());
    if let Ok(config) = &decoded {
        assert!(field.contains(raw, config.cells()));
    }
    seen!(decoded.is_ok(), decoded.is_err())
}

/// One wrong bit in the defined bytes is an image that is rejected; one in another byte changes
/// nothing.
// Requirement: WIRE-eeprom-2
pub fn single_wrong_bit_is_rejected(bit: u16, filler: u8) -> Seen {
    let mut image = image_of(&AcceptedConfig::FIRST_BOARD, filler);
    let at = usize::from(bit / 8);
    given!(let Some(byte) = image.0.get_mut(at));
    *byte ^= 1 << (bit % 8);
    let decoded = Config::decode(&image);
    let defined = is_defined(at);
    assert!(decoded.is_err() == defined);
    assert!(defined || decoded.ok() == AcceptedConfig::FIRST_BOARD.config());
    let platform = usize::from(PLATFORM);
    Seen::NOTHING
        .case(0, at < platform && defined)
        .case(1, at >= platform && defined)
        .case(2, !defined)
}

/// A burst of up to 32 wrong bits is an image that is rejected, if it touches a defined byte.
/// `pattern`'s lowest bit is the burst's first: the checksum takes the lowest bit of a byte first.
// Requirement: WIRE-eeprom-2
pub fn image_burst_is_rejected(start: u16, pattern: u32, filler: u8) -> Seen {
    let start = usize::from(start);
    let length = 32 - pattern.leading_zeros() as usize;
    given!(pattern & 1 != 0 && start + length <= IMAGE_LEN * 8);
    let mut image = image_of(&AcceptedConfig::FIRST_BOARD, filler);
    let shifted = u64::from(pattern) << (start % 8);
    let mut touched = false;
    for (place, change) in shifted.to_le_bytes().into_iter().enumerate() {
        let at = start / 8 + place;
        if change != 0 {
            image.0[at] ^= change;
            touched |= is_defined(at);
        }
    }
    assert!(Config::decode(&image).is_err() == touched);
    Seen::NOTHING
        .case(0, start / 8 >= usize::from(CRC_ADDRESS) - 4 && touched)
        .case(1, pattern >> 31 == 1)
        .case(2, start / 8 < KEY.len())
}

crate::properties! {
    theorem T3 stored_value_is_read_back(which: u8, raw: u64, filler: u64) {
        cases ["changed", "more bits than the field has"];
        kani u8 [unwind(9)] = (CELLS.index, any(), any());
        kani u16 [unwind(9)] = (COUNTS_PER_TURN.index, any(), any());
        kani u32 [unwind(9)] = (TRACK.index, any(), any());
        kani binary64 [unwind(9)] = (FORWARD_P.index, any(), any());
        kani one_bit [unwind(9)] = (MOTOR_LEFT_REVERSED.index, any(), any());
        kani three_bits [unwind(9)] = (SIGNS_RESERVED.index, any(), any());
        stepped (0..=255_u8).flat_map(|which| {
            (0..64).flat_map(move |bit| [0, u64::MAX].map(|filler| (which, 1_u64 << bit, filler)))
        });
        sampled 100_000;
    }
    property T3 field_is_read_as_written(which: u8, raw: u64, filler: u8) {
        cases ["changed", "more bits than the field has"];
        stepped (0..=255_u8).flat_map(|which| {
            [0, 1, 0xA5, 0xFF, 0x1234_5678_9ABC_DEF0, u64::MAX].into_iter()
                .flat_map(move |raw| [(which, raw, 0), (which, raw, 0xFF)])
        });
        sampled 50_000;
    }
    property T3 configuration_survives_the_image(values: AcceptedConfig, filler: u8) {
        cases ["a servo", "eight cells", "one cell"];
        sampled 50_000;
    }
    property T3 original_image_means_the_first_board(values: AcceptedConfig, filler: u8) {
        cases ["accepted", "a mode that the first board cannot run"];
        sampled 50_000;
    }
    property T3 accepted_image_is_its_configuration(
        filler: u8, writes: [(u16, u64); 3], sealed: bool
    ) {
        cases ["accepted", "rejected for a field", "rejected for the checksum"];
        sampled 50_000;
    }
    property T3 field_is_accepted_by_its_table(which: u8, raw: u64, original: bool) {
        cases ["accepted", "rejected"];
        stepped (0..=255_u8).flat_map(|which| {
            [0, 1, 2, 3, 8, 9, 0xFF, 0x1_0000, u64::MAX, 1.0_f64.to_bits()].into_iter()
                .chain((0..64).map(|bit| 1 << bit))
                .flat_map(move |raw| [(which, raw, false), (which, raw, true)])
        });
        sampled 50_000;
    }
    theorem T3 single_wrong_bit_is_rejected(bit: u16, filler: u8) {
        cases ["in the document's pages", "in the platform's page", "in no field"];
        exhaustive (0..8 * 0x400).flat_map(|bit| [(bit, 0), (bit, 0xFF)]);
    }
    property T3 image_burst_is_rejected(start: u16, pattern: u32, filler: u8) {
        cases ["in the checksum", "the longest", "in the key"];
        needs [checksum32_is_the_catalogues];
        stepped (0..0x400 * 8).flat_map(|start| {
            [1, 3, 0x8000_0001, u32::MAX, 0xEDB8_8321, 0xDB71_0641].map(|p| (start, p, 0xFF))
        });
        sampled 100_000;
    }
}

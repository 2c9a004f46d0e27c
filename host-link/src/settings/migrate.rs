//! Images of layout 1 of page 0x03, which ends with the servo's travel and a checksum over every byte
//! before it.

use fw_core::eeprom::fields::{FIELDS, LAYOUT_LENGTH, LAYOUT_VERSION};
use fw_core::eeprom::{Image, KEY, crc32};

/// Where the checksum of layout 1 is stored.
const CHECKSUM: usize = 0x0334;

/// The values of a right image of layout 1 in the layout of today; `None` for any other image.
pub(super) fn from_layout_1(image: &Image) -> Option<Image> {
    let (covered, rest) = image.0.split_at_checked(CHECKSUM)?;
    let is_layout_1 = image.get(LAYOUT_VERSION) == 1
        && image.0.starts_with(&KEY)
        && rest.starts_with(&crc32(0, covered).to_le_bytes());
    is_layout_1.then(|| {
        let mut migrated = image.clone();
        for field in &FIELDS {
            let is_new = usize::from(field.address) >= CHECKSUM
                || [LAYOUT_VERSION.address, LAYOUT_LENGTH.address].contains(&field.address);
            let source = if is_new { &Image::FIRST_BOARD } else { image };
            migrated.set(field, source.get(field));
        }
        migrated.seal();
        migrated
    })
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::settings::Settings;
    use fw_core::eeprom::fields::{BEARING_LEFT, CELLS, TRACK};

    fn layout_1() -> Image {
        let mut image = Image::FIRST_BOARD.with(TRACK, 131_072);
        image.set(BEARING_LEFT, 5);
        // The old checksum covered undefined bytes, too.
        image.0[0x0280] = 0x55;
        image.set(LAYOUT_VERSION, 1);
        image.set(LAYOUT_LENGTH, 0x38);
        image.0[0x0338..].fill(0xFF);
        seal(&mut image);
        image
    }

    /// Stores the checksum of layout 1.
    fn seal(image: &mut Image) {
        let sum = crc32(0, &image.0[..0x0334]).to_le_bytes();
        image.0[0x0334..0x0338].copy_from_slice(&sum);
    }

    #[test]
    fn layout_1_keeps_every_value_and_undefined_byte() {
        let old = layout_1();
        let refused = Settings::from_image(&old).unwrap_err().to_string();
        assert!(refused.contains("`robot eeprom migrate`"), "{refused}");
        let settings = Settings::migrated(&old).unwrap();
        for field in FIELDS.iter().filter(|field| field.constant().is_none()) {
            let kept = field.address < 0x0334;
            let before = if kept { &old } else { &Image::FIRST_BOARD };
            assert_eq!(settings.get(field), before.get(field), "{}", field.name());
        }
        assert_eq!(settings.image().get(LAYOUT_VERSION), 2);
        assert_eq!(settings.image().0[0x0280], 0x55);
    }

    #[test]
    fn layout_1_with_wrong_checksum_or_key_is_rejected() {
        for at in [0x0000, 0x0280, 0x030C, 0x0334] {
            let mut image = layout_1();
            image.0[at] ^= 1;
            assert!(Settings::migrated(&image).is_err(), "{at:#06x}");
        }
        // The checksum is right, the content is not.
        let [mut foreign_key, mut nine_cells] = [layout_1(), layout_1()];
        foreign_key.0[0] ^= 1;
        nine_cells.set(CELLS, 9);
        for (mut image, expected) in [(foreign_key, "key is"), (nine_cells, "cells is 9")] {
            seal(&mut image);
            let error = Settings::migrated(&image).unwrap_err().to_string();
            assert!(error.contains(expected), "{error}");
        }
    }
}

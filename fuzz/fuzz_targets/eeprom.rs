//! Any EEPROM image: rejected with a reason, or a configuration that its raw values give again.
#![no_main]

use fw_core::eeprom::{Config, FIELDS, IMAGE_LEN, Image};
use libfuzzer_sys::fuzz_target;
use robot_fuzz::Bytes;

fuzz_target!(|data: &[u8]| {
    let mut bytes = Bytes::new(data);
    let choice = bytes.byte();
    let mut image = match choice & 3 {
        0 | 1 => Image::FIRST_BOARD,
        2 => Image(bytes.array::<IMAGE_LEN>()),
        _ => Image::BLANK,
    };
    if choice & 3 == 1 {
        image.make_original();
    }
    while bytes.more() {
        let [low, high, value] = bytes.array();
        image.0[usize::from(u16::from_le_bytes([low, high])) % IMAGE_LEN] = value;
    }
    if choice & 4 != 0 {
        image.seal();
    }
    match Config::decode(&image) {
        Ok(config) => {
            // Onto other bytes: only the defined ones count.
            let mut copy = Image([choice; IMAGE_LEN]);
            copy.copy_defined(&image);
            assert_eq!(Config::decode(&copy).as_ref(), Ok(&config));
            let mut fields = Image::BLANK;
            for field in &FIELDS {
                fields.set(field, image.get(field));
            }
            fields.seal();
            assert_eq!(Config::decode(&fields).as_ref(), Ok(&config));
        }
        Err(error) => assert!(usize::from(error.address) < IMAGE_LEN, "{error}"),
    }
});

//! Any EEPROM image: rejected with a reason, or a configuration that is written back to the same
//! bytes.
#![no_main]

use fw_core::eeprom::{
    check, crc32, decode, encode, encode_original, first_board, Image, CRC_ADDRESS, IMAGE_LEN,
    PLATFORM_LEN,
};
use libfuzzer_sys::fuzz_target;
use robot_fuzz::Bytes;

fuzz_target!(|data: &[u8]| {
    let mut bytes = Bytes::new(data);
    let choice = bytes.byte();
    let mut image: Image = [0xFF; IMAGE_LEN];
    match choice & 3 {
        0 => encode(&first_board(), &mut image),
        1 => encode_original(&first_board(), &mut image),
        2 => image.copy_from_slice(&bytes.array::<IMAGE_LEN>()),
        _ => {}
    }
    while bytes.more() {
        let [low, high, value] = bytes.array();
        image[usize::from(u16::from_le_bytes([low, high])) % IMAGE_LEN] = value;
    }
    let at = usize::from(CRC_ADDRESS);
    if choice & 4 != 0 {
        let sum = crc32(&image[..at]);
        image[at..at + 4].copy_from_slice(&sum.to_le_bytes());
    }
    match decode(&image) {
        Ok(config) => {
            assert_eq!(check(&config), Ok(()));
            let mut written = image;
            let original = image[0x300..0x300 + PLATFORM_LEN]
                .iter()
                .all(|&byte| byte == 0xFF);
            if original {
                encode_original(&config, &mut written);
            } else {
                encode(&config, &mut written);
            }
            assert!(
                written == image,
                "an accepted image is not what it is written back to"
            );
            encode(&config, &mut written);
            assert_eq!(decode(&written).as_ref(), Ok(&config));
        }
        Err(error) => assert!(usize::from(error.address) < IMAGE_LEN, "{error}"),
    }
});

//! T3: CRC-32 of page 0x03 is the catalogue's.

use fw_core::eeprom::crc32;

use crate::property::Seen;

/// The catalogue's next byte, bit by bit: reflected, polynomial 0x04C11DB7, exclusive-or with all ones
/// before and after.
fn reference(before: u32, byte: u8) -> u32 {
    let mut crc = !before ^ u32::from(byte);
    for _ in 0..8 {
        let carry = crc & 1 == 1;
        crc >>= 1;
        if carry {
            crc ^= 0xEDB8_8320;
        }
    }
    !crc
}

/// After any bytes before it, a byte makes of the core's checksum what it makes of the catalogue's; so the
/// checksums are the same after any number of bytes.
pub fn checksum32_is_the_catalogues(before: u32, byte: u8) -> Seen {
    let crc = crc32(before, &[byte]);
    assert!(crc == reference(before, byte));
    assert!(crc32(before, &[]) == before);
    seen!(crc == 0, crc == u32::MAX)
}

crate::properties! {
    theorem T3 checksum32_is_the_catalogues(before: u32, byte: u8) {
        cases ["zero", "all ones"];
        kani proof [unwind(9)];
        stepped (0..=u32::MAX).step_by(997).chain(ENDS).map(|before| (before, (before >> 11) as u8));
    }
}

/// The checksums of which some byte makes zero and all ones.
#[cfg(test)]
const ENDS: [u32; 2] = [0x0F6A_7068, 0xFFFF_FF00];

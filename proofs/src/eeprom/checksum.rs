//! T3: CRC-32 of page 0x03. That it catches every burst of up to 32 bits is a property of the
//! polynomial once the code is the polynomial's: a burst is x^k·b(x) with b of a degree below 32, and
//! x has no common divisor with the polynomial, so the remainder cannot be 0.

use fw_core::eeprom::crc32;

use crate::property::Seen;

/// CRC-32/ISO-HDLC as the catalogue defines it, bit by bit: reflected, initial value and final
/// exclusive-or all ones, polynomial 0x04C11DB7.
fn reference(bytes: &[u8]) -> u32 {
    let mut crc = u32::MAX;
    for &byte in bytes {
        crc ^= u32::from(byte);
        for _ in 0..8 {
            let carry = crc & 1 == 1;
            crc >>= 1;
            if carry {
                crc ^= 0xEDB8_8320;
            }
        }
    }
    !crc
}

/// The core's checksum of up to four bytes is the catalogue's. Each byte goes through the same step,
/// so that what holds of four arbitrary bytes holds of every register and byte.
pub fn checksum32_is_the_catalogues(bytes: [u8; 4]) -> Seen {
    assert!(crc32(&bytes[..1]) == reference(&bytes[..1]));
    let crc = crc32(&bytes);
    assert!(crc == reference(&bytes));
    Seen::NOTHING.case(0, crc == 0).case(1, crc == u32::MAX)
}

/// After four bytes the register is any of its 2³² values: the four bytes that make it, by running the
/// checksum backwards.
pub fn every_register_is_reached(register: u32) -> Seen {
    let mut state = !register;
    for _ in 0..32 {
        let carry = state >> 31 == 1;
        if carry {
            state ^= 0xEDB8_8320;
        }
        state = state << 1 | u32::from(carry);
    }
    let bytes = (!state).to_le_bytes();
    assert!(reference(&bytes) == register);
    seen!(register == 0, register == u32::MAX)
}

crate::properties! {
    theorem T3 checksum32_is_the_catalogues(bytes: [u8; 4]) {
        cases ["zero", "all ones"];
        needs [every_register_is_reached];
        kani proof [unwind(9)];
        stepped (0..=u32::MAX).step_by(997)
            .chain(ENDS)
            .map(|bytes| (bytes.to_le_bytes(),));
    }
    theorem T3 every_register_is_reached(register: u32) {
        cases ["zero", "all ones"];
        kani proof [unwind(33)];
        stepped (0..=u32::MAX).step_by(255).map(|register| (register,));
    }
}

/// The four bytes whose checksums are zero and all ones.
#[cfg(test)]
const ENDS: [u32; 2] = [0x6DD9_0A9D, 0xFFFF_FFFF];

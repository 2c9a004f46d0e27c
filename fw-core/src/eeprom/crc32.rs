//! CRC-32/ISO-HDLC: the checksum of page 0x03.

/// The polynomial, bit-reflected.
const POLYNOMIAL: u32 = 0xEDB8_8320;

/// What four bits do to the register.
const NIBBLES: [u32; 16] = {
    let mut table = [0; 16];
    let mut nibble = 0_u8;
    while nibble < 16 {
        let mut crc = nibble as u32;
        let mut bit = 0;
        while bit < 4 {
            crc = crc >> 1 ^ if crc & 1 == 1 { POLYNOMIAL } else { 0 };
            bit += 1;
        }
        #[allow(clippy::indexing_slicing, reason = "evaluated by the compiler")]
        {
            table[nibble as usize] = crc;
        }
        nibble += 1;
    }
    table
};

/// CRC-32/ISO-HDLC of `bytes`: initial value and final inversion 0xFFFFFFFF, polynomial
/// 0x04C11DB7, reflected. "123456789" gives 0xCBF43926.
///
/// It detects every burst of up to 32 bits, and here, up to 91,607 bits long, every error of up to
/// 3 bits (the image is 6592).
#[must_use]
pub fn crc32(bytes: &[u8]) -> u32 {
    let step = |crc: u32| {
        let nibble = NIBBLES.get((crc & 0xF) as usize).copied();
        crc >> 4 ^ nibble.unwrap_or_default()
    };
    !bytes
        .iter()
        .fold(!0, |crc, &byte| step(step(crc ^ u32::from(byte))))
}

#[cfg(test)]
mod tests {
    use super::crc32;
    use proptest::prelude::*;

    fn bit_by_bit(bytes: &[u8]) -> u32 {
        let mut crc = !0_u32;
        for byte in bytes {
            crc ^= u32::from(*byte);
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

    #[test]
    fn the_catalogues_check_value_comes_out() {
        assert_eq!(crc32(b"123456789"), 0xCBF4_3926);
        assert_eq!(crc32(b""), 0);
    }

    proptest! {
        #[test]
        fn it_is_the_definition_for_any_bytes(
            bytes in prop::collection::vec(any::<u8>(), 0..=100)
        ) {
            prop_assert_eq!(crc32(&bytes), bit_by_bit(&bytes));
        }
    }
}

//! CRC-32/ISO-HDLC: the image's checksum.

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

/// The register while bytes go in.
#[derive(Clone, Copy, Debug)]
pub(super) struct Crc32(u32);

impl Crc32 {
    pub const fn new() -> Self {
        Self(!0)
    }

    #[allow(clippy::indexing_slicing, reason = "four bits index sixteen entries")]
    pub const fn update(&mut self, byte: u8) {
        let crc = self.0 ^ byte as u32;
        let crc = crc >> 4 ^ NIBBLES[(crc & 0xF) as usize];
        self.0 = crc >> 4 ^ NIBBLES[(crc & 0xF) as usize];
    }

    pub const fn finish(self) -> u32 {
        !self.0
    }
}

/// CRC-32/ISO-HDLC of `bytes` that follow those of the checksum `before`, 0 where none do: initial
/// value and final inversion 0xFFFFFFFF, polynomial 0x04C11DB7, reflected. "123456789" gives 0xCBF43926.
///
/// It detects every burst of up to 32 bits, and here, up to 91,607 bits long, every error of up to
/// 3 bits (the protected bytes are 1856).
pub fn crc32(before: u32, bytes: &[u8]) -> u32 {
    let mut crc = Crc32(!before);
    for &byte in bytes {
        crc.update(byte);
    }
    crc.finish()
}

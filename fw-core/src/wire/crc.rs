//! CRC: CRC-16/IBM-3740 over every byte before it, big-endian.
//!
//! Initial value 0xFFFF, polynomial 0x1021, not reflected, no final inversion. Up to 32 bytes it
//! detects every error of up to 3 bits and every burst of up to 16.

use super::error::{FieldError, Reason};
use super::strategy::{Context, FrameReader, FrameWriter, Parsed, Strategy};
use super::{Command, Report};

/// Sends and checks the checksum.
#[derive(Debug)]
pub struct Crc;

/// CRC-16/IBM-3740 of `bytes`, without a table: 16 bytes at once, then eight, four, two and one at a
/// time.
///
/// Squared again and again, x¹⁶ = x¹² + x⁵ + 1 gives x⁶⁴ = x⁴⁸ + x²⁰ + 1 and x¹²⁸ = x⁹⁶ + x⁴⁰ + 1: a
/// word goes into the ones 64 or 128 bits behind it by shifts.
// Requirement: WIRE-crc-1
#[inline(never)]
pub fn crc16(bytes: &[u8]) -> u16 {
    let mut crc = 0xFFFF;
    let mut rest = bytes;
    if let Some((first, after)) = rest.split_first_chunk::<16>() {
        let (front, back) = first.split_at(8);
        let ((mut a, mut b), (mut c, mut d)) = (words(front), words(back));
        // The initial value is the same as the first 16 bits inverted.
        a ^= 0xFFFF_0000;
        rest = after;
        while let Some((next, after)) = rest.split_first_chunk::<8>() {
            let (high, low) = words(next);
            (b, c, d) = (b ^ a, c ^ a >> 24, d ^ a << 8);
            (a, b, c, d) = (c ^ b, d ^ b >> 24, high ^ a ^ b << 8, low ^ b);
            rest = after;
        }
        // Of x⁴⁸ half stays in the word itself, once.
        a ^= a >> 16;
        b ^= a << 16 ^ a >> 12;
        b ^= b >> 16;
        c ^= (a ^ a << 20) ^ b << 16 ^ b >> 12;
        d ^= b ^ b << 20;
        crc = remainder(d ^ remainder(c) << 16);
        if rest.is_empty() {
            return (crc & 0xFFFF) as u16;
        }
    }
    while let Some((word, after)) = rest.split_first_chunk() {
        crc = remainder(crc << 16 ^ u32::from_be_bytes(*word));
        rest = after;
    }
    if let Some((pair, after)) = rest.split_first_chunk() {
        crc = remainder((crc ^ u32::from(u16::from_be_bytes(*pair))) & 0xFFFF);
        rest = after;
    }
    if let [last] = rest {
        // The eight bits that leave go through the quotient; the eight that stay move up.
        crc = remainder((crc >> 8 ^ u32::from(*last)) & 0xFF) ^ crc << 8;
    }
    (crc & 0xFFFF) as u16
}

/// The first eight bytes as two words.
#[inline(always)]
fn words(bytes: &[u8]) -> (u32, u32) {
    let both = u64::from_be_bytes(bytes.first_chunk().copied().unwrap_or_default());
    ((both >> 32) as u32, (both & 0xFFFF_FFFF) as u32)
}

/// The remainder of `word` · x¹⁶ divided by P, in the low 16 bits; the rest is of no meaning.
///
/// With y = x⁻¹, x¹⁶ / P = 1 / (1 + a), a = y⁴ + y¹¹ + y¹⁶, and over the 32 bits of a word
/// 1 / (1 + a) = (1 + a)(1 + a²)(1 + a⁴): the quotient is six shifted exclusive-ors, the remainder
/// the low 16 bits of the quotient times x¹² + x⁵ + 1.
#[inline(always)]
const fn remainder(word: u32) -> u32 {
    let quotient = word ^ word >> 16;
    let quotient = quotient ^ (quotient ^ quotient >> 14) >> 8;
    let quotient = quotient ^ (quotient ^ (quotient ^ quotient >> 5) >> 7) >> 4;
    quotient ^ (quotient ^ quotient << 7) << 5
}

// Requirement: WIRE-crc-2
#[inline(always)]
fn parse(reader: &mut FrameReader<'_>) -> Result<(), FieldError> {
    let expected = crc16(reader.taken());
    let found = u16::from_be_bytes(reader.take()?);
    if found == expected {
        Ok(())
    } else {
        Err(reader.error(2, Reason::Crc { expected, found }))
    }
}

#[inline(always)]
fn write(writer: &mut FrameWriter<'_>) {
    writer.put(crc16(writer.written()).to_be_bytes());
}

impl Strategy for Crc {
    const NAME: &'static str = "crc";
    const LEN: usize = 2;

    #[inline(always)]
    fn parse_command(reader: &mut FrameReader<'_>, _: &Context, _command: &mut Command) -> Parsed {
        parse(reader)
    }

    #[inline(always)]
    fn write_command(writer: &mut FrameWriter<'_>, _context: &Context, _command: &Command) {
        write(writer);
    }

    #[inline(always)]
    fn parse_report(reader: &mut FrameReader<'_>, _: &Context, _report: &mut Report) -> Parsed {
        parse(reader)
    }

    #[inline(always)]
    fn write_report(writer: &mut FrameWriter<'_>, _context: &Context, _report: &Report) {
        write(writer);
    }
}

#[cfg(test)]
mod tests {
    use super::crc16;

    // Requirement: WIRE-crc-1
    #[test]
    fn crc_check_value_matches_catalogue() {
        assert_eq!(crc16(b"123456789"), 0x29B1);
        assert_eq!(crc16(b""), 0xFFFF);
    }
}

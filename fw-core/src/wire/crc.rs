//! CRC: CRC-16/IBM-3740 over every byte before it, big-endian.
//!
//! Initial value 0xFFFF, polynomial 0x1021, not reflected, no final inversion. Up to 26 bytes it
//! detects every error of up to 3 bits and every burst of up to 16.

#![allow(
    clippy::inline_always,
    reason = "one shifted exclusive-or after the other, not a call"
)]

use super::error::Reason;
use super::strategy::{Context, Duties, Fault, Input, Output};
use super::{Command, Report};

/// Sends and checks the checksum.
#[derive(Debug)]
pub struct Crc;

/// CRC-16/IBM-3740 of `bytes`, without a table, a word at a time.
// Once in flash: both directions call it, and a call is nothing beside what it does.
#[inline(never)]
#[must_use]
pub fn crc16(bytes: &[u8]) -> u16 {
    let mut crc = 0xFFFF_u32;
    let mut rest = bytes;
    while let Some((word, after)) = rest.split_first_chunk() {
        crc = remainder(u32::from_be_bytes(*word) ^ crc << 16);
        rest = after;
    }
    for &byte in rest {
        // The eight bits that leave go through the quotient; the eight that stay move up.
        crc = remainder((crc >> 8 ^ u32::from(byte)) & 0xFF) ^ crc << 8;
    }
    (crc & 0xFFFF) as u16
}

/// The remainder of `word` · x¹⁶ divided by P, in the low 16 bits; the rest is of no meaning.
///
/// With y = x⁻¹, x¹⁶ / P = 1 / (1 + a), a = y⁴ + y¹¹ + y¹⁶, and over the 32 bits of a word
/// 1 / (1 + a) = (1 + a)(1 + a²)(1 + a⁴): the quotient is six shifted exclusive-ors, the remainder
/// the low 16 bits of the quotient times x¹² + x⁵ + 1.
#[inline(always)]
const fn remainder(word: u32) -> u32 {
    let quotient = word ^ word >> 16;
    let quotient = quotient ^ quotient >> 8 ^ quotient >> 22;
    let quotient = quotient ^ quotient >> 4 ^ quotient >> 11 ^ quotient >> 16;
    quotient ^ quotient << 5 ^ quotient << 12
}

#[inline(always)]
fn parse(input: &mut Input<'_>) -> Result<(), Fault> {
    let before = *input;
    let found = u16::from_be_bytes(input.take()?);
    let expected = crc16(before.taken());
    if found == expected {
        Ok(())
    } else {
        Err(before.fault(Reason::Crc { expected, found }))
    }
}

#[inline(always)]
fn write(output: &mut Output<'_>) {
    output.put(crc16(output.written()).to_be_bytes());
}

impl Duties for Crc {
    const NAME: &'static str = "crc";
    const BYTES: usize = 2;

    #[inline(always)]
    fn parse_command(
        input: &mut Input<'_>,
        _context: &Context,
        _command: &mut Command,
    ) -> Result<(), Fault> {
        parse(input)
    }

    #[inline(always)]
    fn write_command(output: &mut Output<'_>, _context: &Context, _command: &Command) {
        write(output);
    }

    #[inline(always)]
    fn parse_report(
        input: &mut Input<'_>,
        _context: &Context,
        _report: &mut Report,
    ) -> Result<(), Fault> {
        parse(input)
    }

    #[inline(always)]
    fn write_report(output: &mut Output<'_>, _context: &Context, _report: &Report) {
        write(output);
    }
}

#[cfg(test)]
mod tests {
    use super::crc16;
    use proptest::prelude::*;

    /// The definition: one bit after the other.
    fn bit_by_bit(bytes: &[u8]) -> u16 {
        let mut crc = 0xFFFF_u16;
        for byte in bytes {
            crc ^= u16::from(*byte) << 8;
            for _ in 0..8 {
                let carry = crc & 0x8000 != 0;
                crc <<= 1;
                if carry {
                    crc ^= 0x1021;
                }
            }
        }
        crc
    }

    #[test]
    fn the_catalogues_check_value_comes_out() {
        assert_eq!(crc16(b"123456789"), 0x29B1);
        assert_eq!(crc16(b""), 0xFFFF);
    }

    #[test]
    fn it_is_the_definition_for_every_single_byte_at_every_place() {
        // Linear over exclusive-or: single bits at every place and the zeros decide every message.
        for len in 0..=60 {
            let mut message = [0; 60];
            let message = &mut message[..len];
            assert_eq!(crc16(message), bit_by_bit(message));
            for place in 0..len {
                for byte in 1..=255 {
                    message[place] = byte;
                    assert_eq!(crc16(message), bit_by_bit(message));
                }
                message[place] = 0;
            }
        }
    }

    proptest! {
        #[test]
        fn it_is_the_definition_for_any_bytes(
            bytes in prop::collection::vec(any::<u8>(), 0..=64)
        ) {
            prop_assert_eq!(crc16(&bytes), bit_by_bit(&bytes));
        }
    }
}

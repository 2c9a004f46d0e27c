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

/// CRC-16/IBM-3740 of `bytes`, without a table.
// Requirement: WIRE-crc-1
#[inline]
#[must_use]
pub fn crc16(bytes: &[u8]) -> u16 {
    if let Ok(bytes) = bytes.try_into() {
        return of_24(bytes);
    }
    of_any(bytes)
}

/// Of what a Guarded Normal frame has before its checksum: all at once.
///
/// Squared again and again, x¹⁶ = x¹² + x⁵ + 1 gives x⁶⁴ = x⁴⁸ + x²⁰ + 1 and x¹²⁸ = x⁹⁶ + x⁴⁰ + 1: a
/// word goes into the ones 64 or 128 bits behind it, by shifts that cost an exclusive-or nothing.
// Once in flash, like the other: both directions call it, and a call is nothing beside what it does.
#[inline(never)]
#[must_use]
fn of_24(bytes: &[u8; 24]) -> u16 {
    let word = |at: usize| {
        let rest = bytes.get(at..).unwrap_or_default();
        u32::from_be_bytes(rest.first_chunk().copied().unwrap_or_default())
    };
    // The initial value is the same as the first 16 bits inverted.
    let first = word(0) ^ 0xFFFF_0000;
    let second = word(4) ^ first;
    let third = word(8) ^ first >> 24 ^ second;
    let fourth = word(12) ^ first << 8 ^ second >> 24;
    let fifth = word(16) ^ first ^ second << 8;
    let sixth = word(20) ^ second;
    // Of x⁴⁸ half stays in the word itself, once.
    let third = third ^ third >> 16;
    let fourth = fourth ^ third << 16 ^ third >> 12;
    let fifth = fifth ^ third << 20 ^ third;
    let fourth = fourth ^ fourth >> 16;
    let fifth = fifth ^ fourth << 16 ^ fourth >> 12;
    let sixth = sixth ^ fourth << 20 ^ fourth;
    (remainder(sixth ^ remainder(fifth) << 16) & 0xFFFF) as u16
}

/// Of any bytes, a word at a time.
#[inline(never)]
#[must_use]
fn of_any(bytes: &[u8]) -> u16 {
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

// Requirement: WIRE-crc-2
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
    use super::{crc16, of_24};
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

    // Requirement: WIRE-crc-1
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

    #[test]
    fn all_at_once_it_is_the_definition_too() {
        // Affine over exclusive-or: every byte at every place and the zeros decide every message.
        let mut message = [0; 24];
        assert_eq!(of_24(&message), bit_by_bit(&message));
        for place in 0..24 {
            for byte in 1..=255 {
                message[place] = byte;
                assert_eq!(of_24(&message), bit_by_bit(&message));
            }
            message[place] = 0;
        }
    }

    proptest! {
        #[test]
        fn all_at_once_it_is_the_definition_for_any_bytes(bytes in any::<[u8; 24]>()) {
            prop_assert_eq!(of_24(&bytes), bit_by_bit(&bytes));
        }

        #[test]
        fn it_is_the_definition_for_any_bytes(
            bytes in prop::collection::vec(any::<u8>(), 0..=64)
        ) {
            prop_assert_eq!(crc16(&bytes), bit_by_bit(&bytes));
        }
    }
}

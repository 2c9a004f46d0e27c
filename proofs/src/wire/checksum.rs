//! T1: the guarded frames' CRC-16, and the errors it is there to catch.

use fw_core::wire::crc::crc16;
use fw_core::wire::strategy::Context;
use fw_core::wire::{Command, Report, Setup};
use fw_core::wire::{MAX_FRAME, Mode, parse_command, parse_report, write_command, write_report};

use super::table::{Frame, table};
use crate::property::Seen;

/// CRC-16/IBM-3740 as the catalogue defines it, bit by bit: initial value 0xFFFF, polynomial
/// 0x1021, not reflected, no final exclusive-or.
fn reference(bytes: &[u8]) -> u16 {
    let mut crc = 0xFFFF;
    for &byte in bytes {
        crc ^= u16::from(byte) << 8;
        for _ in 0..8 {
            let carry = crc >> 15 == 1;
            crc <<= 1;
            if carry {
                crc ^= 0x1021;
            }
        }
    }
    crc
}

/// One word of the core's checksum is four bytes of the catalogue's.
pub fn checksum_of_a_word_is_the_catalogues(bytes: [u8; 4]) -> Seen {
    let crc = crc16(&bytes);
    assert!(crc == reference(&bytes));
    seen!(crc >> 8 == 0, crc >> 8 == 0xFF)
}

/// One or two bytes of the core's checksum are one or two of the catalogue's.
pub fn checksum_of_a_rest_is_the_catalogues(bytes: [u8; 2], two: bool) -> Seen {
    let bytes = if two { &bytes[..] } else { &bytes[..1] };
    assert!(crc16(bytes) == reference(bytes));
    Seen::NOTHING.case(0, two).case(1, !two)
}

/// The core's checksum is the catalogue's over any bytes a frame can have. Both are affine over
/// exclusive-or, so the zeros and every single bit of every length decide all of them.
// Requirement: WIRE-crc-1
pub fn checksum_is_the_catalogues(bytes: Frame, len: u8) -> Seen {
    let len = usize::from(len);
    given!(let Some(bytes) = bytes.get(..len));
    assert!(crc16(bytes) == reference(bytes));
    Seen::NOTHING.case(0, len == 0).case(1, len == MAX_FRAME)
}

/// Exclusive-or of what goes in is exclusive-or of what comes out, up to a constant: whether an error
/// is caught does not depend on the frame it hits. Of every length that leaves as much as `rest` when divided
/// by 4.
pub fn checksum_is_affine(one: Frame, other: Frame, rest: u8) -> Seen {
    let mut both = one;
    for (byte, change) in both.iter_mut().zip(other) {
        *byte ^= change;
    }
    let (mut len, mut differs) = (usize::from(rest % 4), false);
    while len <= MAX_FRAME {
        let [both, one, other, zeros] =
            [&both, &one, &other, &[0; MAX_FRAME]].map(|all| crc16(&all[..len]));
        assert!(both == one ^ other ^ zeros);
        differs |= both != one;
        len += 4;
    }
    seen!(differs)
}

/// Bits `start` to `start` + 15 of a frame, bit 0 the first on the wire, flipped where `pattern`
/// has a one; nothing where that leaves the frame.
fn flip(frame: &mut [u8], start: usize, pattern: u16) -> Option<()> {
    let last = start + 15 - pattern.trailing_zeros() as usize;
    if last >= frame.len() * 8 {
        return None;
    }
    let shifted = (u32::from(pattern) << 8) >> (start % 8);
    for (place, change) in shifted.to_be_bytes().into_iter().skip(1).enumerate() {
        if let Some(byte) = frame.get_mut(start / 8 + place) {
            *byte ^= change;
        }
    }
    Some(())
}

/// What both ends know in these properties: neither key is the other's shifted.
const CONTEXT: Context = Context {
    cells: 8,
    own: 0x35,
    ..Setup::first_board(Mode::Normal).context()
};

/// A guarded frame hit by one burst of at most 16 bits is rejected, at either end, wherever it hits.
/// `pattern`'s highest bit is the burst's first.
// Requirement: WIRE-crc-1
pub fn burst_is_rejected(mode: Mode, start: u8, pattern: u16) -> Seen {
    let table = table(mode);
    given!(table.guarded && pattern >> 15 != 0);
    let start = usize::from(start);
    let mut frame = [0; MAX_FRAME];
    let len = write_command(mode, &CONTEXT, &Command::default(), &mut frame);
    given!(flip(&mut frame[..len], start, pattern).is_some());
    assert!(parse_command(mode, &CONTEXT, &frame[..len], 0).is_err());
    let len = write_report(mode, &CONTEXT, &Report::default(), &mut frame);
    assert!(parse_report(mode, &CONTEXT, &frame[..len], 0).is_ok());
    let _ = flip(&mut frame[..len], start, pattern);
    assert!(parse_report(mode, &CONTEXT, &frame[..len], 0).is_err());
    seen!(pattern == 0x8000, start / 8 >= len - 2, start < 8)
}

/// A guarded frame with up to three bits wrong, wherever they are, is rejected by its checksum.
// Requirement: WIRE-crc-1
pub fn three_wrong_bits_are_rejected(mode: Mode, one: u8, two: u8, three: u8) -> Seen {
    const FIRST: u16 = 0x8000;
    let table = table(mode);
    given!(table.guarded && one < two && two < three);
    // Errors only: by `checksum_is_affine` the frame they hit does not matter.
    let mut errors = [0; MAX_FRAME];
    let (errors, zeros) = (&mut errors[..table.len], [0; MAX_FRAME]);
    for bit in [one, two, three] {
        given!(flip(errors, bit.into(), FIRST).is_some());
    }
    let (body, field) = errors.split_at(table.len - 2);
    let change = crc16(body) ^ crc16(&zeros[..table.len - 2]);
    assert!(change.to_be_bytes() != [field[0], field[1]]);
    Seen::NOTHING
        .case(0, field == [0, 0])
        .case(1, field != [0, 0])
}

/// Every basis vector of every length.
#[cfg(test)]
fn basis() -> impl Iterator<Item = (Frame, u8)> {
    (0..=32).flat_map(|len| {
        (0..=256_usize).map(move |bit| {
            let mut frame = [0; MAX_FRAME];
            if let Some(byte) = frame.get_mut(bit / 8) {
                *byte = 1 << (bit % 8);
            }
            (frame, len)
        })
    })
}

#[cfg(test)]
fn bursts() -> impl Iterator<Item = (Mode, u8, u16)> {
    Mode::ALL.iter().flat_map(|&mode| {
        (0..=255).flat_map(move |start| (0x8000..=u16::MAX).map(move |p| (mode, start, p)))
    })
}

#[cfg(test)]
fn triples() -> impl Iterator<Item = (Mode, u8, u8, u8)> {
    Mode::ALL.iter().flat_map(|&mode| {
        let bits = u8::try_from(table(mode).len * 8 - 1).unwrap_or(u8::MAX);
        (0..=bits).flat_map(move |one| {
            (one..=bits).flat_map(move |two| (two..=bits).map(move |three| (mode, one, two, three)))
        })
    })
}

crate::properties! {
    theorem T1 checksum_of_a_word_is_the_catalogues(bytes: [u8; 4]) {
        cases ["a low one", "a high one"];
        kani proof [unwind(9)];
        sampled 100_000;
    }
    theorem T1 checksum_of_a_rest_is_the_catalogues(bytes: [u8; 2], two: bool) {
        cases ["two bytes", "one byte"];
        kani proof [unwind(9)];
        exhaustive (0..=u16::MAX).flat_map(|bytes| {
            [false, true].map(|two| (bytes.to_be_bytes(), two))
        });
    }
    theorem T1 checksum_is_the_catalogues(bytes: Frame, len: u8) {
        cases ["no byte", "every byte"];
        needs [checksum_is_affine];
        exhaustive basis();
        sampled 100_000;
    }
    theorem T1 checksum_is_affine(one: Frame, other: Frame, rest: u8) {
        cases ["another checksum"];
        kani rest_0 [unwind(40)] = (any(), any(), 0);
        kani rest_1 [unwind(40)] = (any(), any(), 1);
        kani rest_2 [unwind(40)] = (any(), any(), 2);
        kani rest_3 [unwind(40)] = (any(), any(), 3);
        sampled 50_000;
    }
    theorem T1 burst_is_rejected(mode: Mode, start: u8, pattern: u16) {
        cases ["a single bit", "in the checksum", "in the key"];
        needs [checksum_is_affine];
        exhaustive bursts();
    }
    theorem T1 three_wrong_bits_are_rejected(mode: Mode, one: u8, two: u8, three: u8) {
        cases ["outside the checksum", "in the checksum"];
        needs [checksum_is_affine];
        exhaustive triples();
    }
}

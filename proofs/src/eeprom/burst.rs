//! T3: a burst of wrong bits and the checksum.

use fw_core::eeprom::{CRC_ADDRESS, IMAGE_LEN, Image, SPANS};

use crate::property::Seen;

/// The difference between the checksum and the stored one that a wrong bit makes. Both are affine in the
/// image: several wrong bits make the exclusive-or of their differences, whatever the image holds.
fn difference(bit: usize) -> u32 {
    let mut image = Image([0; IMAGE_LEN]);
    let of = |image: &Image| image.checksum() ^ image.stored_checksum();
    let before = of(&image);
    image.0[bit / 8] = 1 << (bit % 8);
    before ^ of(&image)
}

/// Wrong bits among 32 in a row never hide each other from the checksum: the differences that the defined
/// ones make are linearly independent.
// Requirement: WIRE-eeprom-2
pub fn bits_of_a_burst_are_independent(start: u16) -> Seen {
    let start = usize::from(start);
    let is_defined = |bit: &usize| {
        let spans = SPANS.iter();
        let mut bits = spans.map(|span| span.address..span.address + span.len);
        bits.any(|span| span.contains(&(*bit as u16 / 8)))
    };
    let bits = (start..IMAGE_LEN * 8).take(32).filter(is_defined);
    // Each with another highest bit.
    let mut basis = [0_u32; 32];
    let mut count = 0;
    for bit in bits {
        let mut rest = difference(bit);
        while let Some(top) = rest.checked_ilog2() {
            let known = &mut basis[top as usize];
            if *known == 0 {
                *known = rest;
                break;
            }
            rest ^= *known;
        }
        assert!(rest != 0);
        count += 1;
    }
    Seen::NOTHING
        .case(0, count == 32)
        .case(1, count == 0)
        .case(2, start / 8 == usize::from(CRC_ADDRESS) - 2)
}

crate::properties! {
    theorem T3 bits_of_a_burst_are_independent(start: u16) {
        cases ["all defined", "none defined", "across the start of the checksum"];
        exhaustive (0..8 * 0x400).map(|start| (start,));
    }
}

//! The instructions of two halfwords, ARM DDI 0403E.e, A5.3.

#![allow(
    clippy::match_same_arms,
    clippy::verbose_bit_mask,
    clippy::manual_range_patterns,
    reason = "the arms follow the manual's tables"
)]

use super::thumb::{data_base, field, pop, push, relative, signed, writes, What, PC, SP};

const NOTHING: What = What::Plain { writes: 0 };

/// What the wide instruction at `address` does.
pub fn decode(address: u32, first: u16, second: u16) -> What {
    match (first >> 11 & 3, first >> 4 & 0x7F) {
        (0b01, op) if op & 0b110_0100 == 0 => multiple(first, second),
        (0b01, op) if op & 0b110_0100 == 0b100 => dual(first, second),
        (0b01, op) if op & 0b110_0000 == 0b010_0000 => shifted(first, second),
        (0b10, _) if second >> 15 == 1 => control(address, first, second),
        (0b10, op) if op & 0b010_0000 == 0 => immediate(first, second),
        (0b10, _) => plain_immediate(address, first, second),
        (0b11, op) if op & 0b111_0001 == 0 => store(first, second),
        (0b11, op) if op & 0b110_0001 == 1 => load(address, first, second),
        // Register, multiply, long multiply and divide: A5.3.12, A5.3.16, A5.3.17.
        (0b11, op) if op & 0b111_0000 == 0b010_0000 || op & 0b111_1000 == 0b011_0000 => {
            writes(field(second, 8, 4))
        }
        (0b11, op) if op & 0b111_1000 == 0b011_1000 => long(first, second),
        (0b01 | 0b11, op) if op & 0b100_0000 != 0 => coprocessor(first, second),
        _ => What::Unknown,
    }
}

/// LDM and STM, A5.3.5.
fn multiple(first: u16, second: u16) -> What {
    let (rn, load, back) = (field(first, 0, 4), first >> 4 & 1 == 1, first >> 5 & 1 == 1);
    match (first >> 7 & 3, load) {
        (0b01, true) if rn == SP && back => pop(second),
        (0b10, false) if rn == SP && back => push(second),
        // Any other way of moving the stack pointer up or down is none that a compiler uses.
        (0b01 | 0b10, _) if rn == SP && back => What::Unknown,
        (0b01 | 0b10, _) => What::Plain {
            writes: if load { second } else { 0 } | u16::from(back) << rn,
        },
        _ => What::Unknown,
    }
}

/// Doubles, exclusives and table branches, A5.3.6.
fn dual(first: u16, second: u16) -> What {
    let (rn, load) = (field(first, 0, 4), first >> 4 & 1 == 1);
    let (rt, rt2) = (field(second, 12, 4), field(second, 8, 4));
    let (before, up, back) = (
        first >> 8 & 1 == 1,
        first >> 7 & 1 == 1,
        first >> 5 & 1 == 1,
    );
    if before || back {
        let both = 1 << rt | 1 << rt2;
        let offset = 4 * i32::from(second & 0xFF);
        return match (rn == SP && back, load) {
            (true, false) if before && !up => What::Push {
                list: in_order(rt, rt2, both),
                bytes: offset.unsigned_abs(),
            },
            (true, true) if !before && up => What::Pop {
                list: in_order(rt, rt2, both),
                bytes: offset.unsigned_abs(),
            },
            (true, _) => What::Unknown,
            (false, true) => What::Plain {
                writes: both | u16::from(back) << rn,
            },
            (false, false) => What::Plain {
                writes: u16::from(back) << rn,
            },
        };
    }
    match (first >> 7 & 1, load, second >> 4 & 0xF) {
        // STREX, LDREX.
        (0, false, _) => writes(rt2),
        (0, true, _) => writes(rt),
        (_, true, 0b0000 | 0b0001) => What::Table {
            rn,
            halfwords: second >> 4 & 1 == 1,
        },
        (_, false, 0b0100 | 0b0101) => writes(field(second, 0, 4)),
        (_, true, 0b0100 | 0b0101) => writes(rt),
        _ => What::Unknown,
    }
}

/// A pair is kept as a list only where the list's order is the pair's; otherwise what it saves is
/// forgotten.
const fn in_order(rt: u8, rt2: u8, both: u16) -> u16 {
    if rt < rt2 {
        both
    } else {
        0
    }
}

/// Data processing with a shifted register, A5.3.11.
fn shifted(first: u16, second: u16) -> What {
    let rd = field(second, 8, 4);
    let plain = second & 0x70F0 == 0;
    match first >> 5 & 0xF {
        // TST, TEQ, CMN, CMP.
        0b0000 | 0b0100 | 0b1000 | 0b1101 if rd == PC && first >> 4 & 1 == 1 => What::Compare,
        // MOV without a shift.
        0b0010 if field(first, 0, 4) == PC && plain => What::Move {
            rd,
            rm: field(second, 0, 4),
        },
        // ADD without a shift.
        0b1000 if plain => What::Sum {
            rd,
            rn: field(first, 0, 4),
            rm: field(second, 0, 4),
        },
        // ADD, shifted left by two.
        0b1000 if second & 0x70F0 == 0x0080 => What::Row {
            rd,
            rn: field(first, 0, 4),
            rm: field(second, 0, 4),
        },
        _ => writes(rd),
    }
}

/// The constant of a modified immediate, A5.3.2.
fn expanded(first: u16, second: u16) -> u32 {
    let code = u32::from(first >> 10 & 1) << 11
        | u32::from(second >> 12 & 7) << 8
        | u32::from(second & 0xFF);
    let byte = code & 0xFF;
    match code >> 8 {
        0 => byte,
        1 => byte * 0x0001_0001,
        2 => byte * 0x0100_0100,
        3 => byte * 0x0101_0101,
        _ => (0x80 | code & 0x7F).rotate_right(code >> 7),
    }
}

/// Data processing with a modified immediate, A5.3.1.
fn immediate(first: u16, second: u16) -> What {
    let (rn, rd) = (field(first, 0, 4), field(second, 8, 4));
    let value = expanded(first, second);
    match first >> 5 & 0xF {
        0b1101 if rd == PC && first >> 4 & 1 == 1 => What::CompareWord { rn, word: value },
        0b0000 | 0b0100 | 0b1000 if rd == PC && first >> 4 & 1 == 1 => What::Compare,
        0b0010 if rn == PC => What::Constant { rd, value },
        0b0011 if rn == PC => What::Constant { rd, value: !value },
        0b1000 => add(rd, rn, value.cast_signed()),
        0b1101 => add(rd, rn, value.cast_signed().wrapping_neg()),
        _ => writes(rd),
    }
}

const fn add(rd: u8, rn: u8, offset: i32) -> What {
    What::Add { rd, rn, offset }
}

/// Data processing with a plain immediate, A5.3.3.
fn plain_immediate(address: u32, first: u16, second: u16) -> What {
    let (rn, rd) = (field(first, 0, 4), field(second, 8, 4));
    let twelve = u32::from(first >> 10 & 1) << 11
        | u32::from(second >> 12 & 7) << 8
        | u32::from(second & 0xFF);
    let offset = signed(twelve, 13);
    let sixteen = u32::from(first & 0xF) << 12 | twelve;
    match first >> 4 & 0x1F {
        // ADR.
        0b00000 if rn == PC => What::Constant {
            rd,
            value: data_base(address).wrapping_add(twelve),
        },
        0b01010 if rn == PC => What::Constant {
            rd,
            value: data_base(address).wrapping_sub(twelve),
        },
        0b00000 => add(rd, rn, offset),
        0b01010 => add(rd, rn, -offset),
        0b00100 => What::Constant { rd, value: sixteen },
        0b01100 => What::Top {
            rd,
            half: u16::try_from(sixteen).unwrap_or_default(),
        },
        // Saturation and bit fields.
        0b10000 | 0b10010 | 0b10100 | 0b10110 | 0b11000 | 0b11010 | 0b11100 => writes(rd),
        _ => What::Unknown,
    }
}

/// Branches and what controls the processor, A5.3.4.
fn control(address: u32, first: u16, second: u16) -> What {
    let sign = u32::from(first >> 10 & 1);
    let (j1, j2) = (u32::from(second >> 13 & 1), u32::from(second >> 11 & 1));
    let low = u32::from(second & 0x7FF) << 1;
    // B T4 and BL, A7.7.12 and A7.7.18.
    let far = || {
        let high = u32::from(first & 0x3FF) << 12;
        let offset = sign << 24 | (j1 ^ sign ^ 1) << 23 | (j2 ^ sign ^ 1) << 22 | high | low;
        relative(address, signed(offset, 25))
    };
    match second >> 12 & 0b101 {
        0b001 => What::Jump { to: far() },
        0b101 => What::Call { to: far() },
        0b000 if first >> 7 & 7 != 7 => {
            let high = u32::from(first & 0x3F) << 12;
            let offset = sign << 20 | j2 << 19 | j1 << 18 | high | low;
            What::Branch {
                to: relative(address, signed(offset, 21)),
                on: Some(field(first, 6, 4)),
            }
        }
        0b000 => system(first, second),
        _ => What::Unknown,
    }
}

fn system(first: u16, second: u16) -> What {
    /// MSR's number of the main stack pointer, of the process stack pointer and of CONTROL,
    /// which chooses between the two, B5.1.1.
    const MSP: u16 = 8;
    const PSP: u16 = 9;
    const CONTROL: u16 = 20;
    match first >> 4 & 0x7F {
        0b011_1000 | 0b011_1001 => match second & 0xFF {
            MSP => What::NewStack {
                rn: field(first, 0, 4),
            },
            PSP | CONTROL => What::Unknown,
            _ => NOTHING,
        },
        // Hints; CLREX, DSB, DMB, ISB.
        0b011_1010 if second & 0x07FF < 5 => NOTHING,
        0b011_1011 => NOTHING,
        0b011_1110 | 0b011_1111 => writes(field(second, 8, 4)),
        0b111_1111 if second >> 12 & 7 == 0b010 => What::Trap,
        _ => What::Unknown,
    }
}

/// How a single load or store finds its address, A5.3.7 and A5.3.10.
enum Address {
    At(i32),
    /// The base moves by this; the access is before or after.
    Moving {
        by: i32,
        before: bool,
    },
    Register,
    None,
}

fn address(first: u16, second: u16) -> Address {
    if first >> 7 & 1 == 1 {
        return Address::At(i32::from(second & 0xFFF));
    }
    let byte = i32::from(second & 0xFF);
    let by = if second >> 9 & 1 == 1 { byte } else { -byte };
    match (second >> 11 & 1, second >> 10 & 1, second >> 8 & 1) {
        (0, ..) if second >> 6 & 0x1F == 0 => Address::Register,
        (1, 1, 0) => Address::At(by),
        (1, before, 1) => Address::Moving {
            by,
            before: before == 1,
        },
        _ => Address::None,
    }
}

fn store(first: u16, second: u16) -> What {
    let (rn, rt) = (field(first, 0, 4), field(second, 12, 4));
    let bytes = match first >> 5 & 3 {
        0b00 => 1,
        0b01 => 2,
        0b10 => 4,
        _ => return What::Unknown,
    };
    match address(first, second) {
        Address::At(offset) => What::Store {
            rt,
            rn,
            offset,
            bytes,
        },
        Address::Moving { by, before: true } if rn == SP && by < 0 && bytes == 4 => What::Push {
            list: 1 << rt,
            bytes: by.unsigned_abs(),
        },
        Address::Moving { .. } => writes(rn),
        Address::Register => NOTHING,
        Address::None => What::Unknown,
    }
}

fn load(place: u32, first: u16, second: u16) -> What {
    let (rn, rt) = (field(first, 0, 4), field(second, 12, 4));
    let word = first >> 5 & 3 == 0b10;
    if first >> 5 & 3 == 0b11 {
        return What::Unknown;
    }
    if rn == PC {
        let offset = signed(u32::from(second & 0xFFF), 13);
        let offset = if first >> 7 & 1 == 1 { offset } else { -offset };
        return match (word, rt) {
            (true, _) => What::Literal {
                rt,
                address: data_base(place).wrapping_add_signed(offset),
            },
            // Memory hints, A5.3.8 and A5.3.9.
            (false, PC) => NOTHING,
            (false, _) => writes(rt),
        };
    }
    match address(first, second) {
        Address::Moving { .. } if rt == PC && !word => What::Unknown,
        _ if rt == PC && !word => NOTHING,
        Address::At(offset) if word => What::Load { rt, rn, offset },
        Address::At(_) | Address::Register => writes(rt),
        Address::Moving { by, before: false } if rn == SP && by > 0 && word => What::Pop {
            list: 1 << rt,
            bytes: by.unsigned_abs(),
        },
        Address::Moving { .. } => What::Plain {
            writes: 1 << rt | 1 << rn,
        },
        Address::None => What::Unknown,
    }
}

/// Long multiplies write two registers, divisions one, A5.3.17.
fn long(first: u16, second: u16) -> What {
    let (high, low) = (field(second, 8, 4), field(second, 12, 4));
    match first >> 4 & 7 {
        0b001 | 0b011 => writes(high),
        _ => What::Plain {
            writes: 1 << high | 1 << low,
        },
    }
}

/// The floating-point unit, A5.3.18 and A6: coprocessors 10 and 11, and no other is there.
fn coprocessor(first: u16, second: u16) -> What {
    if second >> 9 & 7 != 0b101 || first >> 12 & 1 == 1 {
        return What::Unknown;
    }
    let (rn, load, back) = (field(first, 0, 4), first >> 4 & 1 == 1, first >> 5 & 1 == 1);
    let rt = field(second, 12, 4);
    if first >> 9 & 1 == 1 {
        // Arithmetic, and single transfers to and from the core, A6.4 and A6.6. VMRS to r15 are the
        // flags.
        let to_core = second >> 4 & 1 == 1 && load && rt != PC;
        return What::Float {
            writes: u16::from(to_core) << rt,
        };
    }
    // A6.5 and A6.7.
    match (first >> 7 & 3, back) {
        (0b00, false) => What::Float {
            writes: if load { 1 << rt | 1 << rn } else { 0 },
        },
        // VPUSH and VPOP: the immediate is in words.
        (0b10, true) if rn == SP && !load => What::Push {
            list: 0,
            bytes: 4 * u32::from(second & 0xFF),
        },
        (0b01, true) if rn == SP && load => What::Pop {
            list: 0,
            bytes: 4 * u32::from(second & 0xFF),
        },
        (0b01 | 0b10 | 0b11, false) => What::Float { writes: 0 },
        (0b01 | 0b10, true) => What::Float { writes: 1 << rn },
        _ => What::Unknown,
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn immediates_expand_as_the_manual_says() {
        // mov.w r0, #0x00AB00AB; #0xAB00AB00; #0xABABABAB; #0xAB000000; #0x1FC; #0x7F800000.
        for (first, second, value) in [
            (0xF04F, 0x10AB, 0x00AB_00AB),
            (0xF04F, 0x20AB, 0xAB00_AB00),
            (0xF04F, 0x30AB, 0xABAB_ABAB),
            (0xF04F, 0x402B, 0xAB00_0000),
            (0xF44F, 0x70FE, 0x1FC),
            (0xF04F, 0x40FF, 0x7F80_0000),
        ] {
            assert_eq!(
                decode(0, first, second),
                What::Constant { rd: 0, value },
                "{first:04x} {second:04x}"
            );
        }
    }
}

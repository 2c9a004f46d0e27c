//! What a Thumb instruction does to the stack, to the flow and to the registers (ARM DDI 0403E.e,
//! chapters A5 and A7): as much as it takes to follow a compiled function.
//!
//! Whatever could move the stack pointer and is none of the forms below is [`What::Unknown`]: the
//! analysis fails on it instead of missing a frame.

#![allow(
    clippy::match_same_arms,
    clippy::verbose_bit_mask,
    clippy::manual_range_patterns,
    reason = "the arms follow the manual's tables"
)]

use super::wide;

/// The stack pointer's number.
pub const SP: u8 = 13;
/// The link register's number.
pub const LR: u8 = 14;
/// The program counter's number.
pub const PC: u8 = 15;

/// Registers as bits, bit 0 = r0.
pub type Registers = u16;

/// One decoded instruction.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct Instruction {
    /// Bytes: 2 or 4.
    pub length: u32,
    /// What it does.
    pub what: What,
}

/// What an instruction does, as far as it matters here.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum What {
    /// Leaves unknown values in these registers and goes on.
    Plain { writes: Registers },
    /// Sets nothing but flags: inside an IT block it may change the condition.
    Compare,
    /// As `Compare`, of a register with a constant.
    CompareWord { rn: u8, word: u32 },
    /// `rd = value`.
    Constant { rd: u8, value: u32 },
    /// `movt`: the upper half of `rd`.
    Top { rd: u8, half: u16 },
    /// `rd = rm`.
    Move { rd: u8, rm: u8 },
    /// `rd = rn + offset`; either may be the stack pointer.
    Add { rd: u8, rn: u8, offset: i32 },
    /// `rd = rn + rm`; the first two may be the stack pointer.
    Sum { rd: u8, rn: u8, rm: u8 },
    /// `rd = rn + 4 · rm`: a row of a table of words or of wide branches.
    Row { rd: u8, rn: u8, rm: u8 },
    /// `rt = [address]`, a word of the literal pool.
    Literal { rt: u8, address: u32 },
    /// `rt = [rn + offset]`, a word.
    Load { rt: u8, rn: u8, offset: i32 },
    /// `[rn + offset] = rt`, so many bytes.
    Store {
        rt: u8,
        rn: u8,
        offset: i32,
        bytes: u8,
    },
    /// The stack pointer goes down by `bytes`; then `list` is stored from it upwards.
    Push { list: Registers, bytes: u32 },
    /// `list` is loaded from the stack pointer upwards; then that goes up by `bytes`.
    Pop { list: Registers, bytes: u32 },
    /// Writes the main stack pointer from a register, `msr msp`.
    NewStack { rn: u8 },
    /// Always goes to this address.
    Jump { to: u32 },
    /// Goes to this address or on; on which of the conditions 0 to 13 of A7.3 where it is one of
    /// them.
    Branch { to: u32, on: Option<u8> },
    /// Calls this address.
    Call { to: u32 },
    /// Goes where a register says; a return when that is the link register.
    JumpRegister { rm: u8 },
    /// Calls where a register says.
    CallRegister { rm: u8 },
    /// Goes forward by an entry of the table at `rn` (the PC: right behind), bytes or halfwords.
    Table { rn: u8, halfwords: bool },
    /// The next one to four instructions depend on a condition; see [`block`].
    If { mask: u8 },
    /// Ends here on purpose: `udf`.
    Trap,
    /// Uses the floating-point unit, leaves unknown values in these registers and goes on.
    Float { writes: Registers },
    /// Cannot be followed.
    Unknown,
}

/// For an [`What::If`]: how many instructions it covers, and of each whether it runs when the
/// condition holds (`true`) or when it does not. A7.3.1: the mask's lowest 1 ends the block, the bits
/// above it are compared to the first condition's lowest bit.
pub fn block(mask: u8) -> impl Iterator<Item = bool> {
    let first = mask >> 4 & 1;
    let length = 4 - (mask & 0xF).trailing_zeros();
    (0..length).map(move |nth| nth == 0 || mask >> (4 - nth) & 1 == first)
}

/// Decodes what stands at `address`; `second` counts for wide instructions alone.
pub fn decode(address: u32, first: u16, second: u16) -> Instruction {
    let (length, what) = if first >> 11 >= 0b11101 {
        (4, wide::decode(address, first, second))
    } else {
        (2, narrow(address, first))
    };
    Instruction {
        length,
        what: guarded(what),
    }
}

/// No form but those that are followed may touch the stack pointer, or load the program counter.
fn guarded(what: What) -> What {
    const SPECIAL: Registers = 1 << SP | 1 << PC;
    match what {
        What::Plain { writes } | What::Float { writes } if writes & SPECIAL != 0 => What::Unknown,
        What::Constant { rd, .. } | What::Top { rd, .. } if rd >= SP && rd != LR => What::Unknown,
        What::Literal { rt, .. } | What::Load { rt, .. } if rt == SP || rt == PC => What::Unknown,
        What::Move { rd: PC, .. } | What::Add { rd: PC, .. } | What::Sum { rd: PC, .. } => {
            What::Unknown
        }
        What::Row { rd, .. } if rd == SP || rd == PC => What::Unknown,
        What::Pop { list, .. } if list & 1 << SP != 0 => What::Unknown,
        other => other,
    }
}

/// `bits` bits of `halfword` from bit `from` on, as a register's number.
pub fn field(halfword: u16, from: u32, bits: u32) -> u8 {
    u8::try_from(halfword >> from & ((1 << bits) - 1)).unwrap_or(u8::MAX)
}

/// Nothing but this register is written.
pub const fn writes(register: u8) -> What {
    What::Plain {
        writes: 1 << register,
    }
}

/// `value`'s lowest `bits` bits as a signed number.
pub const fn signed(value: u32, bits: u32) -> i32 {
    let shift = 32 - bits;
    (value << shift).cast_signed() >> shift
}

/// Where a jump at `address` goes: the PC reads 4 ahead.
pub const fn relative(address: u32, offset: i32) -> u32 {
    address.wrapping_add(4).wrapping_add_signed(offset)
}

/// The base of PC-relative data: the PC reads 4 ahead, and is aligned down.
pub const fn data_base(address: u32) -> u32 {
    address.wrapping_add(4) & !3
}

/// The instructions of one halfword, A5.2.
fn narrow(address: u32, word: u16) -> What {
    let low = field(word, 0, 3);
    let byte = u32::from(word & 0xFF);
    match word >> 11 {
        // LSL #0 is MOV, A7.7.77 T2.
        0b00000 if word >> 6 & 0x1F == 0 => What::Move {
            rd: low,
            rm: field(word, 3, 3),
        },
        0b00000..=0b00010 => writes(low),
        0b00011 => add_or_subtract(word),
        0b00100 => What::Constant {
            rd: field(word, 8, 3),
            value: byte,
        },
        0b00101 => What::CompareWord {
            rn: field(word, 8, 3),
            word: byte,
        },
        0b00110 | 0b00111 => {
            let rd = field(word, 8, 3);
            let down = word >> 11 & 1 == 1;
            let offset = signed(byte, 9);
            What::Add {
                rd,
                rn: rd,
                offset: if down { -offset } else { offset },
            }
        }
        // TST, CMP, CMN write nothing, A5.2.2.
        0b01000 if word >> 10 & 1 == 0 => match word >> 6 & 0xF {
            0b1000 | 0b1010 | 0b1011 => What::Compare,
            _ => writes(low),
        },
        0b01000 => special(word),
        0b01001 => What::Literal {
            rt: field(word, 8, 3),
            address: data_base(address) + 4 * byte,
        },
        0b01010 | 0b01011 => match word >> 9 & 7 {
            0..=2 => writes_nothing(),
            _ => writes(low),
        },
        0b01100 => store(low, field(word, 3, 3), 4 * imm5(word), 4),
        0b01101 => load(low, field(word, 3, 3), 4 * imm5(word)),
        0b01110 => store(low, field(word, 3, 3), imm5(word), 1),
        0b10000 => store(low, field(word, 3, 3), 2 * imm5(word), 2),
        0b01111 | 0b10001 => writes(low),
        0b10010 => store(field(word, 8, 3), SP, 4 * signed(byte, 9), 4),
        0b10011 => load(field(word, 8, 3), SP, 4 * signed(byte, 9)),
        0b10100 => What::Constant {
            rd: field(word, 8, 3),
            value: data_base(address) + 4 * byte,
        },
        0b10101 => What::Add {
            rd: field(word, 8, 3),
            rn: SP,
            offset: 4 * signed(byte, 9),
        },
        0b10110 | 0b10111 => miscellaneous(address, word),
        0b11000 => writes(field(word, 8, 3)),
        // The base is loaded or moved on: written either way.
        0b11001 => What::Plain {
            writes: word & 0xFF | 1 << field(word, 8, 3),
        },
        0b11010 | 0b11011 => match word >> 8 & 0xF {
            0xE => What::Trap,
            // SVC raises an exception that nobody here expects.
            0xF => What::Unknown,
            condition => What::Branch {
                to: relative(address, signed(byte << 1, 9)),
                on: u8::try_from(condition).ok(),
            },
        },
        0b11100 => What::Jump {
            to: relative(address, signed(u32::from(word & 0x7FF) << 1, 12)),
        },
        _ => What::Unknown,
    }
}

const fn writes_nothing() -> What {
    What::Plain { writes: 0 }
}

fn imm5(word: u16) -> i32 {
    i32::from(word >> 6 & 0x1F)
}

const fn load(rt: u8, rn: u8, offset: i32) -> What {
    What::Load { rt, rn, offset }
}

const fn store(rt: u8, rn: u8, offset: i32, bytes: u8) -> What {
    What::Store {
        rt,
        rn,
        offset,
        bytes,
    }
}

/// ADD and SUB of a register or of three bits, A5.2.1.
fn add_or_subtract(word: u16) -> What {
    let (rd, rn) = (field(word, 0, 3), field(word, 3, 3));
    let offset = i32::from(word >> 6 & 7);
    match word >> 9 & 3 {
        0b10 => What::Add { rd, rn, offset },
        0b11 => What::Add {
            rd,
            rn,
            offset: -offset,
        },
        0b00 => What::Sum {
            rd,
            rn,
            rm: field(word, 6, 3),
        },
        _ => writes(rd),
    }
}

/// Special data and branch and exchange, A5.2.3.
fn special(word: u16) -> What {
    let rd = field(word, 0, 3) | field(word, 7, 1) << 3;
    let rm = field(word, 3, 4);
    match word >> 8 & 3 {
        0b00 => What::Sum { rd, rn: rd, rm },
        0b01 => What::Compare,
        0b10 if rd == PC => What::JumpRegister { rm },
        0b10 => What::Move { rd, rm },
        _ if word >> 7 & 1 == 1 => What::CallRegister { rm },
        _ => What::JumpRegister { rm },
    }
}

/// A5.2.5.
fn miscellaneous(address: u32, word: u16) -> What {
    let adjust = 4 * i32::from(word & 0x7F);
    let list = word & 0xFF;
    match word >> 8 & 0xF {
        0b0000 => What::Add {
            rd: SP,
            rn: SP,
            offset: if word >> 7 & 1 == 0 { adjust } else { -adjust },
        },
        0b0001 | 0b0011 | 0b1001 | 0b1011 => {
            let offset = u32::from(word >> 9 & 1) << 6 | u32::from(word >> 3 & 0x1F) << 1;
            What::Branch {
                to: relative(address, offset.cast_signed()),
                on: None,
            }
        }
        // SXTH, SXTB, UXTH, UXTB; REV, REV16, REVSH.
        0b0010 | 0b1010 => writes(field(word, 0, 3)),
        0b0100 | 0b0101 => push(list | (word >> 8 & 1) << LR),
        // CPS.
        0b0110 if word & 0xE8 == 0x60 => writes_nothing(),
        0b1100 | 0b1101 => pop(list | (word >> 8 & 1) << PC),
        0b1111 if word & 0xF != 0 => What::If {
            mask: field(word, 0, 5),
        },
        // NOP, YIELD, WFE, WFI, SEV.
        0b1111 if word >> 4 & 0xF <= 4 => writes_nothing(),
        _ => What::Unknown,
    }
}

/// A push of every register of the list and of nothing else.
pub const fn push(list: Registers) -> What {
    What::Push {
        list,
        bytes: 4 * list.count_ones(),
    }
}

/// A pop of every register of the list and of nothing else.
pub const fn pop(list: Registers) -> What {
    What::Pop {
        list,
        bytes: 4 * list.count_ones(),
    }
}

//! The part of the Thumb-2 encoding that ends a function or takes its time (ARM DDI 0403E.b, chapter A5).

/// Effect of an instruction on the control flow of its function.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Flow {
    /// Continues, calls, or branches on a condition.
    Continue,
    /// Leaves through a register or the stack.
    Return,
    /// Branches to this address unconditionally.
    Jump(u64),
}

/// Halfwords of the instruction that begins with `first`, A5.1.
pub const fn halfwords(first: u16) -> usize {
    match first >> 11 {
        0b11101..=0b11111 => 2,
        _ => 1,
    }
}

/// The effect of the instruction of these halfwords at `address`; narrow ones ignore `second`.
pub fn flow(address: u64, first: u16, second: u16) -> Flow {
    if halfwords(first) == 1 {
        return match first {
            // BX Rm, A7.7.20.
            _ if first & 0xFF87 == 0x4700 => Flow::Return,
            // POP with the PC, A7.7.99.
            _ if first & 0xFF00 == 0xBD00 => Flow::Return,
            // MOV PC, Rm, A7.7.77.
            _ if first & 0xFF87 == 0x4687 => Flow::Return,
            // B T2, A7.7.12: eleven bits, halved.
            _ if first & 0xF800 == 0xE000 => {
                Flow::Jump(relative(address, i64::from(first & 0x7FF) << 1, 12))
            }
            _ => Flow::Continue,
        };
    }
    match (first, second) {
        // LDMIA SP!, {…, PC}, A7.7.41, and LDMDB.
        _ if first & 0xFE50 == 0xE810 && second & 0x8000 != 0 => Flow::Return,
        // LDR PC, […], A7.7.43.
        _ if first & 0xFF70 == 0xF850 && second & 0xF000 == 0xF000 => Flow::Return,
        // B.W T4, A7.7.12.
        _ if first & 0xF800 == 0xF000 && second & 0xD000 == 0x9000 => {
            let sign = u32::from(first >> 10 & 1);
            let i1 = u32::from(second >> 13 & 1) ^ sign ^ 1;
            let i2 = u32::from(second >> 11 & 1) ^ sign ^ 1;
            let offset = sign << 24
                | i1 << 23
                | i2 << 22
                | u32::from(first & 0x3FF) << 12
                | u32::from(second & 0x7FF) << 1;
            Flow::Jump(relative(address, i64::from(offset), 25))
        }
        _ => Flow::Continue,
    }
}

/// The time of an instruction: [`super::cycles`].
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub struct Timing {
    /// Cycles of its own.
    pub cycles: u64,
    /// It loads one word: its last cycle overlaps with the next such instruction.
    pub load: bool,
    /// The address it loads from in the code.
    pub literal: Option<u64>,
}

/// The time of the instruction of these halfwords at `address`.
pub fn timing(address: u64, [first, second]: [u16; 2]) -> Timing {
    let literal_base = (address + 4) & !3;
    let literal = match first {
        // LDR T1 (literal), A7.7.44, and T2.
        _ if first & 0xF800 == 0x4800 => Some(literal_base + 4 * u64::from(first & 0xFF)),
        0xF85F => Some(literal_base - u64::from(second & 0xFFF)),
        0xF8DF => Some(literal_base + u64::from(second & 0xFFF)),
        _ => None,
    };
    let load = match first >> 11 {
        // LDRSB and those behind it, A5.2.4.
        0b01010 | 0b01011 => first & 0xE00 >= 0x600,
        0b01001 | 0b01101 | 0b01111 | 0b10001 | 0b10011 => true,
        0b11111 => first & 0xFE10 == 0xF810,
        _ => false,
    };
    let words = match first {
        _ if first & 0xF600 == 0xB400 => first & 0x1FF,
        _ if first & 0xF000 == 0xC000 => first & 0xFF,
        _ if first & 0xFE40 == 0xE800 => second,
        // Two words, exclusive accesses, table branches: A5.3.6.
        _ if first & 0xFE40 == 0xE840 => 0b11,
        _ => 0,
    };
    let arithmetic = match first & 0xFFF0 {
        0xFB90 | 0xFBB0 => 6,
        0xFB00 if second & 0xF000 != 0xF000 => 1,
        _ => 0,
    };
    Timing {
        cycles: 1 + u64::from(load) + u64::from(words.count_ones()) + arithmetic,
        load,
        literal,
    }
}

/// Target of a branch at `address` by a signed offset of `bits` bits: the PC reads 4 ahead.
fn relative(address: u64, offset: i64, bits: u32) -> u64 {
    let shift = i64::BITS - bits;
    (address + 4).wrapping_add_signed(offset << shift >> shift)
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn flow_of_compiled_instructions_is_classified() {
        for (first, second, expected) in [
            (0x4770, 0, Flow::Return),      // bx lr
            (0x4718, 0, Flow::Return),      // bx r3
            (0xBD80, 0, Flow::Return),      // pop {r7, pc}
            (0xE8BD, 0x8FF0, Flow::Return), // pop.w {…, pc}
            (0xF85D, 0xFB04, Flow::Return), // ldr pc, [sp], #4
            (0x4780, 0, Flow::Continue),    // blx r0
            (0xBC80, 0, Flow::Continue),    // pop {r7}
            (0xE8BD, 0x4FF0, Flow::Continue),
            (0xF7FF, 0xFFFE, Flow::Continue), // bl
            (0xD0FE, 0, Flow::Continue),      // beq
            (0xF85D, 0x0B04, Flow::Continue), // ldr r0, [sp], #4
            (0xE7FE, 0, Flow::Jump(0x100)),   // b to itself
            (0xE002, 0, Flow::Jump(0x108)),
            (0xF7FF, 0xBFFE, Flow::Jump(0x100)), // b.w to itself
            (0xF001, 0xB800, Flow::Jump(0x1104)),
        ] {
            assert_eq!(flow(0x100, first, second), expected, "{first:04x}");
        }
    }
}

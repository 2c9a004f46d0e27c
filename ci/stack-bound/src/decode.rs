//! What one Thumb instruction does to the stack, to the flow and to the core registers.
//!
//! Capstone disassembles; this module reduces its operands to an [`Effect`]. Whatever moves the
//! stack pointer or the program counter in another form is [`Effect::Unsupported`], so that the
//! analysis fails on it instead of missing a frame.

use capstone::arch::arm::{
    ArchExtraMode, ArchMode, ArmCC, ArmOperand, ArmOperandType, ArmReg, ArmShift,
};
use capstone::arch::{BuildsCapstone, BuildsCapstoneExtraMode, DetailsArchInsn};
use capstone::{Capstone, Insn, RegId};

use crate::Error;

/// Numbers of the stack pointer, the link register and the program counter.
pub const SP: u8 = 13;
pub const LR: u8 = 14;
pub const PC: u8 = 15;

/// Core registers as bits, bit 0 = r0.
pub type Registers = u16;

/// r0 to r3, r12 and the link register: not preserved across a call (AAPCS32, 6.1.1).
pub const CALLER_SAVED: Registers = 0b0101_0000_0000_1111;

/// One decoded instruction.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct Instruction {
    /// Bytes: 2 or 4.
    pub length: u32,
    /// What it does.
    pub effect: Effect,
    /// Whether the floating-point unit executes it.
    pub float: bool,
}

/// What an instruction does, as far as a stack bound depends on it.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Effect {
    /// Leaves unknown values in these registers.
    Other(Registers),
    /// Sets the flags and nothing else.
    Compare,
    /// Compares `rn` with a constant.
    CompareConstant(u8, u32),
    /// `rd = value`.
    Set(u8, u32),
    /// `movt`: sets the upper half of `rd`.
    SetTop(u8, u16),
    /// `rd = rm`.
    Move(u8, u8),
    /// `rd = rn + offset`.
    Add(u8, u8, i32),
    /// `rd = rn + rm`.
    AddRegister(u8, u8, u8),
    /// `rd = rn + 4 · any`: the address of a row in a table of words or of wide branches.
    AddScaled(u8, u8),
    /// `rt = [address]`, a word of the literal pool.
    LoadLiteral(u8, u32),
    /// `rt = [rn + offset]`, a word.
    Load(u8, u8, i32),
    /// `[rn + offset] = rt`, so many bytes.
    Store(u8, u8, i32, u8),
    /// The stack pointer decreases by these bytes, then the list is stored upwards from it.
    Push(Registers, u32),
    /// The list is loaded upwards from the stack pointer, which then increases by these bytes.
    Pop(Registers, u32),
    /// `msr msp, rn`.
    SetMainStack(u8),
    /// Jumps always.
    Jump(u32),
    /// Jumps on a condition: 0 to 13 as in ARM DDI 0403E.e, A7.3; `None` for `cbz` and `cbnz`.
    Branch(u32, Option<u8>),
    /// Calls a fixed address.
    Call(u32),
    /// Jumps to the address in a register; a return where that is the link register.
    JumpRegister(u8),
    /// Calls the address in a register.
    CallRegister(u8),
    /// Jumps forward by an entry of the table at `rn` (PC: behind the instruction); whether of
    /// halfwords (`tbh`) or bytes (`tbb`).
    TableJump(u8, bool),
    /// Makes the next one to four instructions conditional; see [`it_block`].
    IfThen(u8),
    /// A permanently undefined instruction, which never completes.
    Trap,
    /// Cannot be followed.
    Unsupported,
}

/// The instructions covered by an [`Effect::IfThen`]: of each, whether it runs when the condition
/// holds (`true`) or when it does not. The lowest 1 of the mask ends the block; the bits above it
/// are compared with the lowest bit of the first condition (A7.3.1).
pub fn it_block(mask: u8) -> impl Iterator<Item = bool> {
    let first = mask >> 4 & 1;
    let length = 4 - (mask & 0xF).trailing_zeros();
    (0..length).map(move |nth| nth == 0 || mask >> (4 - nth) & 1 == first)
}

/// An operand, core registers by number.
enum Operand {
    Core(u8),
    /// `r << n`, or shifted otherwise.
    Shifted(ArmShift),
    Immediate(i32),
    /// Memory at a register plus an offset.
    At(u8, i32),
    /// Memory at a register plus another register.
    Indexed(u8),
    Other,
}

/// Capstone, set up for the M profile.
pub struct Decoder(Capstone);

impl Decoder {
    pub fn new() -> Result<Self, Error> {
        let builder = Capstone::new().arm().mode(ArchMode::Thumb).detail(true);
        let builder = builder.extra_mode(std::iter::once(ArchExtraMode::MClass));
        let failed = |error: capstone::Error| Error::Disassembler(error.to_string());
        builder.build().map(Self).map_err(failed)
    }

    /// Decodes the instruction at the start of `code`, which lies at `address`. An encoding that
    /// Capstone does not know is [`Effect::Unsupported`]; `None` where `code` ends within it.
    pub fn decode(&self, address: u32, code: &[u8]) -> Option<Instruction> {
        let first = u16::from_le_bytes([*code.first()?, *code.get(1)?]);
        let length = if first >> 11 >= 0b11101 { 4 } else { 2 };
        let code = code.get(..length)?;
        let decoded = self.0.disasm_count(code, u64::from(address), 1).ok();
        let instruction = decoded.as_ref().and_then(|decoded| decoded.first());
        let effect = instruction.and_then(|instruction| self.effect(address, code, instruction));
        let name = instruction.and_then(|instruction| instruction.mnemonic());
        Some(Instruction {
            length: if length == 4 { 4 } else { 2 },
            effect: effect.map_or(Effect::Unsupported, confined),
            float: name.is_some_and(|name| name.starts_with('v')),
        })
    }

    fn effect(&self, address: u32, code: &[u8], instruction: &Insn<'_>) -> Option<Effect> {
        use Operand::{At, Core, Immediate, Indexed, Shifted};
        let detail = self.0.insn_detail(instruction).ok()?;
        let arch = detail.arch_detail();
        let arm = arch.arm()?;
        let name = self.0.insn_name(instruction.id())?;
        let operands: Vec<Operand> = arm.operands().map(Operand::from).collect();
        let list = bits(operands.iter().filter_map(Operand::core));
        let mut writes = bits(detail.regs_write().iter().filter_map(|&id| core(id)));
        // Capstone omits the base of some multiple transfers.
        let multiple = name.starts_with("stm") || name.starts_with('v');
        if let (true, Some(Core(base))) = (arm.writeback() && multiple, operands.first()) {
            writes |= 1 << base;
        }
        let other = Effect::Other(writes);
        // The PC reads four bytes ahead, aligned down for data (A5.1.2).
        let data = |offset: i32| (address.wrapping_add(4) & !3).wrapping_add_signed(offset);
        let add = |rd, rn, offset| match rn {
            PC => Effect::Set(rd, data(offset)),
            _ => Effect::Add(rd, rn, offset),
        };
        let effect = match (name.as_ref(), &operands[..]) {
            ("b", &[Immediate(to)]) => {
                let to = to.cast_unsigned();
                match arm.cc() {
                    ArmCC::ARM_CC_AL => Effect::Jump(to),
                    // Capstone counts from 1.
                    cc => Effect::Branch(to, u8::try_from(cc as u32 - 1).ok()),
                }
            }
            ("cbz" | "cbnz", &[_, Immediate(to)]) => Effect::Branch(to.cast_unsigned(), None),
            ("bl", &[Immediate(to)]) => Effect::Call(to.cast_unsigned()),
            ("blx", &[Core(rm)]) => Effect::CallRegister(rm),
            ("bx", &[Core(rm)]) | ("mov", &[Core(PC), Core(rm)]) => Effect::JumpRegister(rm),
            ("tbb" | "tbh", &[Indexed(rn)]) => Effect::TableJump(rn, name == "tbh"),
            ("it", _) => Effect::IfThen(code[0] & 0x1F),
            ("udf" | "trap", _) => Effect::Trap,
            // The handler may change the registers in its caller's exception frame.
            ("svc", _) => Effect::Other(CALLER_SAVED),
            ("msr", &[_, Core(rn)]) => special_register(code[2], rn),
            ("cmp", &[Core(rn), Immediate(value)]) => {
                Effect::CompareConstant(rn, value.cast_unsigned())
            }
            ("cmp" | "cmn" | "tst" | "teq" | "vmrs", _) if writes == 0 => Effect::Compare,
            ("mov" | "movs" | "movw", &[Core(rd), Immediate(value)]) => {
                Effect::Set(rd, value.cast_unsigned())
            }
            ("mvn", &[Core(rd), Immediate(value)]) => Effect::Set(rd, !value.cast_unsigned()),
            ("movt", &[Core(rd), Immediate(half)]) => Effect::SetTop(rd, u16::try_from(half).ok()?),
            ("adr", &[Core(rd), Immediate(offset)]) => Effect::Set(rd, data(offset)),
            ("mov" | "movs", &[Core(rd), Core(rm)]) => Effect::Move(rd, rm),
            ("add" | "addw", &[Core(rd), Immediate(by)]) => add(rd, rd, by),
            ("add" | "addw", &[Core(rd), Core(rn), Immediate(by)]) => add(rd, rn, by),
            ("sub" | "subw", &[Core(rd), Immediate(by)]) => add(rd, rd, by.wrapping_neg()),
            ("sub" | "subw", &[Core(rd), Core(rn), Immediate(by)]) => {
                add(rd, rn, by.wrapping_neg())
            }
            ("add", &[Core(rd), Core(rm)]) => Effect::AddRegister(rd, rd, rm),
            ("add", &[Core(rd), Core(rn), Core(rm)]) => Effect::AddRegister(rd, rn, rm),
            ("add", &[Core(rd), Core(rn), Shifted(ArmShift::Lsl(2))]) => Effect::AddScaled(rd, rn),
            ("push", _) => Effect::Push(list, 4 * list.count_ones()),
            ("pop", _) => Effect::Pop(list, 4 * list.count_ones()),
            // The immediate counts words.
            ("vpush", _) => Effect::Push(0, 4 * u32::from(code[2])),
            ("vpop", _) => Effect::Pop(0, 4 * u32::from(code[2])),
            // A base that moves before the access pushes, one that moves after it pops.
            ("str" | "strd", &[.., At(SP, by)]) if arm.writeback() && by < 0 => {
                Effect::Push(ascending(&operands)?, by.unsigned_abs())
            }
            ("ldr" | "ldrd", &[.., At(SP, _), Immediate(by)]) if by > 0 => {
                Effect::Pop(ascending(&operands)?, by.unsigned_abs())
            }
            _ if arm.writeback() => other,
            ("ldr", &[Core(rt), At(PC, offset)]) => Effect::LoadLiteral(rt, data(offset)),
            ("ldr", &[Core(rt), At(rn, offset)]) => Effect::Load(rt, rn, offset),
            ("str", &[Core(rt), At(rn, offset)]) => Effect::Store(rt, rn, offset, 4),
            ("strh", &[Core(rt), At(rn, offset)]) => Effect::Store(rt, rn, offset, 2),
            ("strb", &[Core(rt), At(rn, offset)]) => Effect::Store(rt, rn, offset, 1),
            _ => other,
        };
        Some(effect)
    }
}

fn bits(registers: impl Iterator<Item = u8>) -> Registers {
    registers.fold(0, |list, register| list | 1 << register)
}

/// A register or a pair as the list that a push would store in the same order; a descending pair
/// is stored as nothing known.
fn ascending(operands: &[Operand]) -> Option<Registers> {
    let registers: Vec<u8> = operands.iter().filter_map(Operand::core).collect();
    match registers[..] {
        [] => None,
        [one, two] if one >= two => Some(0),
        _ => Some(bits(registers.into_iter())),
    }
}

impl Operand {
    fn core(&self) -> Option<u8> {
        match self {
            Self::Core(register) => Some(*register),
            _ => None,
        }
    }
}

impl From<ArmOperand> for Operand {
    fn from(operand: ArmOperand) -> Self {
        match operand.op_type {
            ArmOperandType::Reg(id) => match (core(id), operand.shift) {
                (Some(register), ArmShift::Invalid) => Self::Core(register),
                (Some(_), shift) => Self::Shifted(shift),
                (None, _) => Self::Other,
            },
            ArmOperandType::Imm(value) => Self::Immediate(value),
            ArmOperandType::Mem(memory) => match (core(memory.base()), core(memory.index())) {
                (Some(base), None) => Self::At(base, memory.disp()),
                (Some(base), Some(_)) => Self::Indexed(base),
                (None, _) => Self::Other,
            },
            _ => Self::Other,
        }
    }
}

/// A core register's number.
fn core(id: RegId) -> Option<u8> {
    match u32::from(id.0) {
        id @ ArmReg::ARM_REG_R0..=ArmReg::ARM_REG_R12 => u8::try_from(id - ArmReg::ARM_REG_R0).ok(),
        ArmReg::ARM_REG_SP => Some(SP),
        ArmReg::ARM_REG_LR => Some(LR),
        ArmReg::ARM_REG_PC => Some(PC),
        _ => None,
    }
}

/// `msr`: the field `SYSm` names the register (B5.1.1).
fn special_register(sysm: u8, rn: u8) -> Effect {
    const MSP: u8 = 8;
    const PSP: u8 = 9;
    const CONTROL: u8 = 20;
    match sysm {
        MSP => Effect::SetMainStack(rn),
        // Either may switch to another stack.
        PSP | CONTROL => Effect::Unsupported,
        _ => Effect::Other(0),
    }
}

/// No other form may write the stack pointer or load the program counter.
fn confined(effect: Effect) -> Effect {
    const SPECIAL: Registers = 1 << SP | 1 << PC;
    let refused = match effect {
        Effect::Other(writes) => writes & SPECIAL != 0,
        Effect::Set(rd, _) | Effect::SetTop(rd, _) | Effect::AddScaled(rd, _) => {
            rd == SP || rd == PC
        }
        Effect::LoadLiteral(rt, _) | Effect::Load(rt, _, _) => rt == SP || rt == PC,
        Effect::Move(rd, _) | Effect::Add(rd, _, _) | Effect::AddRegister(rd, _, _) => rd == PC,
        Effect::Pop(list, _) => list & 1 << SP != 0,
        _ => false,
    };
    if refused { Effect::Unsupported } else { effect }
}

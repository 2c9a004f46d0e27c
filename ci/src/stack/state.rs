//! What is known of the registers and of the stack at one instruction.

use std::collections::BTreeMap;

use super::thumb::{Registers, What, LR, PC, SP};

/// More possible values than this are as good as none known.
const MOST: usize = 64;

/// What a register may hold.
#[derive(Clone, Debug, Default, PartialEq, Eq)]
pub enum Value {
    /// Anything.
    #[default]
    Unknown,
    /// What this register held at the routine's entry.
    Entry(u8),
    /// One of these words.
    OneOf(Vec<u32>),
    /// Some row of the table there, four bytes each. Which one nobody knows.
    RowOf(u32),
    /// The stack pointer's value at entry, plus this.
    Stack(i32),
}

impl Value {
    /// This very word.
    pub fn word(word: u32) -> Self {
        Self::OneOf(vec![word])
    }

    /// What is true of both.
    pub fn join(&self, other: &Self) -> Self {
        match (self, other) {
            (one, another) if one == another => one.clone(),
            (Self::OneOf(one), Self::OneOf(another)) => {
                let mut all = [one.as_slice(), another].concat();
                all.sort_unstable();
                all.dedup();
                if all.len() <= MOST {
                    Self::OneOf(all)
                } else {
                    Self::Unknown
                }
            }
            _ => Self::Unknown,
        }
    }

    /// Every word changed, or none where that is not known.
    pub fn map(&self, change: impl Fn(u32) -> Option<u32>) -> Self {
        match self {
            Self::OneOf(words) => {
                let words: Option<Vec<u32>> = words.iter().map(|&word| change(word)).collect();
                words.map_or(Self::Unknown, |mut words| {
                    words.sort_unstable();
                    words.dedup();
                    Self::OneOf(words)
                })
            }
            _ => Self::Unknown,
        }
    }

    /// Of the words, those for which `holds`; `None` where there is none.
    pub fn only(&self, holds: impl Fn(u32) -> bool) -> Option<Self> {
        match self {
            Self::OneOf(words) => {
                let left: Vec<u32> = words.iter().copied().filter(|&word| holds(word)).collect();
                (!left.is_empty()).then_some(Self::OneOf(left))
            }
            other => Some(other.clone()),
        }
    }

    /// The sum of both.
    pub fn sum(&self, other: &Self) -> Self {
        match (self, other) {
            (one, Self::OneOf(words)) | (Self::OneOf(words), one) => {
                let sums = words.iter().map(|&word| one.plus(word.cast_signed()));
                sums.reduce(|sum, next| sum.join(&next)).unwrap_or_default()
            }
            _ => Self::Unknown,
        }
    }

    /// This plus `offset`.
    pub fn plus(&self, offset: i32) -> Self {
        match self {
            Self::Stack(at) => Self::Stack(at.saturating_add(offset)),
            Self::Unknown | Self::Entry(_) | Self::RowOf(_) => Self::Unknown,
            Self::OneOf(_) => self.map(|word| Some(word.wrapping_add_signed(offset))),
        }
    }
}

/// Before an instruction.
#[derive(Clone, Debug, PartialEq, Eq)]
pub struct State {
    /// Where the stack pointer is, from where it was at entry: never positive.
    pub depth: i32,
    /// Whether it was set anew to the stack's beginning: `depth` then counts from there.
    pub fresh: bool,
    /// r0 to r12, and the link register as the last.
    registers: [Value; 14],
    /// What pushes left, by its place from entry.
    saved: BTreeMap<i32, Value>,
}

impl State {
    /// At a routine's first instruction.
    pub fn entry() -> Self {
        let register = |nth| u8::try_from(nth).unwrap_or(u8::MAX);
        Self {
            depth: 0,
            fresh: false,
            registers: std::array::from_fn(|nth| {
                Value::Entry(if nth == 13 { LR } else { register(nth) })
            }),
            saved: BTreeMap::new(),
        }
    }

    fn slot(register: u8) -> Option<usize> {
        match register {
            0..=12 => Some(usize::from(register)),
            LR => Some(13),
            _ => None,
        }
    }

    /// What a register may hold.
    pub fn get(&self, register: u8) -> Value {
        match (register, Self::slot(register)) {
            (SP, _) => Value::Stack(self.depth),
            (_, Some(slot)) => self.registers[slot].clone(),
            _ => Value::Unknown,
        }
    }

    /// It holds this now.
    pub fn set(&mut self, register: u8, value: Value) {
        if let Some(slot) = Self::slot(register) {
            self.registers[slot] = value;
        }
    }

    /// These hold anything now.
    pub fn forget(&mut self, list: Registers) {
        for register in each(list) {
            self.set(register, Value::Unknown);
        }
    }

    /// Those of r4 to r11 that do not hold what they held at entry.
    pub fn spoilt(&self) -> Registers {
        let spoilt = (4..=11).filter(|&register| self.get(register) != Value::Entry(register));
        spoilt.fold(0, |list, register| list | 1 << register)
    }

    /// What holds whichever way the instruction was reached; `None` where the stack's depth depends
    /// on the way.
    pub fn join(&self, other: &Self) -> Option<Self> {
        if (self.depth, self.fresh) != (other.depth, other.fresh) {
            return None;
        }
        let mut joined = self.clone();
        for (one, another) in joined.registers.iter_mut().zip(&other.registers) {
            *one = one.join(another);
        }
        joined.saved.retain(|at, _| other.saved.contains_key(at));
        for (at, value) in &mut joined.saved {
            *value = value.join(&other.saved[at]);
        }
        Some(joined)
    }

    /// The stack pointer goes down and a list is stored.
    pub fn push(&mut self, list: Registers, bytes: u32) {
        self.depth = self.depth.saturating_sub_unsigned(bytes);
        for (at, register) in (self.depth..).step_by(4).zip(each(list)) {
            self.saved.insert(at, self.get(register));
        }
    }

    /// A list is loaded and the stack pointer goes up.
    pub fn pop(&mut self, list: Registers, bytes: u32) {
        for (at, register) in (self.depth..).step_by(4).zip(each(list)) {
            let value = self.saved.get(&at).cloned().unwrap_or_default();
            self.set(register, value);
        }
        self.rise(self.depth.saturating_add_unsigned(bytes));
    }

    /// The stack pointer is there now.
    pub fn rise(&mut self, depth: i32) {
        self.depth = depth;
        self.saved.retain(|&at, _| at >= depth);
    }

    /// What a word popped into the program counter is worth: where it was pushed from.
    pub fn popped_pc(&self, list: Registers) -> Value {
        let below = (list & !(1 << PC)).count_ones();
        let at = self.depth.saturating_add_unsigned(4 * below);
        self.saved.get(&at).cloned().unwrap_or_default()
    }

    /// Carries out what changes values alone; `false` for anything that moves the flow or the stack.
    pub fn step(&mut self, what: What, word: impl Fn(u32) -> Option<u32>) -> bool {
        match what {
            What::Plain { writes } | What::Float { writes } => self.forget(writes),
            What::Compare | What::CompareWord { .. } | What::Store { .. } => {}
            What::Constant { rd, value } => self.set(rd, Value::word(value)),
            What::Top { rd, half } => {
                let top = u32::from(half) << 16;
                let value = self.get(rd).map(|low| Some(low & 0xFFFF | top));
                self.set(rd, value);
            }
            What::Move { rd, rm } if rd != SP => self.set(rd, self.get(rm)),
            What::Add { rd, rn, offset } if rd != SP => self.set(rd, self.get(rn).plus(offset)),
            What::Sum { rd, rn, rm } if rd != SP => {
                self.set(rd, self.get(rn).sum(&self.get(rm)));
            }
            What::Row { rd, rn, .. } => {
                let row = match self.get(rn) {
                    Value::OneOf(words) if words.len() == 1 => Value::RowOf(words[0]),
                    _ => Value::Unknown,
                };
                self.set(rd, row);
            }
            What::Literal { rt, address } => {
                self.set(rt, word(address).map_or(Value::Unknown, Value::word));
            }
            What::Load { rt, rn, offset } => {
                let value = self.get(rn).plus(offset).map(word);
                self.set(rt, value);
            }
            What::Push { list, bytes } => self.push(list, bytes),
            What::Pop { list, bytes } if list & 1 << PC == 0 => self.pop(list, bytes),
            _ => return false,
        }
        true
    }
}

fn each(list: Registers) -> impl Iterator<Item = u8> {
    (0..16).filter(move |&register| list >> register & 1 == 1)
}

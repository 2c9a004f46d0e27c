//! What is known of the core registers and of the stack before one instruction.

use std::collections::BTreeMap;

use crate::decode::{Effect, LR, PC, Registers, SP};

/// With more possible words than this a value counts as unknown.
const MAX_WORDS: usize = 64;

/// The registers a compiler preserves across a call, AAPCS32, 6.1.1: r4 to r11.
const CALLEE_SAVED: std::ops::RangeInclusive<u8> = 4..=11;

/// What a register may hold.
#[derive(Clone, Debug, Default, PartialEq, Eq)]
pub enum Value {
    /// Any word.
    #[default]
    Unknown,
    /// What this register held at the routine's entry.
    AtEntry(u8),
    /// One of these words, ascending.
    OneOf(Vec<u32>),
    /// The address of some row, four bytes each, of the table there.
    RowOf(u32),
    /// The stack pointer at entry plus this.
    Stack(i32),
}

impl Value {
    pub fn word(word: u32) -> Self {
        Self::OneOf(vec![word])
    }

    fn words(mut words: Vec<u32>) -> Self {
        words.sort_unstable();
        words.dedup();
        if words.len() <= MAX_WORDS {
            Self::OneOf(words)
        } else {
            Self::Unknown
        }
    }

    /// What holds of both.
    pub fn join(&self, other: &Self) -> Self {
        match (self, other) {
            (one, another) if one == another => one.clone(),
            (Self::OneOf(one), Self::OneOf(another)) => {
                Self::words([one.as_slice(), another].concat())
            }
            _ => Self::Unknown,
        }
    }

    /// Every possible word mapped; unknown where one of them has no image.
    pub fn map(&self, image: impl Fn(u32) -> Option<u32>) -> Self {
        let Self::OneOf(words) = self else {
            return Self::Unknown;
        };
        let images: Option<Vec<u32>> = words.iter().map(|&word| image(word)).collect();
        images.map_or(Self::Unknown, Self::words)
    }

    /// Without the words for which `holds` is false; `None` where none remains.
    pub fn retain(&self, holds: impl Fn(u32) -> bool) -> Option<Self> {
        let Self::OneOf(words) = self else {
            return Some(self.clone());
        };
        let kept: Vec<u32> = words.iter().copied().filter(|&word| holds(word)).collect();
        (!kept.is_empty()).then_some(Self::OneOf(kept))
    }

    pub fn sum(&self, other: &Self) -> Self {
        match (self, other) {
            (one, Self::OneOf(words)) | (Self::OneOf(words), one) => {
                let sums = words.iter().map(|&word| one.plus(word.cast_signed()));
                sums.reduce(|sum, next| sum.join(&next)).unwrap_or_default()
            }
            _ => Self::Unknown,
        }
    }

    pub fn plus(&self, offset: i32) -> Self {
        match self {
            Self::Stack(at) => Self::Stack(at.saturating_add(offset)),
            Self::Unknown | Self::AtEntry(_) | Self::RowOf(_) => Self::Unknown,
            Self::OneOf(_) => self.map(|word| Some(word.wrapping_add_signed(offset))),
        }
    }
}

/// Before an instruction.
#[derive(Clone, Debug, PartialEq, Eq)]
pub struct State {
    /// The stack pointer relative to the routine's entry, bytes: never positive.
    pub depth: i32,
    /// Whether the stack pointer was set to the top of the stack: `depth` counts from there.
    pub restarted: bool,
    /// r0 to r12 and the link register.
    registers: [Value; 14],
    /// Words that pushes have stored, by address relative to the entry.
    saved: BTreeMap<i32, Value>,
}

impl State {
    /// At a routine's first instruction.
    pub fn entry() -> Self {
        const NUMBERS: [u8; 14] = [0, 1, 2, 3, 4, 5, 6, 7, 8, 9, 10, 11, 12, LR];
        Self {
            depth: 0,
            restarted: false,
            registers: NUMBERS.map(Value::AtEntry),
            saved: BTreeMap::new(),
        }
    }

    /// At the top of an emptied stack: what lay on the old one is not used again.
    pub fn restart() -> Self {
        let mut state = Self::entry();
        state.forget(Registers::MAX);
        state.restarted = true;
        state
    }

    fn slot(register: u8) -> Option<usize> {
        match register {
            0..=12 => Some(usize::from(register)),
            LR => Some(13),
            _ => None,
        }
    }

    pub fn get(&self, register: u8) -> Value {
        match (register, Self::slot(register)) {
            (SP, _) => Value::Stack(self.depth),
            (_, Some(slot)) => self.registers[slot].clone(),
            _ => Value::Unknown,
        }
    }

    pub fn set(&mut self, register: u8, value: Value) {
        if let Some(slot) = Self::slot(register) {
            self.registers[slot] = value;
        }
    }

    /// Sets a register or the stack pointer; `false` where its depth would be unknown.
    fn assign(&mut self, register: u8, value: Value) -> bool {
        match (register, value) {
            (SP, Value::Stack(depth)) => self.set_depth(depth),
            (SP, _) => return false,
            (_, value) => self.set(register, value),
        }
        true
    }

    pub fn forget(&mut self, list: Registers) {
        for register in each(list) {
            self.set(register, Value::Unknown);
        }
    }

    /// The callee-saved registers that do not hold their value at entry.
    pub fn clobbered(&self) -> Registers {
        let changed =
            CALLEE_SAVED.filter(|&register| self.get(register) != Value::AtEntry(register));
        changed.fold(0, |list, register| list | 1 << register)
    }

    /// What holds on both ways here; `None` where the stack's depth differs between them.
    pub fn join(&self, other: &Self) -> Option<Self> {
        if (self.depth, self.restarted) != (other.depth, other.restarted) {
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

    pub fn push(&mut self, list: Registers, bytes: u32) {
        self.depth = self.depth.saturating_sub_unsigned(bytes);
        for (at, register) in (self.depth..).step_by(4).zip(each(list)) {
            self.saved.insert(at, self.get(register));
        }
    }

    pub fn pop(&mut self, list: Registers, bytes: u32) {
        for (at, register) in (self.depth..).step_by(4).zip(each(list)) {
            let value = self.saved.get(&at).cloned().unwrap_or_default();
            self.set(register, value);
        }
        self.set_depth(self.depth.saturating_add_unsigned(bytes));
    }

    fn set_depth(&mut self, depth: i32) {
        self.depth = depth;
        self.saved.retain(|&at, _| at >= depth);
    }

    /// The value that a pop of `list` loads into the program counter.
    pub fn popped_pc(&self, list: Registers) -> Value {
        let below = (list & !(1 << PC)).count_ones();
        let at = self.depth.saturating_add_unsigned(4 * below);
        self.saved.get(&at).cloned().unwrap_or_default()
    }

    /// Applies an effect on register values and pushed words; `false` for anything that redirects
    /// the flow or sets the stack pointer to what is not known. `word` reads constants.
    pub fn apply(&mut self, effect: Effect, word: impl Fn(u32) -> Option<u32>) -> bool {
        match effect {
            Effect::Other(writes) => self.forget(writes),
            Effect::Compare | Effect::CompareConstant(..) | Effect::Store(..) => {}
            Effect::Set(rd, value) => self.set(rd, Value::word(value)),
            Effect::SetTop(rd, half) => {
                let top = u32::from(half) << 16;
                let value = self.get(rd).map(|low| Some(low & 0xFFFF | top));
                self.set(rd, value);
            }
            Effect::Move(rd, rm) => return self.assign(rd, self.get(rm)),
            Effect::Add(rd, rn, by) => return self.assign(rd, self.get(rn).plus(by)),
            Effect::AddRegister(rd, rn, rm) => {
                return self.assign(rd, self.get(rn).sum(&self.get(rm)));
            }
            Effect::AddScaled(rd, rn) => {
                let row = match self.get(rn) {
                    Value::OneOf(words) if words.len() == 1 => Value::RowOf(words[0]),
                    _ => Value::Unknown,
                };
                self.set(rd, row);
            }
            Effect::LoadLiteral(rt, address) => self.set(rt, Value::word(address).map(word)),
            Effect::Load(rt, rn, offset) => self.set(rt, self.get(rn).plus(offset).map(word)),
            Effect::Push(list, bytes) => self.push(list, bytes),
            Effect::Pop(list, bytes) if list & 1 << PC == 0 => self.pop(list, bytes),
            _ => return false,
        }
        true
    }
}

fn each(list: Registers) -> impl Iterator<Item = u8> {
    (0..16).filter(move |&register| list >> register & 1 == 1)
}

//! One routine, from its first instruction along every way to its returns: how deep it takes the
//! stack, whom it calls from which depth.
//!
//! A jump out of a function (a tail call, outlined code) is followed with the stack as it is, so it
//! does not matter where the compiler drew the borders. What cannot be followed is an error.

use std::collections::{BTreeMap, BTreeSet};

use super::program::Program;
use super::state::{State, Value};
use super::thumb::{block, Registers, What, LR, PC, SP};
use crate::error::Error;

/// What its caller holds in registers that a routine jumps through: outlined code does.
type Given = BTreeMap<u8, Vec<u32>>;

/// Why a routine has no summary.
#[derive(Debug)]
pub enum Trouble {
    /// It calls or jumps through a register that its caller set.
    Wants(u8),
    /// It cannot be bounded, and why.
    Cannot(String),
}

impl From<Trouble> for Error {
    fn from(trouble: Trouble) -> Self {
        Self::Failed(match trouble {
            Trouble::Wants(register) => format!("it calls through r{register}, which nobody set"),
            Trouble::Cannot(why) => why,
        })
    }
}

type Result<T> = std::result::Result<T, Trouble>;

fn failed<T>(why: String) -> Result<T> {
    Err(Trouble::Cannot(why))
}

/// What a caller needs to know of a routine and of everything it calls.
#[derive(Clone, Debug, PartialEq, Eq)]
pub struct Summary {
    /// Bytes of stack below where it was entered, with everything it calls.
    pub worst: u32,
    /// The chain of calls that takes the most, outermost first, with each routine's own bytes.
    pub chain: Vec<(u32, u32)>,
    /// Bytes below the stack's beginning where it set the stack pointer anew.
    pub fresh: u32,
    /// Whether it ever comes back.
    pub returns: bool,
    /// Registers of r4 to r11 that it does not restore.
    pub spoils: Registers,
    /// Whether it uses the floating-point unit.
    pub float: bool,
}

/// Works out summaries, each routine once.
pub struct Analysis<'a> {
    program: &'a Program,
    done: BTreeMap<(u32, Given), Summary>,
    /// The registers that a routine was found to want.
    wants: BTreeMap<u32, BTreeSet<u8>>,
    /// The calls that led here, outermost first.
    open: Vec<u32>,
    /// What bytes are stored where, as far as both are known.
    pub stores: BTreeMap<u32, BTreeSet<u8>>,
}

/// What is still to come of an IT block: of each instruction whether it runs, or that either may be.
type Ahead = Vec<Option<bool>>;

impl<'a> Analysis<'a> {
    /// Nothing known yet.
    pub fn of(program: &'a Program) -> Self {
        Self {
            program,
            done: BTreeMap::new(),
            wants: BTreeMap::new(),
            open: Vec::new(),
            stores: BTreeMap::new(),
        }
    }

    /// The routine at `entry`, which nobody gives anything.
    ///
    /// # Errors
    /// Names what cannot be bounded: a recursion, an unknown frame, an indirect call.
    pub fn routine(&mut self, entry: u32) -> Result<Summary> {
        self.given(entry, &Given::new())
    }

    fn given(&mut self, entry: u32, given: &Given) -> Result<Summary> {
        if let Some(known) = self.done.get(&(entry, given.clone())) {
            return Ok(known.clone());
        }
        if let Some(from) = self.open.iter().position(|&open| open == entry) {
            let round = self.open[from..].iter().chain([&entry]);
            let names: Vec<_> = round.map(|&at| self.program.name(at)).collect();
            return failed(format!("recursion: {}", names.join(" -> ")));
        }
        self.open.push(entry);
        let summary = Walk::through(self, entry, given);
        self.open.pop();
        if let Err(Trouble::Wants(register)) = summary {
            self.wants.entry(entry).or_default().insert(register);
        }
        let summary = summary?;
        self.done.insert((entry, given.clone()), summary.clone());
        Ok(summary)
    }

    /// How many routines were worked out.
    pub fn routines(&self) -> usize {
        self.done.len()
    }
}

struct Walk<'w, 'a> {
    analysis: &'w mut Analysis<'a>,
    entry: u32,
    given: &'w Given,
    /// What holds at each instruction; one inside an IT block has a state for each way through it.
    states: BTreeMap<(u32, Ahead), State>,
    todo: Vec<(u32, Ahead)>,
    own: u32,
    summary: Summary,
}

impl<'w, 'a> Walk<'w, 'a> {
    fn through(analysis: &'w mut Analysis<'a>, entry: u32, given: &'w Given) -> Result<Summary> {
        let mut walk = Self {
            analysis,
            entry,
            given,
            states: BTreeMap::new(),
            todo: Vec::new(),
            own: 0,
            summary: Summary {
                worst: 0,
                chain: Vec::new(),
                fresh: 0,
                returns: false,
                spoils: 0,
                float: false,
            },
        };
        walk.reach(entry, Vec::new(), State::entry(), entry)?;
        while let Some((at, ahead)) = walk.todo.pop() {
            let Some(state) = walk.states.get(&(at, ahead.clone())).cloned() else {
                continue;
            };
            walk.instruction(at, &ahead, state)?;
        }
        let mut summary = walk.summary;
        if summary.chain.is_empty() || walk.own >= summary.worst {
            summary.worst = walk.own;
            summary.chain.clear();
        }
        summary.chain.insert(0, (entry, walk.own));
        Ok(summary)
    }

    fn program(&self) -> &'a Program {
        self.analysis.program
    }

    /// `failed`, with where.
    fn cannot<T>(&self, at: u32, why: &str) -> Result<T> {
        let (name, place) = (self.program().name(self.entry), self.program().name(at));
        failed(format!("{name}: {why} at {at:#010x} ({place})"))
    }

    /// `to` can be reached with `state` from `from`.
    fn reach(&mut self, to: u32, ahead: Ahead, state: State, from: u32) -> Result<()> {
        if !self.program().is_code(to) {
            return self.cannot(from, "the flow leaves the code");
        }
        if state.depth > 0 {
            return self.cannot(from, "more is taken off the stack than was put there");
        }
        let used = state.depth.unsigned_abs();
        if state.fresh {
            self.summary.fresh = self.summary.fresh.max(used);
        } else {
            self.own = self.own.max(used);
        }
        let key = (to, ahead);
        let next = match self.states.get(&key) {
            None => state,
            Some(known) => match known.join(&state) {
                None => return self.cannot(to, "the frame depends on the way there"),
                Some(joined) if joined == *known => return Ok(()),
                Some(joined) => joined,
            },
        };
        self.states.insert(key.clone(), next);
        self.todo.push(key);
        Ok(())
    }

    fn instruction(&mut self, at: u32, ahead: &[Option<bool>], state: State) -> Result<()> {
        let Some(instruction) = self.program().instruction(at) else {
            return self.cannot(at, "the flow leaves the code");
        };
        let next = at + instruction.length;
        if let What::If { mask } = instruction.what {
            for condition in [true, false] {
                let ahead = block(mask).map(|then| Some(then == condition)).collect();
                self.reach(next, ahead, state.clone(), at)?;
            }
            return Ok(());
        }
        let (runs, mut rest) = match ahead.split_first() {
            None => (Some(true), Vec::new()),
            Some((&runs, rest)) => (runs, rest.to_vec()),
        };
        let compares = matches!(instruction.what, What::Compare | What::CompareWord { .. });
        if compares && runs != Some(false) {
            // The flags are new: what follows in the block may run or not.
            rest.fill(None);
        }
        if runs != Some(true) {
            self.reach(next, rest.clone(), state.clone(), at)?;
        }
        if runs != Some(false) {
            self.carry_out(at, instruction.what, state, next, rest)?;
        }
        Ok(())
    }

    fn carry_out(
        &mut self,
        at: u32,
        what: What,
        mut state: State,
        next: u32,
        rest: Ahead,
    ) -> Result<()> {
        self.summary.float |= matches!(what, What::Float { .. });
        if let What::Store {
            rt,
            rn,
            offset,
            bytes,
        } = what
        {
            self.note_store(&state, rt, &state.get(rn).plus(offset), bytes);
        }
        let program = self.program();
        if let (What::CompareWord { rn, word }, true) = (what, rest.is_empty()) {
            let branch = program.instruction(next);
            if let Some(What::Branch { to, on: Some(on) }) = branch.map(|branch| branch.what) {
                let beyond = next + branch.map_or(0, |branch| branch.length);
                return self.compared(next, (rn, word), on, &state, [to, beyond]);
            }
        }
        let pool = |address| program.word(address);
        if state.step(what, pool) {
            return self.reach(next, rest, state, at);
        }
        match what {
            What::Jump { to } => self.reach(to, Vec::new(), state, at),
            What::Branch { to, .. } => {
                self.reach(to, Vec::new(), state.clone(), at)?;
                self.reach(next, rest, state, at)
            }
            What::Call { to } => self.call(at, &[to], state, next, rest),
            What::CallRegister { rm } => {
                let words = self.words(at, &state.get(rm))?;
                self.call(at, &words, state, next, rest)
            }
            What::JumpRegister { rm } if state.get(rm) == Value::Entry(LR) => {
                self.leave(at, &state)
            }
            What::JumpRegister { rm } => {
                for word in self.words(at, &state.get(rm))? {
                    self.reach(word & !1, Vec::new(), state.clone(), at)?;
                }
                Ok(())
            }
            What::Pop { list, bytes } => {
                if state.popped_pc(list) != Value::Entry(LR) {
                    return self.cannot(at, "a return to nobody knows where");
                }
                state.pop(list & !(1 << PC), bytes);
                self.leave(at, &state)
            }
            What::Table { rn, halfwords } => {
                for to in self.table(at, &state.get(rn), rn == PC, halfwords)? {
                    self.reach(to, Vec::new(), state.clone(), at)?;
                }
                Ok(())
            }
            What::Trap => Ok(()),
            What::Move { rd: SP, rm } => self.set_stack(at, &state.get(rm), state, next, rest),
            What::Add { rn, offset, .. } => {
                let value = state.get(rn).plus(offset);
                self.set_stack(at, &value, state, next, rest)
            }
            What::Sum { rn, rm, .. } => {
                let value = state.get(rn).sum(&state.get(rm));
                self.set_stack(at, &value, state, next, rest)
            }
            What::NewStack { rn } => {
                let top = Value::word(self.program().stack.end);
                if state.get(rn) != top {
                    return self.cannot(at, "the stack pointer is set to nobody knows what");
                }
                // What is on the old stack will not be looked at again.
                let mut anew = State::entry();
                anew.forget(Registers::MAX);
                anew.fresh = true;
                self.reach(next, rest, anew, at)
            }
            _ => self.cannot(at, "an instruction that cannot be followed"),
        }
    }

    /// Where a call or jump by a register goes.
    fn words(&self, at: u32, value: &Value) -> Result<Vec<u32>> {
        match value {
            Value::OneOf(words) => Ok(words.clone()),
            Value::RowOf(table) => self.branches(at, *table),
            Value::Entry(register) => match self.given.get(register) {
                Some(words) => Ok(words.clone()),
                None => Err(Trouble::Wants(*register)),
            },
            _ => self.cannot(at, "an indirect call to nobody knows where"),
        }
    }

    /// The routine at `entry`; what it wants to be given is looked up in `state`.
    fn callee(&mut self, at: u32, entry: u32, state: &State) -> Result<Summary> {
        loop {
            let wanted = self.analysis.wants.get(&entry).cloned().unwrap_or_default();
            let mut given = Given::new();
            for register in wanted {
                given.insert(register, self.words(at, &state.get(register))?);
            }
            match self.analysis.given(entry, &given) {
                Err(Trouble::Wants(register)) if !given.contains_key(&register) => {}
                known => return known,
            }
        }
    }

    /// A comparison with a constant and the branch at `at` right behind it: each way with the values
    /// that take it.
    fn compared(
        &mut self,
        at: u32,
        (rn, word): (u8, u32),
        on: u8,
        state: &State,
        [taken, beyond]: [u32; 2],
    ) -> Result<()> {
        for (to, wanted) in [(taken, true), (beyond, false)] {
            let value = state.get(rn);
            if let Some(value) = value.only(|held| holds(on, held, word) == wanted) {
                let mut state = state.clone();
                state.set(rn, value);
                self.reach(to, Vec::new(), state, at)?;
            }
        }
        Ok(())
    }

    /// Remembers a write to a known place, byte by byte.
    fn note_store(&mut self, state: &State, rt: u8, to: &Value, bytes: u8) {
        let Value::OneOf(addresses) = to else {
            return;
        };
        for &address in addresses {
            for nth in 0..u32::from(bytes) {
                let stored = self
                    .analysis
                    .stores
                    .entry(address.wrapping_add(nth))
                    .or_default();
                match state.get(rt) {
                    Value::OneOf(words) => stored.extend(words.iter().map(|word| byte(*word, nth))),
                    // Anything: two values are enough to say so.
                    _ => stored.extend([0, u8::MAX]),
                }
            }
        }
    }

    fn set_stack(
        &mut self,
        at: u32,
        value: &Value,
        mut state: State,
        next: u32,
        rest: Ahead,
    ) -> Result<()> {
        let Value::Stack(depth) = *value else {
            return self.cannot(at, "a frame of unknown size");
        };
        state.rise(depth);
        self.reach(next, rest, state, at)
    }

    fn call(
        &mut self,
        at: u32,
        callees: &[u32],
        mut state: State,
        next: u32,
        rest: Ahead,
    ) -> Result<()> {
        /// r0 to r3, r12 and the link register: a callee's to use (AAPCS32, 6.1.1).
        const SCRATCH: Registers = 0b0101_0000_0000_1111;
        let (mut returns, mut spoils) = (false, SCRATCH);
        for callee in callees {
            let callee = callee & !1;
            if !self.program().is_code(callee) {
                return self.cannot(at, "a call of what is no code");
            }
            let known = self.callee(at, callee, &state)?;
            let used = state.depth.unsigned_abs() + known.worst;
            let summary = &mut self.summary;
            if state.fresh {
                summary.fresh = summary.fresh.max(used);
            } else if used > summary.worst {
                summary.worst = used;
                summary.chain.clone_from(&known.chain);
            }
            summary.fresh = summary.fresh.max(known.fresh);
            summary.float |= known.float;
            returns |= known.returns;
            spoils |= known.spoils;
        }
        if !returns {
            return Ok(());
        }
        state.forget(spoils);
        self.reach(next, rest, state, at)
    }

    fn leave(&mut self, at: u32, state: &State) -> Result<()> {
        if state.depth != 0 {
            return self.cannot(at, "a return with something left on the stack");
        }
        self.summary.returns = true;
        self.summary.spoils |= state.spoilt();
        Ok(())
    }

    /// The rows of a table of wide branches, which the compiler writes where one of them goes back. It
    /// ends with the first instruction that is none: what else branches right behind it is followed
    /// too, which can only make the worst worse.
    fn branches(&self, at: u32, table: u32) -> Result<Vec<u32>> {
        let is_branch = |row: &u32| {
            let row = self.program().instruction(*row);
            row.is_some_and(|row| row.length == 4 && matches!(row.what, What::Jump { .. }))
        };
        let rows: Vec<u32> = (table..).step_by(4).take_while(is_branch).collect();
        if rows.is_empty() {
            return self.cannot(at, "a jump into a table of no branches");
        }
        Ok(rows)
    }

    /// Where a jump table leads. Its entries go forward, so it ends before the first place they go
    /// to; and before the next word that is loaded from beside the code.
    fn table(&self, at: u32, base: &Value, behind: bool, halfwords: bool) -> Result<BTreeSet<u32>> {
        let pc = at + 4;
        let start = match base {
            Value::OneOf(words) if words.len() == 1 => words[0],
            _ if behind => pc,
            _ => return self.cannot(at, "a jump by a table that nobody knows"),
        };
        let program = self.program();
        let size = if halfwords { 2 } else { 1 };
        let literal = program.literals.range(start..).next();
        let mut end = literal.copied().unwrap_or(u32::MAX);
        let mut targets = BTreeSet::new();
        let mut entry = start;
        while entry + size <= end && !program.is_code(entry) {
            let steps = if halfwords {
                program.half(entry).map(u32::from)
            } else {
                program.byte(entry).map(u32::from)
            };
            let Some(to) = steps.map(|steps| pc + 2 * steps) else {
                break;
            };
            entry += size;
            if program.is_code(to) {
                targets.insert(to);
                end = end.min(to.max(entry));
            } else if entry + size <= end && !program.is_code(entry) {
                return self.cannot(at, "a jump table with an entry that leads nowhere");
            }
            // What leads nowhere at the very end fills up to the next word.
        }
        if targets.is_empty() {
            return self.cannot(at, "an empty jump table");
        }
        Ok(targets)
    }
}

/// Whether condition `on` holds after `one` was compared with `other`, A7.3.
fn holds(on: u8, one: u32, other: u32) -> bool {
    let (difference, borrow) = one.overflowing_sub(other);
    let (_, overflow) = one.cast_signed().overflowing_sub(other.cast_signed());
    let negative = difference >> 31 == 1;
    let equal = difference == 0;
    let held = match on >> 1 {
        0 => equal,
        1 => !borrow,
        2 => negative,
        3 => overflow,
        4 => !borrow && !equal,
        5 => negative == overflow,
        _ => negative == overflow && !equal,
    };
    held == (on & 1 == 0)
}

fn byte(word: u32, nth: u32) -> u8 {
    u8::try_from(word >> (8 * nth) & 0xFF).unwrap_or_default()
}

//! One routine, followed from its first instruction on every path to its returns: its own depth,
//! and what it calls from which depth.
//!
//! A jump out of a function (a tail call, outlined code) is followed with the stack as it is, so
//! function boundaries do not matter. What cannot be followed is an error.

use std::collections::BTreeMap;

use super::{Analysis, Arguments, Failure, Result, Summary};
use crate::Error;
use crate::decode::{CALLER_SAVED, Effect, LR, PC, it_block};
use crate::jump_table;
use crate::program::Program;
use crate::state::{State, Value};

/// What remains of an IT block: of each instruction whether it runs, or `None` for either.
type Pending = Vec<Option<bool>>;

/// An instruction's address, and what follows it.
struct Here {
    at: u32,
    next: u32,
    pending: Pending,
}

/// Follows the routine at `entry`.
pub fn follow(analysis: &mut Analysis, entry: u32, arguments: &Arguments) -> Result<Summary> {
    let mut walk = Walk {
        analysis,
        entry,
        arguments,
        states: BTreeMap::new(),
        todo: Vec::new(),
        own: 0,
        summary: Summary::default(),
    };
    walk.reach(entry, Vec::new(), State::entry(), entry)?;
    while let Some((at, pending)) = walk.todo.pop() {
        if let Some(state) = walk.states.get(&(at, pending.clone())).cloned() {
            walk.instruction(at, &pending, state)?;
        }
    }
    let mut summary = walk.summary;
    if summary.chain.is_empty() || walk.own >= summary.worst {
        summary.worst = walk.own;
        summary.chain.clear();
    }
    summary.chain.insert(0, (entry, walk.own));
    Ok(summary)
}

struct Walk<'w, 'a> {
    analysis: &'w mut Analysis<'a>,
    entry: u32,
    arguments: &'w Arguments,
    /// The state before each instruction; inside an IT block one per way through it.
    states: BTreeMap<(u32, Pending), State>,
    todo: Vec<(u32, Pending)>,
    own: u32,
    summary: Summary,
}

impl<'a> Walk<'_, 'a> {
    fn program(&self) -> &'a Program {
        self.analysis.program
    }

    fn unbounded<T>(&self, at: u32, why: &str) -> Result<T> {
        Err(Failure::Unbounded(Error::Unbounded {
            routine: self.program().name(self.entry),
            at,
            why: format!("{why} ({})", self.program().name(at)),
        }))
    }

    /// Merges `state` into what is known before `to`, reached from `from`.
    fn reach(&mut self, to: u32, pending: Pending, state: State, from: u32) -> Result<()> {
        if self.program().instruction(to).is_none() {
            return self.unbounded(from, "the flow leaves the code");
        }
        if state.depth > 0 {
            return self.unbounded(from, "more is popped than was pushed");
        }
        let used = state.depth.unsigned_abs();
        if state.restarted {
            self.summary.restarted = self.summary.restarted.max(used);
        } else {
            self.own = self.own.max(used);
        }
        let key = (to, pending);
        let next = match self.states.get(&key) {
            None => state,
            Some(known) => match known.join(&state) {
                None => return self.unbounded(to, "the frame size depends on the path"),
                Some(joined) if joined == *known => return Ok(()),
                Some(joined) => joined,
            },
        };
        self.states.insert(key.clone(), next);
        self.todo.push(key);
        Ok(())
    }

    fn instruction(&mut self, at: u32, pending: &[Option<bool>], state: State) -> Result<()> {
        let Some(instruction) = self.program().instruction(at) else {
            return self.unbounded(at, "the flow leaves the code");
        };
        let next = at + instruction.length;
        self.summary.float |= instruction.float;
        if let Effect::IfThen(mask) = instruction.effect {
            for condition in [true, false] {
                let pending = it_block(mask).map(|then| Some(then == condition));
                self.reach(next, pending.collect(), state.clone(), at)?;
            }
            return Ok(());
        }
        let (runs, mut rest) = match pending.split_first() {
            None => (Some(true), Vec::new()),
            Some((&runs, rest)) => (runs, rest.to_vec()),
        };
        let effect = instruction.effect;
        let compares = matches!(effect, Effect::Compare | Effect::CompareConstant(..));
        if compares && runs != Some(false) {
            // New flags: the rest of the block may run or not.
            rest.fill(None);
        }
        if runs != Some(true) {
            self.reach(next, rest.clone(), state.clone(), at)?;
        }
        if runs != Some(false) {
            let here = Here {
                at,
                next,
                pending: rest,
            };
            self.execute(here, instruction.effect, state)?;
        }
        Ok(())
    }

    /// Goes on behind the instruction.
    fn proceed(&mut self, here: Here, state: State) -> Result<()> {
        self.reach(here.next, here.pending, state, here.at)
    }

    fn execute(&mut self, here: Here, effect: Effect, mut state: State) -> Result<()> {
        let (at, next) = (here.at, here.next);
        if let Effect::Store(rt, rn, offset, bytes) = effect {
            self.record_store(&state, rt, &state.get(rn).plus(offset), bytes);
        }
        let program = self.program();
        if let (Effect::CompareConstant(rn, value), true) = (effect, here.pending.is_empty())
            && let Some(branch) = program.instruction(next)
            && let Effect::Branch(to, Some(condition)) = branch.effect
        {
            let targets = [to, next + branch.length];
            return self.compare(next, (rn, value), condition, &state, targets);
        }
        if state.apply(effect, |address| program.word(address)) {
            return self.proceed(here, state);
        }
        match effect {
            Effect::Jump(to) => self.reach(to, Vec::new(), state, at),
            Effect::Branch(to, _) => {
                self.reach(to, Vec::new(), state.clone(), at)?;
                self.proceed(here, state)
            }
            Effect::Call(to) => self.call(here, &[to], state),
            Effect::CallRegister(rm) => {
                let targets = self.targets(at, &state.get(rm))?;
                self.call(here, &targets, state)
            }
            Effect::JumpRegister(rm) if state.get(rm) == Value::AtEntry(LR) => {
                self.leave(at, &state)
            }
            Effect::JumpRegister(rm) => {
                let targets = self.targets(at, &state.get(rm))?;
                self.jump(at, targets.iter().map(|target| target & !1), &state)
            }
            Effect::Pop(list, bytes) => {
                if state.popped_pc(list) != Value::AtEntry(LR) {
                    return self.unbounded(at, "a return to an unknown address");
                }
                state.pop(list & !(1 << PC), bytes);
                self.leave(at, &state)
            }
            Effect::TableJump(rn, halfwords) => {
                let base = match state.get(rn) {
                    Value::OneOf(words) if words.len() == 1 => words[0],
                    _ if rn == PC => at + 4,
                    _ => return self.unbounded(at, "a jump through an unknown table"),
                };
                match jump_table::offsets(program, at, base, halfwords) {
                    Ok(targets) => self.jump(at, targets.into_iter(), &state),
                    Err(why) => self.unbounded(at, why),
                }
            }
            Effect::Trap => Ok(()),
            Effect::Move(..) | Effect::Add(..) | Effect::AddRegister(..) => {
                self.unbounded(at, "a frame of unknown size")
            }
            Effect::SetMainStack(rn) => {
                if state.get(rn) != Value::word(program.stack.end) {
                    return self.unbounded(at, "the stack pointer is set to an unknown value");
                }
                self.proceed(here, State::restart())
            }
            _ => self.unbounded(at, "an unsupported instruction"),
        }
    }

    fn jump(&mut self, at: u32, to: impl Iterator<Item = u32>, state: &State) -> Result<()> {
        for target in to {
            self.reach(target, Vec::new(), state.clone(), at)?;
        }
        Ok(())
    }

    /// The targets of a call or jump through a register.
    fn targets(&self, at: u32, value: &Value) -> Result<Vec<u32>> {
        match value {
            Value::OneOf(words) => Ok(words.clone()),
            Value::RowOf(table) => match jump_table::branches(self.program(), *table) {
                rows if rows.is_empty() => {
                    self.unbounded(at, "a jump into a table without branches")
                }
                rows => Ok(rows),
            },
            Value::AtEntry(register) => {
                let words = self.arguments.get(register).cloned();
                words.ok_or(Failure::Needs(*register))
            }
            _ => self.unbounded(at, "an indirect call to an unknown address"),
        }
    }

    /// The summary of the routine at `entry`, with the arguments it needs taken from `state`.
    fn callee(&mut self, at: u32, entry: u32, state: &State) -> Result<Summary> {
        loop {
            let needs = self.analysis.needs.get(&entry).cloned().unwrap_or_default();
            let mut arguments = Arguments::new();
            for register in needs {
                arguments.insert(register, self.targets(at, &state.get(register))?);
            }
            match self.analysis.routine(entry, &arguments) {
                Err(Failure::Needs(register)) if !arguments.contains_key(&register) => {}
                known => return known,
            }
        }
    }

    /// A comparison with a constant and the conditional branch behind it, at `at`: each way is
    /// followed with the values that take it.
    fn compare(
        &mut self,
        at: u32,
        (rn, constant): (u8, u32),
        condition: u8,
        state: &State,
        [taken, behind]: [u32; 2],
    ) -> Result<()> {
        for (to, branches) in [(taken, true), (behind, false)] {
            let value = state.get(rn);
            if let Some(value) = value.retain(|word| holds(condition, word, constant) == branches) {
                let mut state = state.clone();
                state.set(rn, value);
                self.reach(to, Vec::new(), state, at)?;
            }
        }
        Ok(())
    }

    /// Records a write to a known address, byte by byte.
    fn record_store(&mut self, state: &State, rt: u8, to: &Value, bytes: u8) {
        let Value::OneOf(addresses) = to else {
            return;
        };
        let words = match state.get(rt) {
            Value::OneOf(words) => words,
            _ => vec![0, u32::MAX],
        };
        for address in addresses {
            for nth in 0..bytes {
                let at = address.wrapping_add(u32::from(nth));
                let stored = words
                    .iter()
                    .map(|word| word.to_le_bytes()[usize::from(nth)]);
                self.analysis.stores.entry(at).or_default().extend(stored);
            }
        }
    }

    fn call(&mut self, here: Here, callees: &[u32], mut state: State) -> Result<()> {
        let (mut returns, mut clobbers) = (false, CALLER_SAVED);
        for callee in callees {
            let callee = callee & !1;
            if self.program().instruction(callee).is_none() {
                return self.unbounded(here.at, "a call of what is no code");
            }
            let known = self.callee(here.at, callee, &state)?;
            let used = state.depth.unsigned_abs() + known.worst;
            let apart = self.analysis.apart == Some(callee);
            let summary = &mut self.summary;
            if apart {
                summary.apart = summary.apart.max(used);
            } else if state.restarted {
                summary.restarted = summary.restarted.max(used);
            } else if used > summary.worst {
                summary.worst = used;
                summary.chain.clone_from(&known.chain);
            }
            if known.apart > 0 {
                let used = state.depth.unsigned_abs() + known.apart;
                summary.apart = summary.apart.max(used);
            }
            summary.restarted = summary.restarted.max(known.restarted);
            summary.float |= known.float;
            returns |= known.returns;
            clobbers |= known.clobbers;
        }
        if !returns {
            return Ok(());
        }
        state.forget(clobbers);
        self.proceed(here, state)
    }

    fn leave(&mut self, at: u32, state: &State) -> Result<()> {
        if state.depth != 0 {
            return self.unbounded(at, "a return with words left on the stack");
        }
        self.summary.returns = true;
        self.summary.clobbers |= state.clobbered();
        Ok(())
    }
}

/// Whether a condition holds after `one` was compared with `other` (A7.3).
fn holds(condition: u8, one: u32, other: u32) -> bool {
    let (difference, borrow) = one.overflowing_sub(other);
    let (_, overflow) = one.cast_signed().overflowing_sub(other.cast_signed());
    let negative = difference >> 31 == 1;
    let equal = difference == 0;
    let held = match condition >> 1 {
        0 => equal,
        1 => !borrow,
        2 => negative,
        3 => overflow,
        4 => !borrow && !equal,
        5 => negative == overflow,
        _ => negative == overflow && !equal,
    };
    held == (condition & 1 == 0)
}

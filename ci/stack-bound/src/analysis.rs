//! Summaries of routines: what a caller needs to know of each.

mod routine;

use std::collections::{BTreeMap, BTreeSet};

use crate::Error;
use crate::decode::Registers;
use crate::program::Program;

/// Code addresses that a caller holds in registers which the callee jumps through.
pub type Arguments = BTreeMap<u8, Vec<u32>>;

/// Why a routine has no summary.
#[derive(Debug)]
pub enum Failure {
    /// It calls or jumps through a register that its caller has to supply.
    Needs(u8),
    /// It has no bound.
    Unbounded(Error),
}

impl From<Error> for Failure {
    fn from(error: Error) -> Self {
        Self::Unbounded(error)
    }
}

pub type Result<T> = std::result::Result<T, Failure>;

/// What a caller needs to know of a routine and of everything it calls.
#[derive(Clone, Debug, Default, PartialEq, Eq)]
pub struct Summary {
    /// Bytes of stack below the entry, callees included.
    pub worst: u32,
    /// The deepest chain of calls, outermost first, with each routine's own bytes.
    pub chain: Vec<(u32, u32)>,
    /// Bytes below the top of the stack where the routine resets the stack pointer.
    pub restarted: u32,
    /// Bytes below the entry where it calls the routine that is counted apart, that one included.
    pub apart: u32,
    /// Whether it ever returns.
    pub returns: bool,
    /// Callee-saved registers that it does not restore.
    pub clobbers: Registers,
    /// Whether it uses the floating-point unit.
    pub float: bool,
}

/// Computes summaries, each routine once per set of arguments.
pub struct Analysis<'a> {
    pub program: &'a Program,
    done: BTreeMap<(u32, Arguments), Summary>,
    /// The registers that a routine was found to need.
    pub needs: BTreeMap<u32, BTreeSet<u8>>,
    /// The chain of calls under analysis, outermost first.
    open: Vec<u32>,
    /// The routine that is counted apart, [`Options::masked`].
    pub apart: Option<u32>,
    /// The bytes stored at known addresses; two values where the byte is unknown.
    pub stores: BTreeMap<u32, BTreeSet<u8>>,
}

impl<'a> Analysis<'a> {
    pub fn of(program: &'a Program) -> Self {
        Self {
            program,
            done: BTreeMap::new(),
            needs: BTreeMap::new(),
            open: Vec::new(),
            apart: None,
            stores: BTreeMap::new(),
        }
    }

    /// The routine at `entry` as a handler: the hardware calls it.
    pub fn handler(&mut self, entry: u32) -> std::result::Result<Summary, Error> {
        self.routine(entry, &Arguments::new())
            .map_err(|failure| match failure {
                Failure::Unbounded(error) => error,
                Failure::Needs(register) => Error::Unbounded {
                    routine: self.program.name(entry),
                    at: entry,
                    why: format!("call through r{register}, which no caller sets"),
                },
            })
    }

    /// The routine at `entry`, with the code addresses that its caller holds in registers.
    pub fn routine(&mut self, entry: u32, arguments: &Arguments) -> Result<Summary> {
        let key = (entry, arguments.clone());
        if let Some(known) = self.done.get(&key) {
            return Ok(known.clone());
        }
        if let Some(from) = self.open.iter().position(|&open| open == entry) {
            let cycle = self.open[from..].iter().chain([&entry]);
            let names = cycle.map(|&at| self.program.name(at)).collect();
            return Err(Error::Recursion(names).into());
        }
        self.open.push(entry);
        let summary = routine::follow(self, entry, arguments);
        self.open.pop();
        if let Err(Failure::Needs(register)) = summary {
            self.needs.entry(entry).or_default().insert(register);
        }
        let summary = summary?;
        self.done.insert(key, summary.clone());
        Ok(summary)
    }

    /// How many routines have a summary.
    pub fn routines(&self) -> usize {
        self.done.len()
    }
}

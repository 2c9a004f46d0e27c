//! Who can interrupt whom, and what all of them together take of the stack.
//!
//! A handler interrupts what runs at a lower priority, and nothing of its own: of each priority the
//! worst handler counts, with the frame that the processor pushes before it. Priorities are what the
//! program stores in the NVIC's and the system handlers' registers; a handler whose priority cannot
//! be seen counts as a level of its own.

use std::collections::BTreeMap;

use super::program::Program;
use super::routine::{Analysis, Summary};
use crate::error::{failed, Result};

/// What the processor pushes before a handler (ARM DDI 0403E.e, B1.5.6 and B1.5.7), bytes: eight words
/// and one that aligns them.
const FRAME: u32 = 4 * 8 + 4;
/// The same where the floating-point unit may be in use: 18 words more.
const FLOAT_FRAME: u32 = FRAME + 4 * 18;

/// Numbers of exceptions, and of the first interrupt.
const RESET: usize = 1;
const NMI: usize = 2;
const HARD_FAULT: usize = 3;
const FIRST_SYSTEM: usize = 4;
const FIRST_INTERRUPT: usize = 16;

/// Registers of priorities, a byte each: exceptions 4 to 15 and the interrupts (B3.2.10, B3.4.9).
const SYSTEM_PRIORITIES: u32 = 0xE000_ED18;
const INTERRUPT_PRIORITIES: u32 = 0xE000_E400;

/// What runs before any interrupt, at one priority, or beside it.
#[derive(Debug)]
pub struct Level {
    /// Its priority in words.
    pub name: String,
    /// Its worst routine with what it calls; outermost first, each with its own bytes.
    pub chain: Vec<(String, u32)>,
    /// The routine's bytes without the processor's frame.
    pub routine: u32,
    /// The frame's bytes.
    pub frame: u32,
}

impl Level {
    /// Bytes this level adds to what it interrupts.
    pub fn bytes(&self) -> u32 {
        self.routine + self.frame
    }
}

/// The worst case of the whole program.
#[derive(Debug)]
pub struct Report {
    /// From thread level up to the highest priority.
    pub levels: Vec<Level>,
    /// Bytes if every handler could interrupt every other.
    pub nested: u32,
    /// Bytes of a handler that begins a stack of its own, and what may interrupt it.
    pub fresh: u32,
    /// Bytes that are reserved.
    pub reserved: u32,
    /// How many routines were worked out.
    pub routines: usize,
    /// Whether any of them uses the floating-point unit.
    pub float: bool,
}

impl Report {
    /// Bytes of all levels together.
    pub fn worst(&self) -> u32 {
        let all: u32 = self.levels.iter().map(Level::bytes).sum();
        all.max(self.fresh)
    }

    /// Works out the program's worst case.
    ///
    /// # Errors
    /// Names what cannot be bounded, or that an overflow would not end in a fault.
    pub fn of(program: &Program) -> Result<Self> {
        guarded(program)?;
        let mut analysis = Analysis::of(program);
        let mut handlers = Vec::new();
        for (number, &vector) in program.vectors.iter().enumerate().skip(RESET) {
            if vector != 0 {
                let summary = analysis.routine(vector & !1)?;
                handlers.push((number, vector & !1, summary));
            }
        }
        let float = handlers.iter().any(|(.., summary)| summary.float);
        let frame = if float { FLOAT_FRAME } else { FRAME };
        let level = |name: String, summary: &Summary, frame| Level {
            name,
            chain: summary
                .chain
                .iter()
                .map(|&(at, own)| (program.name(at), own))
                .collect(),
            routine: summary.worst,
            frame,
        };
        let mut levels: BTreeMap<(i64, u32), Level> = BTreeMap::new();
        let (mut nested, mut fresh, mut seen) = (0, 0, Vec::new());
        for (number, at, summary) in &handlers {
            let frame = if *number == RESET { 0 } else { frame };
            if !seen.contains(at) {
                seen.push(*at);
                nested += summary.worst + frame;
            }
            fresh = fresh.max(summary.fresh);
            let (rank, name) = rank(*number, *at, program, &analysis);
            let new = level(name, summary, frame);
            let worst = levels
                .entry(rank)
                .or_insert_with(|| level(new.name.clone(), summary, frame));
            if new.routine > worst.routine {
                *worst = new;
            }
        }
        let nmi = handlers.iter().find(|(number, ..)| *number == NMI);
        let over = nmi.map_or(0, |(_, _, summary)| summary.worst + frame);
        Ok(Self {
            levels: levels.into_values().collect(),
            nested,
            fresh: if fresh > 0 { fresh + over } else { 0 },
            reserved: program.stack.end - program.stack.start,
            routines: analysis.routines(),
            float,
        })
    }
}

/// A level's place in the order, thread level first, and its name.
fn rank(
    number: usize,
    at: u32,
    program: &Program,
    analysis: &Analysis<'_>,
) -> ((i64, u32), String) {
    let of = |base: u32, first: usize| {
        let offset = u32::try_from(number - first);
        offset.map_or(base, |offset| base + offset)
    };
    let register = match number {
        RESET => return ((i64::MIN, 0), "thread".into()),
        NMI => return ((2, 0), "NMI".into()),
        HARD_FAULT => return ((1, 0), "HardFault".into()),
        FIRST_SYSTEM..FIRST_INTERRUPT => of(SYSTEM_PRIORITIES, FIRST_SYSTEM),
        _ => of(INTERRUPT_PRIORITIES, FIRST_INTERRUPT),
    };
    let stored: Vec<u8> = analysis
        .stores
        .get(&register)
        .into_iter()
        .flatten()
        .copied()
        .collect();
    let shared = program.vectors.iter().filter(|&&vector| vector & !1 == at);
    match stored[..] {
        [byte] => {
            let priority = byte >> 4;
            ((-i64::from(priority), 0), format!("priority {priority}"))
        }
        // What is nobody's in particular keeps the reset's priority.
        [] if shared.count() > 1 => ((0, 0), "priority 0".into()),
        _ => ((0, at), "priority not seen".into()),
    }
}

/// The guard: the stack ends where the RAM begins, so that one byte too many faults, and nothing else
/// lies in it.
fn guarded(program: &Program) -> Result<()> {
    let stack = &program.stack;
    let first = program.vectors.first().copied().unwrap_or_default();
    if stack.start != super::program::RAM {
        return failed(format!(
            "the stack may go down to {:#010x}: what lies between it and the RAM's beginning would be \
             overwritten without a fault",
            stack.start
        ));
    }
    if stack.end <= stack.start || !stack.end.is_multiple_of(8) || first != stack.end {
        return failed(format!(
            "the stack begins at {:#010x}, the vector table says {first:#010x}",
            stack.end
        ));
    }
    if program.statics < stack.end {
        return failed(format!(
            "a static at {:#010x} lies in the stack",
            program.statics
        ));
    }
    Ok(())
}

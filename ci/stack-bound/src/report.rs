//! Which handlers preempt which, and the sum of their stacks.
//!
//! A handler preempts code of a lower priority and none of its own: of each priority the worst
//! handler counts, with the frame that the processor pushes on entry. Priorities are the constants
//! that the program stores in the priority registers; a handler whose priority is not found counts
//! as a level of its own.

use std::collections::BTreeMap;
use std::fmt;

use crate::analysis::{Analysis, Summary};
use crate::program::Program;
use crate::{Error, Options};

/// The frame on exception entry, bytes (ARM DDI 0403E.e, B1.5.6 and B1.5.7): eight words and one
/// for alignment.
const FRAME: u32 = 4 * 8 + 4;
/// The frame where the floating-point unit may be in use: 18 words more.
const FLOAT_FRAME: u32 = FRAME + 4 * 18;

/// Exception numbers.
const RESET: usize = 1;
const NMI: usize = 2;
const HARD_FAULT: usize = 3;
const FIRST_SYSTEM: usize = 4;
const FIRST_INTERRUPT: usize = 16;

/// The priority registers, a byte each: exceptions 4 to 15, interrupts (B3.2.10, B3.4.9).
const SYSTEM_PRIORITIES: u32 = 0xE000_ED18;
const INTERRUPT_PRIORITIES: u32 = 0xE000_E400;

/// Thread mode, or the handlers of one priority.
#[derive(Clone, Debug, PartialEq, Eq)]
pub struct Level {
    /// `thread`, `priority 3`, `HardFault`.
    pub name: String,
    /// The deepest chain of calls, outermost first: each function with its own bytes.
    pub chain: Vec<(String, u32)>,
    /// Bytes of the chain, without the frame.
    pub routine: u32,
    /// Bytes that the processor pushes on entry.
    pub frame: u32,
}

impl Level {
    /// Bytes that this level adds to what it preempts.
    pub fn bytes(&self) -> u32 {
        self.routine + self.frame
    }
}

/// The stack bound of a program.
#[derive(Clone, Debug, PartialEq, Eq)]
pub struct Report {
    /// From thread mode to the highest priority.
    pub levels: Vec<Level>,
    /// Bytes of a handler that resets the stack pointer to the top, with an NMI on it; 0 where
    /// there is none.
    pub restarted: u32,
    /// Thread mode down to [`Options::masked`], that routine's chain of calls, and as `frame` NMI and
    /// `HardFault` on it.
    pub masked: Option<Level>,
    /// Bytes reserved for the stack.
    pub reserved: u32,
    /// How many routines were analysed.
    pub routines: usize,
    /// Whether any of them uses the floating-point unit.
    pub float: bool,
}

impl Report {
    /// The bound: the most bytes that all levels use together.
    pub fn worst(&self) -> u32 {
        let sum: u32 = self.levels.iter().map(Level::bytes).sum();
        sum.max(self.restarted)
            .max(self.masked.as_ref().map_or(0, Level::bytes))
    }

    /// Computes the bound.
    ///
    /// # Errors
    /// Names what has no bound, or why an overflow would not fault.
    pub fn of(program: &Program, options: &Options) -> Result<Self, Error> {
        check_guard(program, options)?;
        let mut analysis = Analysis::of(program);
        if let Some(name) = &options.masked {
            let missing = || Error::Elf(format!("no routine {name}"));
            analysis.apart = Some(program.function(name).ok_or_else(missing)?);
        }
        let mut handlers = Vec::new();
        for (number, &vector) in program.vectors.iter().enumerate().skip(RESET) {
            if vector != 0 {
                let summary = analysis.handler(vector & !1)?;
                handlers.push((number, vector & !1, summary));
            }
        }
        let float = handlers.iter().any(|(.., summary)| summary.float);
        let frame = if float { FLOAT_FRAME } else { FRAME };
        let mut levels: BTreeMap<(i64, u32), Level> = BTreeMap::new();
        let mut restarted = 0;
        for (number, at, summary) in &handlers {
            let frame = if *number == RESET { 0 } else { frame };
            restarted = restarted.max(summary.restarted);
            let (rank, name) = rank(*number, *at, program, &analysis, options);
            let level = level(program, name, summary, frame);
            let known = levels.get(&rank);
            if known.is_none_or(|known| known.routine < level.routine) {
                levels.insert(rank, level);
            }
        }
        let of = |wanted| handlers.iter().find(|(number, ..)| *number == wanted);
        let bytes = |wanted| of(wanted).map_or(0, |(_, _, summary)| summary.worst + frame);
        let over = bytes(NMI);
        let masked = match (analysis.apart, of(RESET)) {
            (Some(at), Some((.., thread))) => {
                let routine = analysis.handler(at)?;
                let preempting = over + bytes(HARD_FAULT);
                let mut level = level(program, "masked".into(), &routine, preempting);
                level.routine = thread.apart;
                Some(level)
            }
            _ => None,
        };
        Ok(Self {
            levels: levels.into_values().collect(),
            restarted: if restarted > 0 { restarted + over } else { 0 },
            masked,
            reserved: program.stack.end - program.stack.start,
            routines: analysis.routines(),
            float,
        })
    }
}

impl fmt::Display for Report {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        for level in self.masked.iter().chain(&self.levels) {
            let (name, bytes, frame) = (&level.name, level.bytes(), level.frame);
            writeln!(
                f,
                "  {name:<18} {bytes:>5} bytes, {frame} of them exception frames"
            )?;
            for (name, own) in &level.chain {
                writeln!(f, "    {own:>6}  {name}")?;
            }
        }
        let float = self.float.then_some(", floating-point frames");
        let float = float.unwrap_or_default();
        let (worst, reserved, routines) = (self.worst(), self.reserved, self.routines);
        write!(
            f,
            "  at most {worst} of {reserved} bytes, {routines} routines{float}"
        )
    }
}

fn level(program: &Program, name: String, summary: &Summary, frame: u32) -> Level {
    let chain = summary.chain.iter();
    Level {
        name,
        chain: chain.map(|&(at, own)| (program.name(at), own)).collect(),
        routine: summary.worst,
        frame,
    }
}

/// A handler's place in the order of preemption, thread mode first, and the level's name.
fn rank(
    number: usize,
    at: u32,
    program: &Program,
    analysis: &Analysis<'_>,
    options: &Options,
) -> ((i64, u32), String) {
    let byte = |base: u32, first: usize| {
        let offset = u32::try_from(number - first);
        offset.map_or(base, |offset| base + offset)
    };
    let register = match number {
        RESET => return ((i64::MIN, 0), "thread".into()),
        NMI => return ((2, 0), "NMI".into()),
        HARD_FAULT => return ((1, 0), "HardFault".into()),
        FIRST_SYSTEM..FIRST_INTERRUPT => byte(SYSTEM_PRIORITIES, FIRST_SYSTEM),
        _ => byte(INTERRUPT_PRIORITIES, FIRST_INTERRUPT),
    };
    let stored = analysis.stores.get(&register).into_iter().flatten();
    let stored: Vec<u8> = stored.copied().collect();
    let shared = program.vectors.iter().filter(|vector| *vector & !1 == at);
    match stored[..] {
        [byte] => {
            let unused = 8_u32.saturating_sub(options.priority_bits.unwrap_or(8));
            let priority = u32::from(byte) >> unused;
            ((-i64::from(priority), 0), format!("priority {priority}"))
        }
        // A default handler's interrupts keep the priority they have after reset.
        [] if shared.count() > 1 => ((0, 0), "priority 0".into()),
        _ => ((0, at), "priority not found".into()),
    }
}

/// One byte too many must fault: the stack ends where the RAM begins, and holds nothing else.
fn check_guard(program: &Program, options: &Options) -> Result<(), Error> {
    let (start, end, statics) = (program.stack.start, program.stack.end, program.statics);
    let first = program.vectors.first().copied().unwrap_or_default();
    let why = if end <= start || !end.is_multiple_of(8) || first != end {
        format!("the stack begins at {end:#010x}, the vector table says {first:#010x}")
    } else if program.stack.contains(&statics) {
        format!("a static at {statics:#010x} lies in the stack")
    } else if options.ram_start.is_some_and(|ram| start != ram) {
        format!("an overflow below {start:#010x} would overwrite RAM without a fault")
    } else {
        return Ok(());
    };
    Err(Error::Guard(why))
}

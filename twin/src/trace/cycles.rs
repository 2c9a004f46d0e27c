//! An estimate of the core's clock cycles from the instructions that it executed.
//!
//! Beside one cycle for each instruction (Cortex-M4 TRM, DDI 0439B, table 3-1) it counts
//! - a load's second cycle, but not for a load behind a load, and a cycle for each word of several;
//! - 2 cycles, of 1 to 3, to refill the pipeline where the next instruction is another than the next;
//! - 7 cycles, of 2 to 12, to divide, and 2 to multiply and add;
//! - the flash's 4 wait states, as the firmware sets them, for an instruction or a literal in none of the
//!   accelerator's 64 and 8 lines of 128 bits, the least recently used replaced; less for a line that is
//!   being prefetched behind the one before (RM0383, 3.4.2).
//!
//! It does not count entry into exceptions and return, waits of the peripherals' buses, and waits for RAM
//! that a DMA stream holds.

use std::collections::{HashMap, VecDeque};

use super::thumb::{halfwords, timing};
use super::{Event, Function};

const REFILL: u64 = 2;
const WAIT_STATES: u64 = 4;

/// Lines of the accelerator, the least recently used first.
struct Lines {
    lines: VecDeque<u64>,
    most: usize,
}

impl Lines {
    const fn new(most: usize) -> Self {
        let lines = VecDeque::new();
        Self { lines, most }
    }

    /// Whether `line` was there; now it is.
    fn take(&mut self, line: u64) -> bool {
        let found = self.lines.iter().position(|&other| other == line);
        if let Some(found) = found {
            self.lines.remove(found);
        } else if self.lines.len() == self.most {
            self.lines.pop_front();
        }
        self.lines.push_back(line);
        found.is_some()
    }
}

/// Clock cycles and number of the instructions in `events`, where every instruction of `functions` is
/// traced: their ratio times [`Options::mips`](crate::Options::mips) is the clock in MHz.
pub fn cycles(functions: &[Function], events: &[Event]) -> (u64, u64) {
    let code = functions.iter().flat_map(|f| &f.instructions);
    let code: HashMap<_, _> = code.map(|one| (one.address, one.halfwords)).collect();
    let (mut instructions, mut literals) = (Lines::new(64), Lines::new(8));
    let (mut cycles, mut count, mut next, mut loaded) = (0_u64, 0, 0, false);
    // The line, and when the one behind it is there.
    let (mut line, mut ahead) = (0, 0);
    for address in events.iter().filter_map(Event::reached) {
        let Some(&code) = code.get(&address) else {
            continue;
        };
        if address != next {
            cycles += REFILL;
        }
        let last = std::mem::replace(&mut line, address >> 4);
        if line != last {
            if !instructions.take(line) {
                let begun = line == last + 1;
                cycles = if begun {
                    cycles.max(ahead)
                } else {
                    cycles + WAIT_STATES
                };
            }
            ahead = cycles + 1 + WAIT_STATES;
        }
        let timing = timing(address, code);
        cycles += timing.cycles - u64::from(timing.load && loaded);
        if timing.literal.is_some_and(|at| !literals.take(at >> 4)) {
            cycles += WAIT_STATES;
        }
        loaded = timing.load;
        next = address + 2 * halfwords(code[0]) as u64;
        count += 1;
    }
    (cycles, count)
}

#[cfg(test)]
mod tests {
    use super::super::{EventKind, Instruction};
    use super::*;

    /// Cycles of a path through a function that begins at 0x100.
    fn of(code: &[[u16; 2]], path: &[u64]) -> u64 {
        let mut at = 0x100;
        let instructions = code.iter().map(|&halfwords| {
            let address = at;
            at += 2 * super::halfwords(halfwords[0]) as u64;
            Instruction { address, halfwords }
        });
        let function = Function {
            instructions: instructions.collect(),
            ..Function::default()
        };
        let events = path.iter().map(|&address| Event {
            kind: EventKind::Reached { address },
            at_ns: 0,
            instructions: 0,
        });
        let events: Vec<_> = events.collect();
        let (cycles, count) = cycles(&[function], &events);
        assert_eq!(count, path.len() as u64);
        cycles
    }

    /// To come to a line that is not there.
    const COLD: u64 = REFILL + WAIT_STATES;

    #[test]
    fn instruction_costs_its_cycles() {
        let nop = [0xBF00, 0];
        for (code, cycles) in [
            (nop, 1),
            ([0x6801, 0], 2),                    // ldr r1, [r0]
            ([0x6001, 0], 1),                    // str r1, [r0]
            ([0x5841, 0], 2),                    // ldr r1, [r0, r1]
            ([0x5041, 0], 1),                    // str r1, [r0, r1]
            ([0x4801, 0], 2 + WAIT_STATES),      // ldr r0, [pc, #4]
            ([0xF8DF, 0x0010], 2 + WAIT_STATES), // ldr.w r0, [pc, #16]
            ([0xF8D0, 0x1004], 2),               // ldr.w r1, [r0, #4]
            ([0xF8C0, 0x1004], 1),               // str.w r1, [r0, #4]
            ([0xB5F0, 0], 6),                    // push {r4, r5, r6, r7, lr}
            ([0xC80E, 0], 4),                    // ldm r0!, {r1, r2, r3}
            ([0xE92D, 0x4FF0], 10),              // push.w {r4 … r11, lr}
            ([0xE9D0, 0x1202], 3),               // ldrd r1, r2, [r0, #8]
            ([0xFBB0, 0xF1F2], 7),               // udiv r1, r0, r2
            ([0xFB00, 0x3102], 2),               // mla r1, r0, r2, r3
            ([0xFB00, 0xF102], 1),               // mul r1, r0, r2
            ([0xFB80, 0x1202], 1),               // smull r1, r2, r0, r2
        ] {
            assert_eq!(of(&[code], &[0x100]), COLD + cycles, "{code:x?}");
        }
        assert_eq!(of(&[[0x6801, 0], [0x6842, 0]], &[0x100, 0x102]), COLD + 3);
    }

    #[test]
    fn branch_refills_and_line_is_fetched_once() {
        let nops = [[0xBF00, 0]; 24];
        assert_eq!(of(&nops, &[0x100, 0x102, 0x100]), COLD + 3 + REFILL);
        // Prefetched while eight instructions pass, and while one does.
        let straight: Vec<u64> = (0x100..0x112).step_by(2).collect();
        assert_eq!(of(&nops, &straight), COLD + 9);
        assert_eq!(of(&nops, &[0x10E, 0x110]), COLD + 1 + WAIT_STATES + 1);
        assert_eq!(of(&nops, &[0x100, 0x120]), 2 * (COLD + 1));
    }
}

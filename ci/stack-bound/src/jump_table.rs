//! Where the entries of a jump table lead.

use std::collections::BTreeSet;

use crate::decode::Effect;
use crate::program::Program;

/// The rows of a table of wide branches, which compilers emit where a target lies behind. The
/// table ends with the first instruction of another form: a branch right behind it is followed
/// too, which can only raise the bound.
pub fn branches(program: &Program, table: u32) -> Vec<u32> {
    let is_branch = |row: &u32| {
        let row = program.instruction(*row);
        row.is_some_and(|row| row.length == 4 && matches!(row.effect, Effect::Jump(_)))
    };
    (table..).step_by(4).take_while(is_branch).collect()
}

/// The targets of the `tbb` or `tbh` at `at`, whose offsets stand from `start` on. They lead
/// forward, so the table ends before its first target, and before the next literal.
pub fn offsets(
    program: &Program,
    at: u32,
    start: u32,
    halfwords: bool,
) -> Result<BTreeSet<u32>, &'static str> {
    let pc = at + 4;
    let size = if halfwords { 2 } else { 1 };
    let literal = program.literals.range(start..).next();
    let mut end = literal.copied().unwrap_or(u32::MAX);
    let mut targets = BTreeSet::new();
    let mut entry = start;
    let is_code = |at: u32| program.instruction(at).is_some();
    while entry + size <= end && !is_code(entry) {
        // No entry leads to the table itself: a zero is padding.
        let Some(offset @ 1..) = program.number(entry, size) else {
            break;
        };
        let to = pc + 2 * offset;
        entry += size;
        if is_code(to) {
            targets.insert(to);
            end = end.min(to.max(entry));
        } else if entry + size <= end && !is_code(entry) {
            return Err("a jump table with an entry that leads out of the code");
        }
        // Otherwise the last entry is padding.
    }
    if targets.is_empty() {
        return Err("an empty jump table");
    }
    Ok(targets)
}

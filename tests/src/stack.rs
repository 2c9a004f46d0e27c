//! How much of its stack the firmware has used: painted before it runs, looked at afterwards.
//!
//! A frame that is reserved and not written leaves paint, so this is at most what was used; what
//! `cargo xtask stack` computes must never be less.

use std::error::Error;
use std::ops::Range;

use object::{Object, ObjectSymbol};
use twin::Board;

/// No instruction's operand and no likely value.
const PAINT: u8 = 0xC5;

/// A board's stack.
#[derive(Clone, Debug)]
pub struct Stack {
    range: Range<u64>,
}

impl Stack {
    /// Paints the stack that `elf` reserves on a board that has not run yet.
    ///
    /// # Errors
    /// Where the ELF does not say where its stack is, or the board has none there.
    pub fn paint(elf: &[u8], board: &Board) -> Result<Self, Box<dyn Error>> {
        let file = object::File::parse(elf)?;
        let symbol = |name: &str| {
            let found = file.symbols().find(|symbol| symbol.name() == Ok(name));
            found
                .map(|symbol| symbol.address())
                .ok_or(format!("the ELF has no {name}"))
        };
        let range = symbol("_stack_end")?..symbol("_stack_start")?;
        board.paint(range.clone(), PAINT);
        Ok(Self { range })
    }

    /// Bytes that are reserved.
    pub fn bytes(&self) -> u64 {
        self.range.end - self.range.start
    }

    /// Bytes from the stack's beginning to the deepest that was written.
    pub fn used(&self, board: &Board) -> u64 {
        self.bytes() - board.painted(self.range.clone(), PAINT)
    }
}

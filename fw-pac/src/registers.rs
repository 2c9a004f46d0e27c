//! Access to the register blocks of the peripherals.

use stm32f4::Periph;

/// A peripheral of the PAC whose registers any module may reach.
///
/// Ownership is not tracked here: each driver states which contexts write its registers, and what a
/// handler shares with lower priorities is written by single stores or with interrupts masked.
pub trait Registers {
    /// The layout of the register block.
    type Block: 'static;

    /// The registers.
    fn registers() -> &'static Self::Block;
}

impl<Block: 'static, const ADDRESS: usize> Registers for Periph<Block, ADDRESS> {
    type Block = Block;

    #[inline]
    fn registers() -> &'static Block {
        // SAFETY: the block is at this address for as long as the part is powered, and its registers
        // are only reached by volatile accesses.
        unsafe { &*Self::PTR }
    }
}

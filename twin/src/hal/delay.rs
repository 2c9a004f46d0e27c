//! Waiting in virtual time.

use embedded_hal::delay::DelayNs;

use crate::board::Board;

/// Lets virtual time pass.
#[derive(Clone, Debug)]
pub struct Delay {
    board: Board,
}

impl Delay {
    pub(super) fn new(board: Board) -> Self {
        Self { board }
    }
}

impl DelayNs for Delay {
    /// # Panics
    /// When the emulation has ended, which the trait has no other way to say.
    fn delay_ns(&mut self, ns: u32) {
        self.board
            .try_run_ns(u64::from(ns))
            .unwrap_or_else(|ended| panic!("{ended}"));
    }
}
